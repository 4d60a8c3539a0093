#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: closed_loop_before.sh SHARE [LIGHTS CAPTURES]
# The scene's exact transport, and the sessions that the virtual rig makes of it: the laboratory's is compared with those.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
share=$1
cp "$here/lab_session.toml" "$share/rig.toml"
sed "s/^train = .*/train = ${2:-90}/" "$here/lab_recipe.toml" >"$share/recipe.toml"
"$here/virtual_rig.sh" "$share" "${3:-5}" --exposures 0.005,0.02
