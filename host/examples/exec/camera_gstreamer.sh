#!/bin/sh
# A camera that GStreamer reads. All words are its source:
#
#   --camera "exec:sh camera_gstreamer.sh aravissrc camera-name=Basler-21234567 exposure=8000 gain=0"    GigE and USB3 Vision
#   --camera "exec:sh camera_gstreamer.sh rtspsrc location=rtsp://camera.local/stream latency=0 ! decodebin"
#   --camera "exec:sh camera_gstreamer.sh libcamerasrc"
#
# The source is opened anew for each picture, so that nothing in it was exposed before.
while read -r order path; do
    case $order in
    open)
        if command -v gst-launch-1.0 >/dev/null; then echo ok; else echo "error gst-launch-1.0 is not installed"; fi
        ;;
    take)
        if message=$(gst-launch-1.0 -q "$@" ! videoconvert ! pngenc snapshot=true ! filesink location="$path" 2>&1 </dev/null); then
            echo ok
        else
            echo "error GStreamer: $(printf %s "$message" | grep -m 1 ERROR || printf %s "$message" | head -n 1)"
        fi
        ;;
    *) echo "error unknown order $order" ;;
    esac
done
