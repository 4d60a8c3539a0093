#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Default pictures of five kinds of field under environment maps, as one PNG to look at, and a table: the share of pixels
# that show light and are clipped in some channel, and the mean of the encoded picture. Fails where more than 1 % are
# clipped or the mean is below 0.1. The fields are made once and kept in FOLDER; about five minutes on two cores.
#   tests/pipeline/contact_sheet.sh REFIELD FOLDER MAP...        needs oiiotool (Debian: openimageio-tools)
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
(($# >= 3)) || { sed -n '/^#   /s/^# *//p' "${BASH_SOURCE[0]}" >&2; exit 2; }
refield=$1 folder=$2
shift 2
recipe=$root/datasets_synthetic/tabletop/recipe.toml
prt=$root/datasets_synthetic/prt
mkdir -p "$folder"

# make FIELD COMMAND...: runs the command, which writes FIELD, unless it is there.
make() {
  local field=$folder/$1
  shift
  [[ -f $field ]] || "$@" >&2
}
demo() {
  "$refield" simulate "$recipe" -o "$folder/truth"
  "$refield" acquire run "$recipe" --truth "$folder/truth" --force -o "$folder/session"
  "$refield" estimate "$folder/session" -o "$folder/demo.rfield"
}
calibrated() {
  local small=(--size 96x72 --train 120)
  "$refield" simulate "$recipe" "${small[@]}" -o "$folder/small"
  "$refield" acquire calibrate "$recipe" --truth "$folder/small" --force -o "$folder/calibration.toml"
  "$refield" acquire run "$recipe" --truth "$folder/small" --calibration "$folder/calibration.toml" --max-noise 2% \
    --force -o "$folder/calibrated"
  "$refield" estimate "$folder/calibrated" -o "$folder/calibrated.rfield"
}
make demo.rfield demo
make calibrated.rfield calibrated
make clusters.rfield "$refield" precompute "$prt/small.toml" --resolution 64 -o "$folder/clusters.rfield"
make harmonics.rfield "$refield" precompute "$prt/glossy.toml" --method sh -o "$folder/harmonics.rfield"
make glossy.rfield "$refield" precompute "$prt/glossy.toml" --image --resolution 64 -o "$folder/glossy.rfield"

status=0
sheet=()
printf '%-12s %-24s %9s %6s\n' field map 'clipped' 'mean'
for field in demo calibrated clusters harmonics glossy; do
  turn=()
  # The table-top's monitor stands at the right, and is a window onto what lies there.
  case $field in demo | calibrated) turn=(--yaw 90) ;; esac
  for map in "$@"; do
    name=$(basename "${map%.*}")
    picture=$folder/$field-$name.png
    "$refield" --quiet relight "$folder/$field.rfield" --env "$map" "${turn[@]}" -o "$picture" >/dev/null
    read -r black white < <(oiiotool "$picture" --ch R,G,B --maxchan --colorcount:eps=0.001 0:1 | awk '{print $1}' | xargs)
    read -r pixels mean < <(oiiotool --stats -v "$picture" | awk '
      / x .*channel/ {pixels = $3 * $5} /Stats Avg/ {mean = ($3 + $4 + $5) / 765} END {print pixels, mean}')
    awk -v f="$field" -v m="$name" -v b="$black" -v w="$white" -v p="$pixels" -v mean="$mean" 'BEGIN {
      clipped = w / (p - b)
      bad = clipped > 0.01 || mean < 0.1
      printf "%-12s %-24s %7.2f %% %6.3f%s\n", f, m, 100 * clipped, mean, bad ? "  <-" : ""
      exit bad}' || status=1
    sheet+=("$picture")
  done
done
oiiotool "${sheet[@]}" --mosaic:fit=320x240:pad=4 "$#x5" -o "$folder/contact-sheet.png"
echo "$folder/contact-sheet.png"
exit "$status"
