# SPDX-License-Identifier: Apache-2.0
# In the guest: a whole session in the virtual laboratory, every frame's pattern checked.
. "$REFIELD_SOURCE/tests/devices/lab.sh"
start_lab /run/lab.log
time "$refield" --quiet acquire run /vmshare/rig.toml || exit 1
kill $lab || exit 1  # it must have lived to the end
"$REFIELD_BUILD/tests/devices/check_pairs" /run/session /vmshare/truth/illumination /run/lab.log
status=$?
cp -r /run/session /vmshare/lab_session
exit $status
