#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: initrd.sh ROOT VERSION OUT
# A first file system for the guest: it mounts the host's own file system read-only by 9p, lays a file system in
# memory over it, and runs /vmshare/run.sh there. The status of that is the guest's (0 to 127).
set -euo pipefail
root=$1 version=$2 out=$(realpath "$3")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir -p "$folder"/{bin,mod,proc,sys,dev,host,new,rw}
cp /bin/busybox "$folder/bin/busybox"
for tool in sh mount insmod chroot mkdir dd printf cat poweroff; do ln -s busybox "$folder/bin/$tool"; done
number=100
for module in virtio_pci 9pnet_virtio 9p overlay; do
  while read -r file; do
    name=$(basename "$file")
    ls "$folder/mod/"*-"$name" >/dev/null 2>&1 && continue
    cp "$file" "$folder/mod/$number-$name"
    number=$((number + 1))
  done < <(modprobe -d "$root" -S "$version" --show-depends "$module" | awk '$1 == "insmod" {print $2}')
done
cat >"$folder/init" <<'INIT'
#!/bin/sh
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
for module in /mod/*; do insmod "$module" || echo "initrd: $module failed"; done
options=trans=virtio,version=9p2000.L,msize=512000
mount -t 9p -o ro,$options,cache=loose hostroot /host || echo "initrd: no host file system"
mount -t tmpfs tmpfs /rw; mkdir /rw/upper /rw/work
mount -t overlay -o lowerdir=/host,upperdir=/rw/upper,workdir=/rw/work overlay /new || echo "initrd: no overlay"
mkdir -p /new/vmshare
mount -t 9p -o $options vmshare /new/vmshare
mount -t proc proc /new/proc; mount -t sysfs sys /new/sys; mount -t devtmpfs dev /new/dev
mount -t tmpfs tmpfs /new/run; mount -t debugfs debug /new/sys/kernel/debug
mkdir -p /new/dev/shm; mount -t tmpfs shm /new/dev/shm
chroot /new /bin/bash /vmshare/run.sh; status=$?
printf "\\x$(printf %02x $status)" | dd of=/dev/port bs=1 seek=244 2>/dev/null
poweroff -f
INIT
chmod +x "$folder/init"
(cd "$folder" && find . | cpio -o -H newc 2>/dev/null | gzip -1) >"$out"
