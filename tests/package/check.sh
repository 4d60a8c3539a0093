#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# check.sh FOLDER: lintian on the folder's packages; ends with status 1 for errors, prints warnings.
set -euo pipefail
cd "$1"
tags=$(lintian --allow-root --tag-display-limit 0 ./*.deb 2>&1) || true
# The packages are for users of the source, not for an upload: their change log closes no bug of Debian.
tags=$(grep -v 'initial-upload-closes-no-bugs' <<<"$tags" || true)
[[ -z $tags ]] || printf '%s\n' "$tags"
! grep -q '^E:' <<<"$tags"
