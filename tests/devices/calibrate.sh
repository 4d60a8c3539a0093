# SPDX-License-Identifier: Apache-2.0
# In the guest: camera and monitor of the virtual laboratory are calibrated by 'refield acquire calibrate'.
. "$REFIELD_SOURCE/tests/devices/lab.sh"
start_lab /run/lab.log
time "$refield" --json acquire calibrate /vmshare/session.toml -o /vmshare/measured.toml >/vmshare/measured.json
status=$?
kill $lab
echo "## 'acquire calibrate' ended with status $status"
exit $status
