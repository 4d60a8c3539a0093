// SPDX-License-Identifier: Apache-2.0
#include "tests/acquire/fake_rig.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "core/base/errors.h"

namespace refield::test {

namespace {
constexpr Seconds frame_interval{0.008};
constexpr float dazzling = 1e3f;
constexpr double black_dn = 40.0;
constexpr double dn_per_radiance_second = 100'000.0;

TimePoint::duration ticks(Seconds time) {
  return std::chrono::round<TimePoint::duration>(time);
}
}  // namespace

FakeRig::FakeRig(FakeRigHabits habits) : habits_(habits) {
  flips_.push_back({TimePoint{} - std::chrono::seconds(10), uniform_drive(width, height, 0)});
  for (int i = 0; i < habits_.queue_frames; ++i) queue_.push_back(expose());
}

CameraCalibration FakeRig::camera_calibration() const {
  CameraCalibration camera;
  camera.bits = 12;
  camera.linear_from_dn = linear_response(12);
  camera.black_level_dn = black_dn;
  camera.saturation_dn = 4095;
  camera.electrons_per_dn = 1e4;  // its frames have no noise, as if there were very many electrons
  camera.electrons_per_radiance_second = camera.electrons_per_dn * dn_per_radiance_second;
  return camera;
}

MonitorCalibration FakeRig::monitor_calibration() const {
  MonitorCalibration monitor;
  for (auto& table : monitor.radiance_from_level)
    for (int level = 0; level < 256; ++level)
      table.push_back(0.01f + static_cast<float>(std::pow(level / 255.0, 2.2)));
  return monitor;
}

float FakeRig::radiance_at(TimePoint time, int x, int y, int c) const {
  const Flip* shown = &flips_.front();
  for (const Flip& flip : flips_) {
    const TimePoint changes = flip.time + ticks(habits_.latency);
    if (time >= changes && time < changes + ticks(habits_.settling)) return dazzling;
    if (time >= changes) shown = &flip;
  }
  static const MonitorCalibration monitor = monitor_calibration();
  const auto level = shown->image.levels[(static_cast<std::size_t>(y) * width + x) * 3 + c];
  return reflectance(x, y) * monitor.radiance_from_level[c][level] + ambient;
}

RawFrame FakeRig::expose() {
  if (!pending_exposures_.empty()) {
    if (!habits_.automatic_exposure) exposure_ = pending_exposures_.front();
    pending_exposures_.pop_front();
  }
  RawFrame frame;
  frame.width = width;
  frame.height = height;
  frame.exposure = exposure_;
  if (habits_.exposure_rounding > 0.0)
    frame.exposure =
        Seconds(habits_.exposure_rounding * std::round(exposure_.count() / habits_.exposure_rounding));
  frame.exposure_start = now_;
  frame.sequence = sequence_++;
  const TimePoint end = now_ + ticks(frame.exposure);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        // The pattern may change while the shutter is open.
        const float light = std::max(radiance_at(now_, x, y, c), radiance_at(end, x, y, c));
        const double dn = black_dn + dn_per_radiance_second * light * frame.exposure.count();
        frame.samples.push_back(static_cast<std::uint16_t>(std::clamp(std::round(dn), 0.0, 4095.0)));
      }
  if (habits_.states_what_was_asked) frame.exposure = asked_;
  now_ = std::max(end, now_ + ticks(frame_interval));
  return frame;
}

CameraDescription FakeRig::CameraFace::describe() const {
  return {"fake camera", width, height, PixelLayout::rgb, 12, Seconds(1e-5), Seconds(1.0), frame_interval};
}

TimePoint FakeRig::CameraFace::set_exposure(Seconds exposure, double) {
  const Seconds last = rig.pending_exposures_.empty() ? rig.exposure_ : rig.pending_exposures_.back();
  while (static_cast<int>(rig.pending_exposures_.size()) < rig.habits_.settings_delay)
    rig.pending_exposures_.push_back(last);
  rig.pending_exposures_.push_back(exposure);
  rig.asked_ = exposure;
  return rig.now_;
}

RawFrame FakeRig::CameraFace::next_frame(Seconds timeout) {
  if (rig.habits_.unplugged_after >= 0 && rig.delivered_ >= rig.habits_.unplugged_after)
    throw DeviceError("fake camera", ETIMEDOUT,
                      "sent no frame within " + std::to_string(timeout.count()) + " s");
  rig.queue_.push_back(rig.expose());
  if (rig.habits_.lose_every > 0 && rig.queue_.back().sequence % rig.habits_.lose_every == 0)
    rig.queue_.back() = rig.expose();
  RawFrame frame = rig.queue_.front();
  rig.queue_.pop_front();
  ++rig.delivered_;
  return frame;
}

IlluminatorDescription FakeRig::DisplayFace::describe() const {
  return {"fake display", width, height, rig.habits_.latency, rig.habits_.settling};
}

TimePoint FakeRig::DisplayFace::show(const DriveImage& image) {
  // The process dawdles: flips fall anywhere between frames.
  rig.now_ += std::chrono::microseconds(1000 + 731 * (rig.flips_.size() % 7));
  rig.flips_.push_back({rig.now_, image});
  return rig.now_;
}

TimePoint FakeRig::TriggerFace::fire() {
  ++rig.pulses_;
  return rig.now_;
}

}  // namespace refield::test
