#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: boot.sh KERNEL_FOLDER SHARE SCRIPT [SECONDS]
# Boots the kernel in QEMU by software emulation and runs SCRIPT in it as root, with SHARE writable as /vmshare.
# Exits with the script's status; 124 when it took longer than SECONDS, 125 when the guest broke.
# GPIO outputs are traced from the beginning: to switch tracing on in a running kernel rewrites code that another
# processor executes, which QEMU 7.2 emulates wrongly now and then, so that the kernel waits for ever.
# The check of the timer fails beside other work.
set -euo pipefail
kernel=$(realpath "$1") share=$2 script=$3 limit=${4:-600}
version=$(basename "$kernel")
mkdir -p "$share"
{
  printf 'export PATH=/usr/sbin:/usr/bin:/sbin:/bin LAB_MODULES=%q REFIELD_BUILD=%q REFIELD_SOURCE=%q TEST_FILTER=%q\n' \
    "$kernel/root" "${REFIELD_BUILD:-}" "$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)" "${TEST_FILTER:-}"
  cat "$script"
} >"$share/run.sh"
status=0
timeout "$limit" qemu-system-x86_64 -nodefaults -no-user-config -machine q35 -accel tcg,thread=multi -cpu max \
  -smp 2 -m 1024 -display none -no-reboot -serial stdio \
  -kernel "$kernel/root/boot/vmlinuz-$version" -initrd "$kernel/initrd.gz" \
  -append "console=ttyS0 quiet loglevel=3 panic=-1 mitigations=off trace_event=gpio:gpio_value no_timer_check" -device isa-debug-exit,iobase=0xf4,iosize=0x04 \
  -virtfs local,path=/,mount_tag=hostroot,security_model=none,readonly=on,multidevs=remap \
  -virtfs "local,path=$share,mount_tag=vmshare,security_model=none,multidevs=remap" </dev/null || status=$?
((status != 124)) || exit 124
# QEMU's own status is twice the guest's and one; even ones are its own troubles.
((status & 1)) || exit 125
exit $((status >> 1))
