#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: capture_time.sh REFIELD SHARE genicam|dslr TABLE.csv
# The time that a pattern takes with the camera and the screen that are there (guided.sh starts them), for brackets of four
# exposures: from two captures of different length, so that the start does not count. SHARE holds recipe.toml and truth.
set -euo pipefail
refield=$1 share=$2 kind=$3 table=$(realpath "$4")
cd "$share"
"$refield" --quiet acquire virtual recipe.toml --truth truth -o rig >/dev/null
case $kind in
  genicam)
    free=$'device = "genicam:127.0.0.1"\nformat = "BayerRG12"\nwindow = [0, 0, 64, 48]\nrate = 100'
    names=("GenICam, triggered" "GenICam, free") cameras=("$free"$'\ntrigger = "Software"' "$free")
    ;;
  dslr) names=(DSLR) cameras=($'device = "gphoto:"\n[controls]\nf-number = "5.6"') ;;
esac
# seconds CAMERA PATTERNS EXPOSURES: of a whole capture.
seconds() {
  rm -rf lights session
  "$refield" --quiet acquire lights --starter --count "$2" --size 32x24 -o lights >/dev/null
  cat >session.toml <<SESSION
[session]
output = "session"
calibration = "rig/calibration.toml"
reference_every = 0
[camera]
$1
[monitor]
window = true
width = 32
height = 24
[lights]
images = "lights/*.exr"
[exposures]
seconds = [$3]
ambient_frames = 1
SESSION
  local begun=$EPOCHREALTIME
  "$refield" --quiet acquire run session.toml >/dev/null
  python3 -c "print($EPOCHREALTIME - $begun)"
}
echo "camera,shutter open (s),pattern (s)" >"$table"
for i in "${!names[@]}"; do
  for first in 0.001 0.01 0.1; do
    exposures=$(python3 -c "print(', '.join(format($first * f, 'g') for f in (1, 2, 5, 10)))")
    long=$(seconds "${cameras[i]}" 36 "$exposures")
    short=$(seconds "${cameras[i]}" 12 "$exposures")
    python3 -c "print('\"${names[i]}\",%g,%.3f' % (18 * $first, ($long - $short) / 24))" | tee -a "$table"
  done
done
