# SPDX-License-Identifier: Apache-2.0
# In the guest: one session in the virtual laboratory, struck by every fault in turn and resumed each time. Says what
# happened and what was lost; in the end every frame must show its own light, and the session must equal, to the byte, one
# that nothing happened to.
. "$REFIELD_SOURCE/tests/devices/lab.sh"
load gpio-sim
mount -t configfs config /sys/kernel/config
mkdir -p /sys/kernel/config/gpio-sim/lab/bank /run/disk
echo 8 >/sys/kernel/config/gpio-sim/lab/bank/num_lines
gpio() { echo "$1" >/sys/kernel/config/gpio-sim/lab/live; }
pull() { echo "$1" >"$(echo /sys/devices/platform/gpio-sim.0/gpiochip*/sim_gpio2/pull)"; }
gpio 1
pull pull-up
mount -t tmpfs -o size=48m disk /run/disk
sed 's|/run/session|/run/disk/session|' /vmshare/rig.toml >/vmshare/faults.toml
sed 's|/run/session|/run/disk/undisturbed|' /vmshare/rig.toml >/vmshare/undisturbed.toml
session=/run/disk/session
number=0
new_lab() { number=$((number + 1)); start_lab "/run/lab$number.log" steady; }
taken() { ls "$session/observed" 2>/dev/null | grep -c exr; }
vivid() { v4l2-ctl -d "$(node vid-cap)" -c "$1=${2:-1}"; }
# Photographs that were finished at the last look and have been taken anew since.
: >/run/before
lost() {
  (cd $session/observed 2>/dev/null && stat -c '%n %y' *.exr 2>/dev/null) | sort >/run/now
  local count=$(comm -23 /run/before /run/now | wc -l)
  mv /run/now /run/before
  lost_of_all=$((lost_of_all + count))
  ((count <= 1)) || complain "$count finished photographs were taken anew"
}
lost_of_all=0

start() {
  "$refield" --quiet acquire run /vmshare/faults.toml --resume >/run/out 2>&1 &
  run=$!
}
# Until the session has grown by as many photographs or the program has ended.
grow() {
  local goal=$(($(taken) + $1)) i
  for i in $(seq 600); do
    (($(taken) < goal)) && kill -0 $run 2>/dev/null || return 0
    sleep 0.2
  done
}
# The laboratory borrows the display from the program, and must have noticed its end before the next one begins.
let_go() {
  while ls -l /proc/$lab/fd 2>/dev/null | grep -q /dev/dri/; do sleep 0.1; done
}
complain() { echo "## FAILED: $*"; cat /run/out; failed=1; }
failed=0
# after FAULT EXPECTED_STATUS: how the program ended, and how many photographs there are.
after() {
  wait $run
  local status=$?
  let_go
  lost
  echo "## $1: status $status, $(taken) photographs; $(grep -a refield: /run/out | tail -n 1 | cut -c1-180)"
  ((status == $2)) || complain "$1: ended with $status in place of $2"
}
# survives FAULT: the program goes on by itself.
survives() {
  local before=$(taken)
  grow 2
  lost
  kill -0 $run 2>/dev/null || { complain "$1: the program ended"; let_go; start; }
  echo "## $1: went on, $before to $(taken) photographs; $(grep -a refield: /run/out | tail -n 1 | cut -c1-180)"
}

# The camera's driver goes and comes back, and a new laboratory with it. The program stands still meanwhile: it would
# take the camera as soon as it is there, and no laboratory could set it up any more.
unbind() {
  local driver=/sys/bus/platform/drivers/vivid
  kill -STOP $run
  kill $lab
  wait $lab 2>/dev/null
  echo vivid.0 >$driver/unbind
  sleep 1
  echo vivid.0 >$driver/bind
  new_lab
  kill -CONT $run
}

new_lab
time "$refield" --quiet acquire run /vmshare/undisturbed.toml || exit 1
for fault in inject_vidioc_reqbufs_error inject_vidioc_streamon_error; do
  vivid $fault
  start
  after "$fault" 2
done
start
grow 2
for fault in inject_v4l2_buf_flag_error inject_vidioc_qbuf_error inject_fatal_streaming_error; do
  vivid $fault
  survives $fault
done
vivid percentage_of_dropped_buffers 30
survives "30 % of the buffers dropped"
vivid percentage_of_dropped_buffers 0
date -s '+1 hour' >/dev/null
survives "clock set an hour ahead"
vivid dv_timings_signal_mode 1
after "no signal" 2
vivid dv_timings_signal_mode 0
vivid wrap_sequence_number 1
start
survives "numbers that wrap at 2^32"
echo off >/sys/class/drm/card0-Virtual-1/status
after "monitor unplugged" 2
echo on >/sys/class/drm/card0-Virtual-1/status
start
grow 1
pull pull-down
after "camera never ready (GPIO time-out)" 2
pull pull-up
start
grow 1
gpio 0
after "GPIO chip unplugged" 2
gpio 1
pull pull-up
start
grow 1
kill -9 $run
after "kill -9" 137
start
grow 1
dd if=/dev/zero of=/run/disk/full bs=64k 2>/dev/null
after "disk full" 2
start
after "disk still full" 2
rm /run/disk/full
start
grow 1
vivid disconnect
survives "camera disconnected and back"
unbind
survives "driver unbound and bound again"
after "to the end" 0
kill $lab
"$REFIELD_BUILD/tests/devices/check_pairs" $session /vmshare/truth/illumination /run/lab*.log || failed=1
echo "## finished photographs that had to be taken again, in all: $lost_of_all"
if diff -rq /run/disk/undisturbed $session; then
  echo "## the session equals the undisturbed one in every file ($(find $session -type f | wc -l) files)"
else
  complain "the session differs from the undisturbed one"
fi
"$refield" info $session | head -n 5
exit $failed
