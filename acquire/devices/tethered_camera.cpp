// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/tethered_camera.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <thread>

#include "core/base/number_text.h"

namespace refield {

TimePoint monotonic_now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

void TetheredCamera::wait_for_replug(const DeviceError& gone, const std::string& name, Seconds patience,
                                     const RunContext& run, const std::function<bool()>& open) {
  constexpr Seconds look_again{0.25};
  if (patience.count() <= 0.0) throw DeviceError(gone);
  run.note(name, ": does not answer; waiting ", std::lround(patience.count()),
           " s for it to be connected again");
  const auto begun = std::chrono::steady_clock::now();
  while (seconds_since(begun) < patience.count()) {
    run.throw_if_stopped();
    std::this_thread::sleep_for(look_again);
    try {
      if (!open()) continue;
    } catch (const InputError&) {
      continue;
    } catch (const DeviceError&) {
      continue;
    }
    ++troubles_.replugs;
    run.note(name, ": is connected again");
    return;
  }
  throw DeviceError(gone);
}

TimePoint StreamingCamera::set_exposure(Seconds exposure, double gain) {
  require_open();
  check_settings(exposure, gain);
  asked_ = {exposure, gain};
  try {
    make_settings(exposure, gain);
  } catch (const DeviceError& error) {
    if (error.error_number() != ENODEV) throw;
    reconnect(error);
  }
  return settings_made_;
}

void StreamingCamera::make_settings_again() {
  if (asked_) make_settings(asked_->first, asked_->second);
}

void StreamingCamera::require_range(const std::string& what, double value, double low, double high,
                                    double rounding) const {
  if (!(value >= low - rounding && value <= high + rounding))
    throw InputError(describe().name,
                     formatted(": %s of %.7g lies outside %.7g to %.7g", what.c_str(), value, low, high));
}

TimePoint CameraClock::start_of(std::int64_t stamp_ns, TimePoint arrival, Seconds shortest, Seconds longest) {
  constexpr double fastest_drift = 200e-6;  // quartz: 50e-6 on either side, and a host that is being adjusted
  using std::chrono::nanoseconds;
  if (stamp_ns <= last_stamp_ns_) offset_ns_.reset();  // its clock began anew
  std::int64_t bound =
      (arrival - std::chrono::floor<nanoseconds>(shortest)).time_since_epoch().count() - stamp_ns;
  if (offset_ns_) {
    const auto passed = std::max<std::int64_t>((arrival - last_arrival_).count(), 0);
    bound =
        std::min(bound, *offset_ns_ + static_cast<std::int64_t>(fastest_drift * static_cast<double>(passed)));
  }
  offset_ns_ = bound;
  last_arrival_ = arrival;
  last_stamp_ns_ = stamp_ns;
  return std::min(TimePoint(nanoseconds(stamp_ns + bound)),
                  arrival - std::chrono::ceil<nanoseconds>(longest));
}

std::uint64_t FrameCounter::number_of(std::uint64_t id) {
  constexpr std::uint64_t round = 65535, half_round = round / 2;  // ids 1 to 65535; longer ones never wrap
  std::uint64_t step = 1;
  if (last_id_ && id > *last_id_)
    step = id - *last_id_;
  else if (last_id_ && *last_id_ <= round && id + round - *last_id_ < half_round)
    step = id + round - *last_id_;
  last_id_ = id;
  number_ += step > incomplete_ ? step - incomplete_ : 1;
  incomplete_ = 0;
  return number_;
}

std::uint64_t FrameCounter::number_of_incomplete() {
  ++incomplete_;
  return ++number_;
}

}  // namespace refield
