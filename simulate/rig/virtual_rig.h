// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/camera.h"
#include "acquire/illuminator.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "simulate/rig/device_models.h"
#include "simulate/tabletop/simulate.h"

namespace refield {

/// A camera, a monitor and a trigger line in front of a scene whose light transport is known: what a capture
/// runs on where there is no hardware.
///
/// Time is simulated: it starts at zero and passes only inside show(), fire() and next_frame(). The camera is
/// genlocked: a free-running exposure starts half a refresh interval after a refresh. So the phase between
/// flips and frames is always the same, whatever was shown before: show() waits for the frame in progress.
///
/// A frame integrates the light during its exposure. Until `latency` after a flip that is the previous
/// pattern, during `settling` a mix. Frames leave through a queue of `latency_frames`: the first ones read
/// after a flip were exposed before it. A careful capture tells by RawFrame::exposure_start.
///
/// Settings act after the sensor's control latency; until then frames state the settings that were asked for,
/// as drivers do. A backlight whose pulses are no whole number in a refresh interval makes photographs depend
/// on when they were taken.
///
/// The noise of a settled frame depends on the seed, the pattern shown, exposure, gain and how many frames
/// were taken with these settings since the pattern appeared, and on nothing else: a capture that was killed
/// and goes on takes the photographs that it would have taken. It follows that a pattern shown again gives
/// the same noise again, unless set_place() says that it is a repetition.
class VirtualRig {
 public:
  /// `transport` stands for what a camera pixel sees of the monitor's light (by primaries: the sensor's
  /// colour mixing stands for the field's), `ambient` [height × width × 3]
  /// for what it sees with the monitor unplugged (empty: a dark room). Throws InputError for shapes that do
  /// not fit together.
  VirtualRig(ReflectanceField transport, Image ambient, MonitorModel monitor, SensorModel sensor,
             std::uint64_t seed);
  ~VirtualRig();
  VirtualRig(VirtualRig&&) noexcept;
  VirtualRig& operator=(VirtualRig&&) noexcept;

  Camera& camera();
  Illuminator& illuminator();
  Trigger& trigger();

  /// From now on the share `done` (0 to 1) of the capture is over, by which the monitor drifts, and patterns
  /// shown are shown for the `repetition`-th time (from 0), with noise of its own. Time in the rig starts
  /// anew with each run, so a capture that was stopped and goes on must say where it is.
  void set_place(double done, std::uint32_t repetition);

  /// `scene_at` traces the scene for a position of the camera. The first frame after the camera has moved
  /// calls it: every photograph is rendered, none is interpolated. Frames in the queue are of the new
  /// position, too.
  void disturb(Disturbances disturbances,
               std::function<TracedScene(const Disturbances::Move&)> scene_at = {});

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
