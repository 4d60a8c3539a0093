#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# check_links.py, check_words.py, check_messages.py and bench/studies/figures.py find what they look for, in a repository of their own.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/tests/lint" "$work/docs/guide" "$work/core"
cp check_links.py check_words.py check_messages.py words.tsv "$work/tests/lint"
mkdir -p "$work/bench/studies"
cp ../../bench/studies/figures.py "$work/bench/studies"
touch "$work/docs/guide/troubleshooting.md"
cd "$work"
git init -q
fail() {
  printf 'docs_test: %s\n' "$*" >&2
  cat .git/said >&2
  exit 1
}
# expect COMMAND TEXT...: it ends with status 1 and one line per TEXT, which contains it.
expect() {
  local script=$1 text
  shift
  if $script >.git/said 2>&1; then fail "$script found nothing"; fi
  for text in "$@"; do grep -qF -- "$text" .git/said || fail "$script did not say: $text"; done
  [[ $(wc -l <.git/said) -eq $# ]] || fail "$script said something else, too"
}
printf '# Title\n\n[a](#title) [b](#other) [c](gone.md) `[d](gone.md)` an area lamp, .5 of it, `lamp` `core/*.sh`\n' >README.md
printf '\n    a lamp in code\n\n%0111d\n' 0 >>README.md
printf '// docs/%s.md; int most_rows, clamp;  // a hare shared\nint lamp;  // words: exempt\n' gone >a.cpp
expect tests/lint/check_links.py 'README.md:3: links to #other' 'README.md:3: links to gone.md' \
  'README.md:3: names core/*.sh' 'a.cpp:1: names docs/'gone.md
sed -i 's/#other/#title/; s/gone.md/README.md/; s/ `core.*//' README.md
expect "tests/lint/check_words.py a.cpp" "README.md:3: 'lamp'" "README.md:3: '.5'" 'README.md:7: has 111' "a.cpp:1: 'most_rows'" "a.cpp:1: 'hare'"
sed -i 's/lamp,/light,/; s/ \.5/ 0.5/; /^0/d' README.md
printf 'int max_rows;\n' >a.cpp
tests/lint/check_words.py a.cpp >.git/said 2>&1 || fail 'check_words.py complained without a reason'
tests/lint/check_links.py >.git/said 2>&1 || fail 'check_links.py complained without a reason'

# A message that the index lacks, one that it has, and an entry that no source has.
printf 'throw InputError("left out " + name + " of the index"); fail("found by its words");\n' >core/b.cpp
printf -- '- *by its … words* — found\n- *in no source* — stale\n' >docs/guide/troubleshooting.md
expect tests/lint/check_messages.py 'core/b.cpp:1' 'no message has the words: in no source'
printf -- '- *by its words*, *left out … index* — found\n' >docs/guide/troubleshooting.md
tests/lint/check_messages.py >.git/said 2>&1 || fail 'check_messages.py complained without a reason'

# Figures: a wrong number, an unknown name, a figure that no page states; fill writes the values.
printf '[a]\nb = "0.5"\nlist = ["1:30", "4e-4"]\nunused = "7"\n' >docs/figures.toml
printf '# Title\n\n3 are 0.4 <!-- a.b -->, 2:00 and 4e-4 <!-- a.list --> 1 <!-- a.none -->\n' >README.md
expect 'bench/studies/figures.py check' 'a.b is 0.4; docs/figures.toml says 0.5' 'a.list is 2:00' 'no figure a.none' 'states a.unused'
sed -i '/unused/d' docs/figures.toml
sed -i 's/ 1 <!-- a.none -->//' README.md
bench/studies/figures.py fill >.git/said 2>&1 || fail 'figures.py does not fill'
grep -qF '3 are 0.5 <!-- a.b -->, 1:30 and 4e-4 <!-- a.list -->' README.md || fail 'figures.py filled something else'
