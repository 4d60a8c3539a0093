#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: guided.sh BUILD genicam|DRIVER [TABLE.csv|quick]
# The guided capture (tests/cli/guided_capture.py) with a GenICam camera, or a DSLR whose driver virtual_dslr.sh printed, and
# a window on a screen without a monitor (Xvfb), which guided_lab lets the camera see. With TABLE.csv no guided capture runs:
# the table gets the time that a pattern takes (capture_time.sh); `quick` takes a quick
# capture (quick_capture.sh).
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(realpath "$1") kind=dslr table=${3:-}
[[ $2 != genicam ]] || kind=genicam
# A network of its own: the camera's address is that of the loopback interface.
if [[ -z ${GUIDED_NETWORK:-} ]]; then
  unshare="unshare --net"
  ((EUID == 0)) || unshare="unshare --map-root-user --net"
  GUIDED_NETWORK=1 exec $unshare "${BASH_SOURCE[0]}" "$@"
fi
ip link set lo up
share=$build/../devices/guided_$kind
rm -rf "$share"
mkdir -p "$share/tree/DCIM"
share=$(realpath "$share")
touch "$share/tree/DCIM/TEMPLATE.DNG"
sensitivity=8e6 options=()
if [[ $kind == genicam ]]; then
  sensitivity=4e7 options=(--set camera.pixel_format=BayerRG12 --set camera.region=0,0,64,48 --set camera.fps=100)
else
  export IOLIBS=$2 VIRTUAL_DSLR_TREE=$share/tree VIRTUAL_DSLR_LAB=$share/camera
  options=(--set controls.f-number=5.6)
fi
sed "s/^train = .*/train = 1/; s/^natural = .*/natural = 1/; s/^bars = .*/bars = 0/; s/^squares = .*/squares = 0/
  s/^sensitivity = .*/sensitivity = $sensitivity/" "$here/lab_recipe.toml" >"$share/recipe.toml"
"$build/cli/refield" --quiet simulate "$share/recipe.toml" -o "$share/truth" >/dev/null
started=()
trap 'kill "${started[@]}" 2>/dev/null || true; wait' EXIT
mkfifo "$share/display" "$share/ready"
Xvfb -displayfd 3 -fbdir "$share" -screen 0 640x480x24 -nolisten tcp -noreset 3>"$share/display" 2>/dev/null &
started+=($!)
read -r display <"$share/display"
"$build/tests/devices/guided_lab" "$share" "$share/Xvfb_screen0" "$kind" >"$share/ready" 2>"$share/log" &
started+=($!)
read -r _ <"$share/ready" || { cat "$share/log" >&2; exit 1; }
# libgphoto2 keeps settings in the home folder.
export HOME=$share LIBGL_ALWAYS_SOFTWARE=1
export DISPLAY=:$display
if [[ $kind == dslr ]]; then export LD_PRELOAD=$build/tests/devices/libguided_dslr.so; fi
if [[ $table == quick ]]; then
  "$here/quick_capture.sh" "$build/cli/refield" "$share" "$kind"
  exit
elif [[ -n $table ]]; then
  "$here/capture_time.sh" "$build/cli/refield" "$share" "$kind" "$table"
  exit
fi
mkdir "$share/work"
python3 -B "$here/../cli/guided_capture.py" "$build/cli/refield" --rig "$kind" --work "$share/work" \
  -- --light-size 32x24 "${options[@]}"
