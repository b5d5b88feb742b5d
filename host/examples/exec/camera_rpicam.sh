#!/bin/sh
# A camera of a Raspberry Pi: --camera "exec:sh camera_rpicam.sh --shutter 8000 --gain 1 --awbgains 1.8,1.6"
#
# All words go to rpicam-still. Give a fixed exposure, gain and white balance, so that pictures can be compared.
while read -r order path; do
    case $order in
    open)
        if message=$(rpicam-still --list-cameras 2>&1 </dev/null) && [ "${message#*No cameras}" = "$message" ]; then
            echo ok
        else
            echo "error rpicam-still: $(printf %s "$message" | tail -n 1)"
        fi
        ;;
    take)
        if message=$(rpicam-still --nopreview --immediate --encoding png --output "$path" "$@" 2>&1 </dev/null); then
            echo ok
        else
            echo "error rpicam-still: $(printf %s "$message" | tail -n 1)"
        fi
        ;;
    *) echo "error unknown order $order" ;;
    esac
done
