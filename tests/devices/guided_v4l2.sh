# SPDX-License-Identifier: Apache-2.0
# In the guest: the guided capture with a V4L2 camera and a monitor without a desktop, in the virtual laboratory.
. "$REFIELD_SOURCE/tests/devices/lab.sh"
export LAB_SCREEN=1024x768  # what the guide chooses
load drm_kms_helper fbdev_emulation=0  # in that mode a text console would be taken for a pattern
start_lab /run/lab.log
v4l2-ctl -d "$(node vid-cap)" -c gain_automatic=0 -c gain=100  # that is a gain of 1 to the laboratory
mkdir -p /run/work /dev/pts
mount -t devpts devpts /dev/pts  # the terminal in which the answers are typed
export HOME=/run
time python3 -B "$REFIELD_SOURCE/tests/cli/guided_capture.py" "$refield" --rig v4l2 --work /run/work -- \
  --light-size 32x24 --set camera.pixel_format=RG12 --set camera.region=0,0,64,48 --level-step 51
