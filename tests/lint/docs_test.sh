#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# check_links.py and check_words.py find what they look for, in a repository of their own.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/tests/lint"
cp check_links.py check_words.py words.tsv "$work/tests/lint"
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
  if tests/lint/$script >.git/said 2>&1; then fail "$script found nothing"; fi
  for text in "$@"; do grep -qF -- "$text" .git/said || fail "$script did not say: $text"; done
  [[ $(wc -l <.git/said) -eq $# ]] || fail "$script said something else, too"
}
printf '# Title\n\n[a](#title) [b](#other) [c](gone.md) `[d](gone.md)` an area lamp, .5 of it, `lamp`\n' >README.md
printf '\n    a lamp in code\n\n%0111d\n' 0 >>README.md
printf '// docs/%s.md; int most_rows, clamp;  // a hare shared\nint lamp;  // words: exempt\n' gone >a.cpp
expect check_links.py 'README.md:3: links to #other' 'README.md:3: links to gone.md' 'a.cpp:1: names docs/'gone.md
sed -i 's/#other/#title/; s/gone.md/README.md/' README.md
expect "check_words.py a.cpp" "README.md:3: 'lamp'" "README.md:3: '.5'" 'README.md:7: has 111' "a.cpp:1: 'most_rows'" "a.cpp:1: 'hare'"
sed -i 's/lamp,/light,/; s/ \.5/ 0.5/; /^0/d' README.md
printf 'int max_rows;\n' >a.cpp
tests/lint/check_words.py a.cpp >.git/said 2>&1 || fail 'check_words.py complained without a reason'
tests/lint/check_links.py >.git/said 2>&1 || fail 'check_links.py complained without a reason'
