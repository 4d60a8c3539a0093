// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <numbers>

namespace refield {

/// Time spans such as exposure times. Arithmetic in double keeps quotients of exposures exact enough for HDR.
using Seconds = std::chrono::duration<double>;

/// Instants that cameras and displays report: CLOCK_MONOTONIC on devices, simulated time on the virtual rig.
struct MonotonicClock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<MonotonicClock>;
  static constexpr bool is_steady = true;
};
using TimePoint = MonotonicClock::time_point;

/// Wall time since `start`.
inline double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

constexpr double radians_from_degrees(double degrees) {
  return degrees * std::numbers::pi / 180.0;
}
constexpr double degrees_from_radians(double radians) {
  return radians * 180.0 / std::numbers::pi;
}

}  // namespace refield
