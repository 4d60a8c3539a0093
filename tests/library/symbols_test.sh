#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# symbols_test.sh LIBRARY [USER]...: librefield.so exports the public interface alone, and its users, such as the Python
# module, use nothing else and contain nothing of it.
set -euo pipefail
fail() {
  printf '%s\n' "$@"
  exit 1
}
library=$1
shift
soname=$(objdump -p "$library" | sed -n 's/^ *SONAME *//p')
version=${soname#librefield.so.}
public="refield::v${version//./_}::"
exported=$(nm -D --defined-only --demangle "$library")
count=$(grep -c "$public" <<<"$exported")
((count > 50)) || fail "$soname exports $count symbols of $public"
others=$(grep -v "$public" <<<"$exported" || true)
[[ -z $others ]] || fail "$soname exports more than $public" "$others"
for user in "$@"; do
  undefined=$(nm -D --undefined-only --demangle "$user" | grep 'refield::' || true)
  [[ -n $undefined ]] || fail "$user uses nothing of $soname"
  ! grep -v "$public" <<<"$undefined" || fail "$user uses what is not public"
  # What it contains itself: its own code, and what the headers define.
  internal=$(nm --defined-only --demangle "$user" | grep -E ' [TtWwVvBbDdRr] (typeinfo for |vtable for )?refield::' |
    grep -v -e "$public" -e refield::python:: || true)
  [[ -z $internal ]] || fail "$user contains internals:" "$internal"
  needed=$(objdump -p "$user" | sed -n 's/^ *NEEDED *//p')
  grep -qx "$soname" <<<"$needed" || fail "$user does not need $soname"
  ! grep -E 'tbb|hdf5|embree|OpenEXR|OpenImageIO|assimp|opencv' <<<"$needed" || fail "$user links libraries of $soname"
done
