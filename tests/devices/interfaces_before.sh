#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: interfaces_before.sh SHARE
# A few lights and the calibration of an 8-bit camera, for a session whose monitor is a window.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
share=$1
refield=$REFIELD_BUILD/cli/refield
sed 's/^train = .*/train = 2/; s/^natural = .*/natural = 1/; s/^bars = .*/bars = 1/; s/^squares = .*/squares = 0/
  s/^bits = .*/bits = 8/; s/^layout = .*/layout = "grey"/' "$here/lab_recipe.toml" >"$share/recipe.toml"
"$refield" --quiet simulate "$share/recipe.toml" -o "$share/truth" >/dev/null
"$refield" --quiet acquire run "$share/recipe.toml" --truth "$share/truth" -o "$share/rig_session" >/dev/null
cp "$share/rig_session/calibration.toml" "$share/calibration.toml"
cat >"$share/window.toml" <<'TOML'
[session]
output = "/run/session"
calibration = "calibration.toml"
reference_every = 0
preview = "/run/preview.png"
[camera]
device = "platform:vivid-000"
pixel_format = "GREY"
width = 320
height = 180
fps = 30
fixed_exposure = 0.01
[monitor]
window = true
width = 32
height = 24
[lights]
session = "truth"
[exposures]
seconds = [0.01]
TOML
