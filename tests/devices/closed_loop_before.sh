#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: closed_loop_before.sh SHARE [LIGHTS]
# The scene's exact transport, and the session that the virtual rig makes of it: the laboratory's is compared with that.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
share=$1
refield=$REFIELD_BUILD/cli/refield
cp "$here/lab_session.toml" "$share/session.toml"
sed "s/^train = .*/train = ${2:-480}/" "$here/lab_recipe.toml" >"$share/recipe.toml"
"$refield" --quiet simulate "$share/recipe.toml" -o "$share/truth" >/dev/null
"$refield" --quiet acquire virtual "$share/recipe.toml" --truth "$share/truth" -o "$share/rig_session" \
  --exposures 0.005,0.02 >/dev/null
cp "$share/rig_session/calibration.toml" "$share/calibration.toml"
