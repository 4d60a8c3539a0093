#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: guided_v4l2_before.sh SHARE
# The exact transport of the scene that the virtual laboratory's camera sees.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
sed "s/^train = .*/train = 1/; s/^natural = .*/natural = 1/; s/^bars = .*/bars = 0/; s/^squares = .*/squares = 0/" \
  "$here/lab_recipe.toml" >"$1/recipe.toml"
"$REFIELD_BUILD/cli/refield" --quiet simulate "$1/recipe.toml" -o "$1/truth" >/dev/null
