# SPDX-License-Identifier: Apache-2.0
# In the guest: the camera, monitor and trigger tests against the kernel's stock vivid, vkms and gpio-sim; then a session
# whose monitor is a window on a desktop (Xvfb).
set -e
load() { modprobe -d "$LAB_MODULES" "$@"; }
refield=$REFIELD_BUILD/cli/refield
load vivid n_devs=1 num_inputs=4 input_types=0xe4
load vkms enable_writeback=1
load gpio-sim
mount -t configfs config /sys/kernel/config
"$REFIELD_BUILD/tests/devices/test_devices" --gtest_color=no ${TEST_FILTER:+--gtest_filter="$TEST_FILTER"}

mkdir -p /tmp/.X11-unix
# Mesa's renderer without a compiler: what that makes crashes in the emulated processor.
export LIBGL_ALWAYS_SOFTWARE=1 GALLIUM_DRIVER=softpipe DRAW_USE_LLVM=0
mkfifo /run/display
Xvfb -displayfd 3 -screen 0 320x240x24 -nolisten tcp -noreset 3>/run/display 2>/dev/null &
read -r DISPLAY </run/display
export DISPLAY=:$DISPLAY
"$refield" acquire devices --json >/vmshare/devices.json
grep -q '"width": 320' /vmshare/devices.json
"$refield" --quiet acquire run /vmshare/window.toml
[ "$(head -c 4 /run/preview.png | tail -c 3)" = PNG ]
echo "## a session with a window for a monitor: $(ls /run/session/observed | wc -l) photographs"
