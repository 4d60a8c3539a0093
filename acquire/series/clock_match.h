// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "acquire/series/capture_time.h"

namespace refield {

/// How one clock runs beside another: first = second + offset + drift · (second − origin).
struct ClockRelation {
  double offset_seconds = 0.0;
  double drift = 0.0;         ///< seconds a second; 1e-6 is 1 ppm
  ClockSeconds origin = 0.0;  ///< of the second clock: where the offset holds

  ClockSeconds first_from_second(ClockSeconds second) const {
    return second + offset_seconds + drift * (second - origin);
  }
};

/// A photograph's time and its total brightness, any unit.
struct TimedBrightness {
  ClockSeconds time = 0.0;
  double brightness = 0.0;
};

struct ClockEstimate {
  ClockRelation relation;
  double correlation = 0.0;  ///< of the two brightness series once brought together, at most 1
  double runner_up = 0.0;    ///< the highest correlation at an offset that is clearly another one
};

/// Tells the relation of two clocks from how the brightness of two series (each in order of time) goes up and
/// down together: the offset with the highest correlation of log brightness, its slow part (a running mean
/// over 15 photographs) taken off, within ±`largest_offset` seconds; then offset and, where asked, drift
/// refined together. Throws InputError when the series overlap too little, do not vary together, or do so at
/// several offsets alike.
ClockEstimate estimate_clocks(std::span<const TimedBrightness> first, std::span<const TimedBrightness> second,
                              double largest_offset_seconds, bool with_drift);

/// Pairs of indices, nearest in time first taken, each used once, no pair further apart than
/// `tolerance_seconds`; sorted by the first. Times must be in order.
std::vector<std::pair<std::size_t, std::size_t>> match_in_time(std::span<const ClockSeconds> first,
                                                               std::span<const ClockSeconds> second,
                                                               const ClockRelation& relation,
                                                               double tolerance_seconds);

/// The middle one of the intervals between times in order; 0 for fewer than two.
double median_interval(std::span<const ClockSeconds> times);

}  // namespace refield
