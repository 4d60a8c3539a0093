#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: faults_before.sh SHARE
# A small scene of 56 lights, photographed once by the virtual rig for its calibration.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
"$here/closed_loop_before.sh" "$1" 24 1
cat >>"$1/rig.toml" <<'TOML'
[trigger]
chip = "gpio-sim.0-node0"
line = 1
ready_line = 2
timeout = 2
TOML
