#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: virtual_rig.sh SHARE CAPTURES OPTIONS...
# The exact transport of the scene SHARE/recipe.toml, and what a laboratory's session is compared with: captures of it
# by the virtual rig (OPTIONS: of 'acquire run'), rig1_session and so on, that differ in their noise alone.
set -euo pipefail
share=$1 captures=$2
shift 2
refield=$REFIELD_BUILD/cli/refield
"$refield" --quiet simulate "$share/recipe.toml" -o "$share/truth" >/dev/null
for seed in $(seq "$captures"); do
  sed "s/^seed = .*/seed = $seed/" "$share/recipe.toml" >"$share/rig$seed.toml"
  "$refield" --quiet acquire run "$share/rig$seed.toml" --truth "$share/truth" -o "$share/rig${seed}_session" \
    "$@" >/dev/null
done
cp "$share/rig1_session/calibration.toml" "$share/calibration.toml"
