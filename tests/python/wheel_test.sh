#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# wheel_test.sh PYTHON: pip installs the module into a virtual environment, without a network.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$1" -m venv --system-site-packages "$folder/environment"
"$folder/environment/bin/pip" install --quiet --no-build-isolation --no-index --no-deps .
cd "$folder"
PYTHONPATH='' environment/bin/python - "$folder" <<'END'
import sys
import numpy as np
import refield
assert refield.__file__.startswith(sys.argv[1]), refield.__file__
light = np.random.default_rng(1).random((12, 4, 4, 3), dtype=np.float32)
assert refield.estimate(light, light).shape == (4, 4, 3)
END
"$folder/environment/bin/pip" uninstall --quiet --yes refield
! "$folder/environment/bin/python" -c 'import refield' 2>/dev/null
