#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: dslr.sh BUILD DRIVER [PATTERNS]
# Sessions with libgphoto2's virtual camera in a closed loop with a virtual monitor (gphoto_lab.cpp), one undisturbed and
# one with every fault, which is resumed each time: every raw frame must show its own pattern, and both sessions must be
# equal to the byte. With PATTERNS, more than 30, the error on held-out lights must also be that of the virtual rig.
# DRIVER: what virtual_dslr.sh printed.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(realpath "$1") patterns=${3:-}
export IOLIBS=$2 REFIELD_BUILD=$build
share=$build/../devices/share_dslr
rm -rf "$share"
mkdir -p "$share/tree/DCIM"
share=$(realpath "$share")
touch "$share/tree/DCIM/TEMPLATE.DNG"
export VIRTUAL_DSLR_TREE=$share/tree HOME=$share  # libgphoto2 keeps settings in the home folder
lights="s/^train = .*/train = 16/; s/^natural = .*/natural = 4/; s/^bars = .*/bars = 2/; s/^squares = .*/squares = 2/"  # enough that each fault strikes
[[ -z $patterns ]] || lights="s/^train = .*/train = $((patterns - 30))/"
sed "$lights; s/^sensitivity = .*/sensitivity = 8e6/; s/^\[sensor\]/[exposures]\nambient_frames = 1\n&/" "$here/lab_recipe.toml" >"$share/recipe.toml"
"$here/virtual_rig.sh" "$share" "$([[ -z $patterns ]] && echo 1 || echo 5)" --exposures 0.0025,0.005,0.01,0.02
"$build/cli/refield" acquire devices 2>/dev/null | grep -A 3 "gphoto:" | sed 's/^/## /'

# usage: session NAME FAULT STATUS [WORDS]: a run with the fault must end so and say WORDS.
session() {
  local status=0
  "$build/tests/devices/gphoto_lab" "$share" "$1" "$2" >"$share/log_$1_$2" 2>&1 || status=$?
  grep '^##' "$share/log_$1_$2" || true
  if ((status != $3)) || ! grep -q "${4:-}" "$share/log_$1_$2"; then
    cat "$share/log_$1_$2" >&2
    echo "dslr.sh: fault '$2' ended with status $status, not $3, or did not say '${4:-}'" >&2
    exit 1
  fi
}

session whole undisturbed 0
session lab lacking 3 "is no shutter time of camera .* the nearest are 0.005 s and 0.01 s"
session lab automatic 3 "but its file states"
session lab full 3 "its card is full"
session lab killed 137
session lab unplugged 3 "did not come back within"
# Failed downloads and a cable that is plugged in again do not stop it.
session lab mended 0 "reconnected 1"
diff -r "$share/whole" "$share/lab" || { echo "dslr.sh: the resumed session differs" >&2; exit 1; }
echo "## the resumed session is equal to the undisturbed one"
"$build/tests/devices/check_pairs" "$share/lab" "$share/truth/illumination" "$share"/lab_*.log
if [[ -n $patterns ]]; then
  mv "$share/lab" "$share/lab_session"
  "$here/closed_loop_after.sh" "$share"
fi
