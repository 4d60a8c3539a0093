# SPDX-License-Identifier: Apache-2.0
# In the guest: a quick capture with a V4L2 camera and a monitor without a desktop, in the virtual laboratory.
. "$REFIELD_SOURCE/tests/devices/lab.sh"
load drm_kms_helper fbdev_emulation=0  # a text console would be taken for a pattern
start_lab /run/lab.log
v4l2-ctl -d "$(node vid-cap)" -c gain_automatic=0 -c gain=100  # that is a gain of 1 to the laboratory
mkdir /run/quick
cp -r /vmshare/recipe.toml /vmshare/truth /run/quick
HOME=/run "$REFIELD_SOURCE/tests/devices/quick_capture.sh" "$refield" /run/quick v4l2
status=$?
cp -r /run/quick/session /run/quick/lights /vmshare
exit $status
