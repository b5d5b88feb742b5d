#!/bin/busybox sh
# The first process of the virtual machine: loads the drivers, runs the tests, and says how they ended.
/bin/busybox --install -s /bin
export PATH=/bin HOME=/tmp
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
ip link set lo up
while read -r module parameters; do
    insmod "/modules/$module" $parameters || echo "cannot load $module"
done < /modules/order
echo "guest: up after $(cut -d ' ' -f 1 /proc/uptime) s with Linux $(uname -r)"
sh /tests.sh
code=$?
[ $code = 0 ] || dmesg | tail -n 40
echo "guest: exit code $code"
poweroff -f
