#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: tbb_with_thread_sanitizer.sh FOLDER
# Builds oneTBB, the version that is installed, with the thread sanitizer, in FOLDER, unless it is there; prints the folder of
# the library, for LD_LIBRARY_PATH. What it does meanwhile goes to FOLDER/log.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$1"
cd "$1"
if ! library=$(find lib -name libtbb.so.12 2>/dev/null | grep .); then
  {
    "$here/debian_source.sh" libtbb-dev onetbb .
    cmake -S source -B lib -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DTBB_SANITIZE=thread -DTBB_TEST=OFF -DTBB_STRICT=OFF \
      -DTBBMALLOC_BUILD=OFF
    cmake --build lib --target tbb
  } >log 2>&1 || { cat log >&2; exit 1; }
  library=$(find lib -name libtbb.so.12)
fi
realpath "${library%/*}"
