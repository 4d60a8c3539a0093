#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: quick_capture.sh REFIELD SHARE genicam|dslr|v4l2|estimate
# A quick capture with the camera and the screen that are there (guided.sh or quick_v4l2.sh starts them): its time, its errors,
# and pictures relit by natural light, a bar and a square, beside exact ones. SHARE holds recipe.toml and truth. `estimate`
# in place of the kind: what comes after a capture.
set -euo pipefail
refield=$1 kind=$3
cd "$2"
if [[ $kind != estimate ]]; then
"$refield" --quiet acquire run recipe.toml --truth truth -o rig >/dev/null
"$refield" --quiet acquire lights --starter --light-size 32x24 -o lights >/dev/null
monitor="window = true"
case $kind in
  v4l2)
    camera=$'device = "platform:vivid-000"\npixel_format = "RG12"\nregion = [0, 0, 64, 48]\nunit_gain = 100'
    monitor=$'connector = "Virtual-1"\nmode = "640x480"'
    ;;
  genicam) camera=$'device = "genicam:127.0.0.1"\npixel_format = "BayerRG12"\nregion = [0, 0, 64, 48]\nfps = 100\ntrigger = "Software"' ;;
  dslr) camera=$'device = "gphoto:"\n[controls]\nf-number = "5.6"' ;;
esac
cat >rig.toml <<SESSION
[session]
output = "session"
calibration = "rig/calibration.toml"
[camera]
$camera
[monitor]
$monitor
width = 32
height = 24
[lights]
images = "lights/train_*.exr"
test_images = "lights/test_*.exr"
[exposures]
count = 4
ratio = 4.0
SESSION
time "$refield" acquire run rig.toml --quick
fi
[[ $kind != v4l2 ]] || exit 0  # an emulated machine takes long for the rest
"$refield" --quiet estimate session -o scene.rfield
"$refield" compare scene.rfield session
for light in test_000 test_016 test_024; do
  "$refield" --quiet relight scene.rfield --light "lights/$light.exr" -o "$light.png"
  "$refield" --quiet relight truth/transport.rfield --light "lights/$light.exr" -o "$light-exact.png"
done
