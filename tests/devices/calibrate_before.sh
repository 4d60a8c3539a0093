#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: calibrate_before.sh SHARE
# The same scene, and the calibration that the virtual rig knows to be true.
set -euo pipefail
exec "$(dirname "${BASH_SOURCE[0]}")/closed_loop_before.sh" "$1" 2
