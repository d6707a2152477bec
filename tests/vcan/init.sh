#!/bin/sh
# First process of guest.py's guest: makes a place to live from the host's own file tree, brings up lo,
# vcan0 and vcan1, runs the command and leaves its exit code in $hil_guest/exit.
#
# From the kernel's command line: hil_guest, the runner's scratch folder, and hil_keep, the folder in
# which changes outlive the guest. All else that is written goes to memory and is gone.
set -e
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin

halt() { # whatever happens, the guest ends: there is no other init
    mount -t proc proc /proc 2>/dev/null
    echo o >/proc/sysrq-trigger
    sleep 60
}
trap halt EXIT

mount -t proc proc /proc
mountpoint -q /dev || mount -t devtmpfs dev /dev
exec </dev/null >/dev/tty1 2>&1
stty raw -echo </dev/tty1

kernel=/usr/lib/uml/modules/$(uname -r)/kernel
for module in fs/overlayfs/overlay drivers/net/can/dev/can-dev net/can/can net/can/can-raw \
    net/can/can-bcm net/can/can-gw drivers/net/can/vcan drivers/net/can/vxcan net/sched/sch_tbf; do
    insmod "$kernel/$module.ko"
done

root=/mnt/root
mount -t tmpfs tmpfs /mnt
mkdir /mnt/over /mnt/work $root
mount -t overlay -o lowerdir=/,upperdir=/mnt/over,workdir=/mnt/work overlay $root
mount -t proc proc $root/proc
mount -t sysfs sys $root/sys
mount -t devtmpfs dev $root/dev
mkdir -p $root/dev/pts $root/dev/shm
mount -t devpts devpts $root/dev/pts
for folder in /dev/shm /run /tmp; do
    mount -t tmpfs -o mode=1777 tmpfs "$root$folder"
done
for folder in "$hil_keep" "$hil_guest"; do # last: they may lie in /tmp
    mkdir -p "$root$folder"
    mount -t hostfs -o "$folder" hostfs "$root$folder"
done

chroot $root ip link set lo up
for interface in vcan0 vcan1; do
    chroot $root ip link add $interface type vcan
    chroot $root ip link set $interface up
done

code=0
chroot $root /bin/sh "$hil_guest/command" || code=$?
echo $code >"$root$hil_guest/exit"
