#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: quick_v4l2_after.sh SHARE
# The errors of the quick capture that the guest took, and relit pictures.
set -euo pipefail
"$(dirname "${BASH_SOURCE[0]}")/quick_capture.sh" "$REFIELD_BUILD/cli/refield" "$1" estimate
