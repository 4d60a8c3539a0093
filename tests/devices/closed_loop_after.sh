#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: closed_loop_after.sh SHARE [RATIO]
# Both sessions estimated and compared on held-out lights with exact images: the laboratory's error must be at most RATIO
# (1.1) times the virtual rig's.
set -euo pipefail
share=$1
refield=$REFIELD_BUILD/cli/refield
for session in rig lab; do
  "$refield" --quiet estimate "$share/${session}_session" -o "$share/$session.rfield" >/dev/null
  "$refield" --json compare "$share/$session.rfield" "$share/${session}_session" \
    --truth "$share/truth/transport.rfield" >"$share/$session.json"
done
python3 - "$share" "${2:-1.1}" <<'PYTHON'
import json, sys

allowed = float(sys.argv[2])
figures = {name: json.load(open(f"{sys.argv[1]}/{name}.json"))["held_out"] for name in ("rig", "lab")}
good = True
for kind, rig in figures["rig"].items():
    for figure in ("median", "relative_rmse"):
        if not rig.get(figure):
            continue
        lab = figures["lab"][kind][figure]
        good = good and lab <= allowed * rig[figure]
        print(f"## held-out {kind}, {figure}: laboratory {lab:.4f}, virtual rig {rig[figure]:.4f}, "
              f"ratio {lab / rig[figure]:.3f}")
sys.exit(0 if good else f"the laboratory's error is more than {allowed} times the virtual rig's")
PYTHON
