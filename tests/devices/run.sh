#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: run.sh TEST BUILD KERNEL_FOLDER
# Runs tests/devices/TEST.sh in the guest. Before it, TEST_before.sh, and after it TEST_after.sh, on the host where
# there are such, with the folder that the guest sees as /vmshare as their argument. Prints what failed; all of it is in
# the folder's log.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
test=$1 kernel=$3
REFIELD_BUILD=$(realpath "$2")
export REFIELD_BUILD
share=$REFIELD_BUILD/../devices/share_$test
rm -rf "$share"
mkdir -p "$share"
if [[ -x $here/${test}_before.sh ]]; then "$here/${test}_before.sh" "$share"; fi
status=0
"$here/boot.sh" "$kernel" "$share" "$here/$test.sh" 1800 >"$share/log" 2>&1 || status=$?
grep -E '^(##|\[  (PASSED|FAILED))' "$share/log" || true
if ((status != 0)); then
  cat "$share/log" >&2
  echo "run.sh: $test ended with status $status (124: too slow; 125: the emulated machine broke)" >&2
  exit 1
fi
if [[ -x $here/${test}_after.sh ]]; then "$here/${test}_after.sh" "$share"; fi
