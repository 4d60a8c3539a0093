#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# `dev` waits while another program holds the package system's locks. apt-get, and what dev runs after it, are replaced
# by scripts that record what they were asked for.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/bin"
cp dev "$work/dev"
fake() {
  printf '#!/bin/bash\n%s\n' "$2" >"$work/bin/$1"
  chmod +x "$work/bin/$1"
}
fake dpkg-query 'exit 0'
fake sudo 'exec "$@"'
fake clang-format 'exit 0'
fake git 'exit 0'
# The lists are locked at the first call, dpkg at the first call of install.
fake apt-get "echo \"\$1\" >>'$work/calls'
if [[ ! -e '$work/'\$1 ]]; then
  touch '$work/'\$1
  echo 'E: Could not get lock /var/lib/'\$1'/lock. It is held by process 123 (apt-get)' >&2
  exit 100
fi"
fail() {
  printf 'dev_test: %s\n' "$*" >&2
  cat "$work/said" >&2
  exit 1
}
PATH=$work/bin:$PATH "$work/dev" format >"$work/said" 2>&1 || fail 'dev did not wait for the lock'
[[ $(tr '\n' ' ' <"$work/calls") == 'update update install install ' ]] || fail "apt-get was called for: $(cat "$work/calls")"
head -n 1 "$work/said" | grep -q 'Installing 1 Debian package.*minute.*clang-format' || fail 'the first line does not say what is to come'
grep -q 'Waiting for another program' "$work/said" || fail 'dev waited without a word'
# Any other failure ends it at once, with what apt-get said.
fake apt-get 'echo "E: Unable to locate package" >&2; exit 100'
if PATH=$work/bin:$PATH "$work/dev" format >"$work/said" 2>&1; then fail 'a failure of apt-get was passed over'; fi
grep -q 'E: Unable to locate package' "$work/said" || fail 'what apt-get said is lost'
