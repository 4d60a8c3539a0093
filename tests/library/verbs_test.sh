#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# verbs_test.sh OBJECT...: the verbs in these object files use the public interface of refield and the named helpers of the
# command line, and of refield nothing else.
set -euo pipefail
helpers='json_from_text\(|run_context\(\)|expand_globs\(|require_not_an_input\(|report::write_report(\[abi:cxx11\])?\('
helpers+='|cli::(add_(capture|exposure|fps|placement)_options?|held_out_figures(\[abi:cxx11\])?|non_negative_number|open_capture'
helpers+='|print_(errors|exposures|json)|read_picture_size|reserve_output|write_json|warn_of_(clipping|unobserved_light))\('
symbols() { nm --"$1"-only --demangle "${@:2}" | sed -E 's/^[0-9a-f ]*[A-Za-z] //' | grep refield | sort -u; }
used=$(comm -23 <(symbols undefined "$@") <(symbols defined "$@"))
count=$(grep -c 'refield::v[0-9_]*::' <<<"$used")
((count >= 4)) || { echo "the verbs use $count symbols of the public interface"; exit 1; }
others=$(grep -vE "^(typeinfo for |vtable for )?refield::(v[0-9_]+::|$helpers)" <<<"$used" || true)
[[ -z $others ]] || { printf '%s\n' 'the verbs use what is neither public nor a named helper:' "$others"; exit 1; }
