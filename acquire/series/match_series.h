// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/capture/session_writer.h"
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

/// Two series of photographs by cameras whose clocks know nothing of each other: the scene, and the light.
struct MatchRequest {
  std::string observed;  ///< pattern or folder of the scene's photographs (OpenEXR)
  std::string
      probes;  ///< pattern or folder of light maps, as probe_light() writes them or as they were shown
  Parameterisation parameterisation = Parameterisation::lat_long;  ///< of the light maps
  fs::path folder;                                                 ///< of the session to make
  std::optional<double> offset_seconds =
      0.0;  ///< the observed camera's clock is ahead by this; nullopt: told from brightness
  std::optional<double> drift_ppm = 0.0;    ///< and gains this; nullopt: told, too
  double largest_offset_seconds = 3600.0;   ///< where it is told
  std::optional<double> tolerance_seconds;  ///< nullopt: half the light maps' usual interval
  int test_every = 0;                       ///< every that many pairs one is held out; 0: none
  std::optional<fs::path> mask;
  IfExists if_exists = IfExists::refuse;
};

struct MatchedPair {
  fs::path observed;
  fs::path probe;
  double apart_seconds = 0.0;  ///< observed − probe, once the clocks are brought together
};

/// A photograph that did not become part of the session, and why.
struct LeftOut {
  fs::path file;
  std::string reason;
};

struct MatchSummary {
  std::vector<MatchedPair> pairs;
  std::vector<LeftOut> observed_left_out;
  std::vector<LeftOut> probes_left_out;  ///< those that probe_light() discarded, too
  ClockRelation clocks;
  std::optional<ClockEstimate> estimate;  ///< where the clocks were told from brightness
  double tolerance_seconds = 0.0;
};

/// Pairs each photograph of the scene with the light map nearest in time and writes the pairs as a capture
/// session, with order = seconds since the first. Roles by the lights' names: test…, reference…, all others
/// train. Times: times.tsv of the folder, else metadata, else file
/// names. A light map that was discarded still takes its photograph with it, so that this is not paired with
/// the next best light. Resumable like any capture. Throws InputError where times are missing, sizes differ
/// or nothing matches. Source: Matusik et al. 2004, section 6: two cameras, every two minutes for three days,
/// 97 pairs kept.
MatchSummary match_series(const MatchRequest& request, const RunContext& run = {});

}  // namespace refield
