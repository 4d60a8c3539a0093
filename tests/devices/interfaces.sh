# SPDX-License-Identifier: Apache-2.0
# In the guest: the camera, monitor and trigger tests against the kernel's stock vivid, vkms and gpio-sim.
set -e
load() { modprobe -d "$LAB_MODULES" "$@"; }
load vivid n_devs=1 num_inputs=4 input_types=0xe4
load vkms enable_writeback=1
load gpio-sim
mount -t configfs config /sys/kernel/config
"$REFIELD_BUILD/cli/refield" acquire devices --json >/vmshare/devices.json
"$REFIELD_BUILD/tests/devices/test_devices" --gtest_color=no ${TEST_FILTER:+--gtest_filter="$TEST_FILTER"}
