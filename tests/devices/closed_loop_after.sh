#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# usage: closed_loop_after.sh SHARE [RATIO]
# All sessions estimated and compared on held-out lights with exact images: the laboratory's error must be at most RATIO
# (1.1) times the largest of the virtual rig's. One capture of the rig is no bound: over 11 captures of lab_recipe.toml with
# 120 training images that differ in nothing but noise, the median errors spread by 15 % above and below their mean, the
# relative RMSE by 4 %.
set -euo pipefail
share=$1
refield=$REFIELD_BUILD/cli/refield
for session in "$share"/rig?_session "$share/lab_session"; do
  name=${session%_session}
  "$refield" --quiet estimate "$session" -o "$name.rfield" >/dev/null
  "$refield" --json compare "$name.rfield" "$session" --truth "$share/truth/transport.rfield" >"$name.json"
done
python3 - "$share" "${2:-1.1}" <<'PYTHON'
import json, pathlib, sys

share, allowed = pathlib.Path(sys.argv[1]), float(sys.argv[2])
rigs = [json.loads(file.read_text())["held_out"] for file in share.glob("rig?.json")]
lab = json.loads((share / "lab.json").read_text())["held_out"]
good = len(rigs) > 1
for kind in lab:
    for figure in ("median", "relative_rmse"):
        errors = [rig[kind][figure] for rig in rigs]
        if not all(errors):
            continue
        good = good and lab[kind][figure] <= allowed * max(errors)
        print(f"## held-out {kind}, {figure}: laboratory {lab[kind][figure]:.4f}, virtual rig "
              f"{min(errors):.4f} to {max(errors):.4f}")
sys.exit(0 if good else f"the laboratory's error is more than {allowed} times the virtual rig's")
PYTHON
