#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# examples_test.sh PROGRAMS SOURCE: the example of each public header runs, one after another, and no header is without one.
set -euo pipefail
programs=$1 source=$2
for header in "$source"/include/refield/*.h; do
  name=$(basename "$header" .h)
  [[ -x $programs/example_$name ]] || { echo "refield/$name.h has no example"; exit 1; }
done
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
run() {
  local name=$1
  shift
  "$programs/example_$name" "$@" >output || { echo "example_$name ended with status $?: $(cat output)"; exit 1; }
}
prints() { grep -q -- "$1" output || { echo "the example lacks '$1': $(cat output)"; exit 1; }; }
run image image.exr
run hdr
run light_map light.exr
prints '520x320@600,yaw=90: from -0.43 to 0.43'
run simulate "$source/datasets_synthetic/tabletop/recipe.toml" session
prints '[0-9] photographs of 32×24 pixels'
run session session
prints 'natural: 0\.'
run run_context session
prints 'estimate: done'
run estimate session scene.rfield
prints '[0-9] images, training error 0\.'
run field scene.rfield packed.rfield
prints 'lit by 16×12 texels'
[[ $(stat -c %s packed.rfield) -lt $(stat -c %s scene.rfield) ]] || { echo "the packed field is not smaller"; exit 1; }
run relight scene.rfield light.exr lit.exr sky.exr
[[ -s lit.exr && -s sky.exr && -s hour_3.png ]] || { echo "no pictures"; exit 1; }
prints 'the monitor covers [1-9][0-9]*\.'
run compare scene.rfield session
prints 'natural: relative RMSE 0\.0'
