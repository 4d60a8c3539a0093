#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Rules that no compiler checks: a licence line on every source, who includes whom, links, words, figures and messages
# of documents.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
status=0
complain() {
  printf '%s\n' "$*" >&2
  status=1
}
sources() { git ls-files --cached --others --exclude-standard --deduplicate -- "$@"; }

# The first line, or the second after a #! line.
for file in $(sources '*.h' '*.cpp' '*.cmake' '*CMakeLists.txt' '*.toml' '*.sh' '*.py' dev .ci/run .clang-tidy); do
  [[ -f $file ]] || continue
  head -n 2 "$file" | grep -q 'SPDX-License-Identifier: Apache-2.0' || complain "$file: has no SPDX licence line"
done

# check_includes FOLDER PATTERN: the project's own headers that sources in FOLDER may include.
check_includes() {
  local folder=$1 allowed=$2 found
  found=$(sources "$folder/*.h" "$folder/*.cpp" | xargs -r grep -nE '^#include "' | grep -vE "#include \"($allowed)" || true)
  [[ -z $found ]] || complain "$folder may include only $allowed:
$found"
}
check_includes core '(core|refield)/'
check_includes include 'refield/'
check_includes python 'refield/|binding\.h"'
check_includes acquire '(core|acquire|refield)/'
check_includes estimate '(core|estimate|refield)/'
check_includes relight '(core|relight|refield)/'
check_includes simulate '(core|simulate|refield)/|acquire/(camera|illuminator|trigger)\.h"'

# Headers of other libraries stay in .cpp files, so that no stage's users depend on them.
found=$(sources {core,acquire,estimate,include,relight,simulate}/'*.h' |
  xargs -r grep -nE '#include <(embree|opencv|hdf5|H5|OpenImageIO|OpenEXR|toml|linux|arv|libdrm|gpiod|xf86drm)' || true)
[[ -z $found ]] || complain "third-party headers belong in .cpp files:
$found"

tests/lint/check_includes.py || status=1
tests/lint/check_links.py || status=1
tests/lint/check_messages.py || status=1
bench/studies/figures.py check || status=1
tests/lint/check_words.py {core,acquire,estimate,include,library,relight,simulate,cli,bench,python}/'*'.{h,cpp} tests/'*'.{h,cpp} || status=1

# What a library must leave to its caller: standard error, signals, forks of processes with threads. Progress,
# notes and stopping go through RunContext (core/base/run_context.h).
found=$(sources {core,acquire,estimate,library,relight,simulate}/'*.h' {core,acquire,estimate,library,relight,simulate}/'*.cpp' |
  xargs -r grep -nE '\bstderr\b|STDERR_FILENO|std::(cerr|clog)|\bsigaction\(|\bv?fork\(' |
  grep -v posix_spawn_file_actions || true)
[[ -z $found ]] || complain "library code reports through RunContext, not to standard error, and handles no signal:
$found"

exit $status
