#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: genicam.sh BUILD [PATTERNS EXPOSURES RATIO]
# A session with a GenICam camera in a closed loop with a virtual monitor (genicam_lab.cpp); every raw frame must show its
# own pattern, and the error on held-out lights must be that of the virtual rig within RATIO.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(realpath "$1") patterns=${2:-150} exposures=${3:-0.001,0.003} ratio=${4:-1.1}
export REFIELD_BUILD=$build
share=$build/../devices/share_genicam
rm -rf "$share"
mkdir -p "$share"
share=$(realpath "$share")
# Exposures are a fifth of those of the other laboratory, and the light is five times as bright.
sed "s/^train = .*/train = $((patterns - 30))/; s/^sensitivity = .*/sensitivity = 4e7/" "$here/lab_recipe.toml" >"$share/recipe.toml"
"$here/virtual_rig.sh" "$share" 5 --exposures "$exposures"
"$build/tests/devices/genicam_lab" "$share" >"$share/log" 2>&1 || { cat "$share/log" >&2; exit 1; }
grep '^##' "$share/log"
"$build/tests/devices/check_pairs" "$share/session" "$share/truth/illumination" "$share"/camera_*.log
mv "$share/session" "$share/lab_session"
"$here/closed_loop_after.sh" "$share" "$ratio"
