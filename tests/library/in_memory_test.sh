#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# in_memory_test.sh PROGRAM: the program succeeds in an empty folder, writes nothing to standard error and
# leaves no file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/work"
cd "$folder/work"
HOME=$PWD TMPDIR=$PWD "$1" 2>"$folder/stderr"
[[ ! -s $folder/stderr ]] || { echo "standard error: $(cat "$folder/stderr")"; exit 1; }
[[ -z $(ls -A) ]] || { echo "files were left: $(ls -A)"; exit 1; }
