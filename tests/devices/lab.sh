# SPDX-License-Identifier: Apache-2.0
# In the guest, sourced: the virtual laboratory. The monitor is vkms, the camera vivid's, looped from its own output.
load() { modprobe -d "$LAB_MODULES" "$@"; }
refield=$REFIELD_BUILD/cli/refield

# node vid-cap|vid-out: of vivid; a camera that was unplugged may come back under another number.
node() { grep -lx "vivid-000-$1" /sys/class/video4linux/*/name | sed 's|.*/\(video[0-9]*\)/name|/dev/\1|'; }

# start_lab LOG [steady]: returns once the sensor exposes frames. "steady" as virtual_lab says.
start_lab() {
  lsmod | grep -q '^vivid ' ||
    load vivid_lab n_devs=1 node_types=0x101 num_inputs=1 input_types=3 num_outputs=1 output_types=1
  lsmod | grep -q '^vkms ' || load vkms enable_writeback=1
  local camera output
  camera=$(node vid-cap) output=$(node vid-out)
  v4l2-ctl -d "$output" --set-dv-bt-timings=index=0 >/dev/null
  v4l2-ctl -d "$camera" --set-dv-bt-timings=index=0 >/dev/null
  v4l2-ctl -d "$camera" -c loop_video=1,osd_text_mode=2,timestamp_source=1
  v4l2-ctl -d "$camera" --set-fmt-video=width=640,height=480,pixelformat=RG12
  "$REFIELD_BUILD/tests/devices/virtual_lab" /vmshare/truth /vmshare/recipe.toml /dev/dri/card0 "$output" "$camera" "$@" &
  lab=$!
  until [ -s "$1" ]; do
    kill -0 $lab || exit 1
    sleep 0.2
  done
}
