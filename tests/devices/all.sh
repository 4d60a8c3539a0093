#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: all.sh BUILD [--short]
# Real programs on the kernel's real interfaces: Debian's kernel in an emulated machine, with virtual cameras, a virtual
# monitor and virtual GPIO lines. Beside it a DSLR, which needs the source of libgphoto2 for its virtual camera, and a
# GenICam camera, which needs a network alone. --short: what does not depend on how fast the machine is, each fault once;
# else also closed loops of camera and monitor, random faults and guided captures.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$1 short=${2:-}
devices=$build/../devices
step() {
  local begun=$SECONDS
  printf '\033[1m── Virtual devices: %s\033[0m\n' "$1"
  "${@:2}" || { echo "all.sh: failed: $1" >&2; exit 1; }
  echo "## $1: $((SECONDS - begun)) s"
}
skip() { printf '\033[1m── SKIPPED: %s\033[0m\n' "$*"; }

if [[ ! -x $build/tests/devices/gphoto_lab ]]; then
  skip "the DSLR, since libgphoto2 was not found"
elif ! driver=$("$here/virtual_dslr.sh" "$devices/dslr"); then
  skip "the DSLR, since the source of libgphoto2's virtual camera cannot be fetched or built"
else
  patterns=(60)
  [[ -z $short ]] || patterns=()
  step DSLR "$here/dslr.sh" "$build" "$driver" "${patterns[@]}"
fi
if [[ $(uname -m) != x86_64 ]]; then
  skip "the emulated machine, since this is no x86-64 machine"
elif ! command -v apt-cache >/dev/null || ! apt-cache show linux-image-amd64 >/dev/null 2>&1; then
  skip "the emulated machine, since apt does not offer Debian's kernel (linux-image-amd64)"
else
  kernel=$("$here/kernel.sh" "$devices") || { echo "all.sh: the kernel for the emulated machine could not be made" >&2; exit 1; }
  step interfaces "$here/run.sh" interfaces "$build" "$kernel"
fi
[[ -z $short ]] || exit 0
if [[ -n ${kernel:-} ]]; then
  step "closed loop" "$here/run.sh" closed_loop "$build" "$kernel"
  step faults "$here/run.sh" faults "$build" "$kernel"
fi
if [[ ! -x $build/tests/devices/genicam_lab ]]; then
  skip "the GenICam camera, since Aravis was not found"
else
  step "GenICam camera" "$here/genicam.sh" "$build"
  step "guided capture, GenICam" "$here/guided.sh" "$build" genicam
fi
