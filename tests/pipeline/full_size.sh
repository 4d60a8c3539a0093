#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The paper's size: 1024×768 pixels, 180 lights of 800×600, 25 kernels, out of core within 4 GiB. Prints time, memory and
# held-out error of each step; fails when a step fails or memory is exceeded. Takes about half an hour on two cores and
# 4 GB of disk.
#   tests/pipeline/full_size.sh [REFIELD [FOLDER]]
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
refield=${1:-$root/build/release/cli/refield}
folder=${2:-$root/out/full_size}

rm -rf "$folder"
mkdir -p "$folder"
"$refield" simulate "$root/datasets_synthetic/tabletop/recipe.toml" -o "$folder/capture" \
  --size 1024x768 --light-size 800x600 --half
"$refield" estimate "$folder/capture" -o "$folder/refined.rfield" --memory 4 --json | tee "$folder/estimate.json"
# Resident memory as the kernel saw it, against the limit of 4 GiB.
peak=$(sed -n 's/.*"peak_memory_bytes": \([0-9]*\).*/\1/p' "$folder/estimate.json")
if ((peak > 4 * 1024 ** 3)); then
  echo "full_size: peak memory $peak bytes exceeds 4 GiB" >&2
  exit 1
fi
"$refield" compare "$folder/refined.rfield" "$folder/capture"
