#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: capture_time.sh REFIELD SHARE genicam|dslr TABLE.csv
# The time that a pattern takes with the camera and the screen that are there (guided.sh starts them), for brackets of four
# exposures: from two captures of different length, so that the start does not count. SHARE holds recipe.toml and truth.
set -euo pipefail
shopt -s inherit_errexit  # a capture that fails has no time
refield=$1 share=$2 kind=$3 table=$(realpath "$4")
cd "$share"
"$refield" --quiet acquire run recipe.toml --truth truth -o rig >/dev/null
case $kind in
  genicam)
    brackets=("0.001, 0.002, 0.005, 0.01" "0.01, 0.02, 0.05, 0.1" "0.1, 0.2, 0.5, 1")
    free=$'device = "genicam:127.0.0.1"\npixel_format = "BayerRG12"\nregion = [0, 0, 64, 48]\nfps = 100'
    names=("GenICam, triggered" "GenICam, free") cameras=("$free"$'\ntrigger = "Software"' "$free")
    ;;
  dslr)
    # Its shutter times.
    brackets=("0.0012, 0.0025, 0.005, 0.01" "0.01, 0.02, 0.05, 0.1" "0.02, 0.05, 0.1, 1")
    names=(DSLR) cameras=($'device = "gphoto:"\n[controls]\nf-number = "5.6"')
    ;;
esac
# seconds CAMERA PATTERNS EXPOSURES: of a whole capture.
seconds() {
  rm -rf lights session
  "$refield" --quiet acquire lights --starter --patterns "$2" --light-size 32x24 -o lights >/dev/null
  cat >rig.toml <<SESSION
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
  "$refield" --quiet acquire run rig.toml >/dev/null
  python3 -c "print($EPOCHREALTIME - $begun)"
}
echo "camera,shutter open (s),pattern (s)" >"$table"
for i in "${!names[@]}"; do
  for exposures in "${brackets[@]}"; do
    long=$(seconds "${cameras[i]}" 36 "$exposures")
    short=$(seconds "${cameras[i]}" 12 "$exposures")
    python3 -c "print('\"${names[i]}\",%.3g,%.3f' % (sum([$exposures]), ($long - $short) / 24))" | tee -a "$table"
  done
done
