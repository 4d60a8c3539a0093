# SPDX-License-Identifier: Apache-2.0
# In the guest, sourced: the virtual laboratory. The monitor is vkms, the camera vivid's, looped from its own output.
load() { modprobe -d "$LAB_MODULES" "$@"; }
refield=$REFIELD_BUILD/cli/refield

# start_lab LOG: returns once the sensor exposes frames.
start_lab() {
  lsmod | grep -q '^vivid ' ||
    load vivid_lab n_devs=1 node_types=0x101 num_inputs=1 input_types=3 num_outputs=1 output_types=1
  lsmod | grep -q '^vkms ' || load vkms enable_writeback=1
  v4l2-ctl -d1 --set-dv-bt-timings=index=0 >/dev/null
  v4l2-ctl -d0 --set-dv-bt-timings=index=0 >/dev/null
  v4l2-ctl -d0 -c loop_video=1,osd_text_mode=2,timestamp_source=1
  v4l2-ctl -d0 --set-fmt-video=width=640,height=480,pixelformat=RG12
  "$REFIELD_BUILD/tests/devices/virtual_lab" /vmshare/truth /vmshare/recipe.toml /dev/dri/card0 /dev/video1 /dev/video0 \
    "$1" &
  lab=$!
  until [ -s "$1" ]; do
    kill -0 $lab || exit 1
    sleep 0.2
  done
}
