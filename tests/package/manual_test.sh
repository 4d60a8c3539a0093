#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# manual_test.sh FOLDER PROGRAM: the man pages say all that --help-all says, and completion knows the commands.
set -euo pipefail
folder=$(realpath "$1") program=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
fail() {
  printf 'manual_test: %s\n' "$*" >&2
  exit 1
}
# One word a line, without the markup of man pages and without what stands beside an option's name in --help.
words() { sed -E 's/\\f[BIR]//g; s/\\-/-/g; s/\\e/\\/g; s/\\&//g; s/^\.[A-Z]+//' | tr -s ' ,|":' '\n' | grep -v -x -E '\.\.\.|'; }
count=0
for page in "$folder"/man/refield*.1.gz; do
  name=${page##*/refield} name=${name%.1.gz}
  case $name in  # a dash separates commands, but for this one
    -export-web) verb=export-web ;;
    *) verb=${name//-/ } ;;
  esac
  zcat "$page" | words | sed "s/^refield$name-\([a-z-]*\)(1)/\1/" | sort -u >page
  # shellcheck disable=SC2086  # words
  "$program" $verb --help-all | sed -E 's/^(Usage|Arguments|Commands|Options|Exit status|Capture|Estimate|Relight|Examine|Simulate)://' |
    words | sort -u >help
  lacking=$(comm -13 page help | grep -v -x -E 'FLOAT|INT|TEXT' || true)
  [[ -z $lacking ]] || fail "${page##*/} lacks of --help: $lacking"
  count=$((count + 1))
done
((count > 20)) || fail "there are $count man pages"
if command -v man >/dev/null; then
  warnings=$(LC_ALL=C.UTF-8 MANROFFSEQ="" MANWIDTH=80 man --warnings -E UTF-8 -l -Tutf8 -Z "$folder"/man/*.gz 2>&1 >/dev/null)
  [[ -z $warnings ]] || fail "$warnings"
fi

# shellcheck disable=SC1091
. "$folder/refield.bash"
# completes WORDS... = COMPLETIONS: of the last word.
completes() {
  local expected=${*##*= }
  COMP_WORDS=(refield)
  while [[ $1 != = ]]; do COMP_WORDS+=("$1"); shift; done
  shift
  expected=$*
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  _refield || true  # compgen says that nothing was found
  [[ ${COMPREPLY[*]} == "$expected" ]] || fail "'${COMP_WORDS[*]}' is completed to '${COMPREPLY[*]}', not '$expected'"
}
completes e = estimate export-web
completes acquire i = import
completes relight scene.rfield --ro = --rotate --roll
completes relight scene.rfield --format '' = exr png glb
completes relight --format p = png
completes estimate --light '' =
completes estimate sess =
completes precompute --met = --method
completes info --js = --json
if command -v zsh >/dev/null; then zsh -n "$folder/_refield" || fail "zsh cannot read _refield"; fi
