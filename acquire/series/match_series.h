// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acquire/series/clock_match.h"
#include "acquire/session_writer.h"
#include "core/light_map.h"
#include "core/run_context.h"

namespace refield {

/// Two series of photographs by cameras whose clocks know nothing of each other: the scene, and the light.
struct MatchRequest {
  std::string observed;  ///< pattern or folder of the scene's photographs (OpenEXR)
  std::string
      probes;  ///< pattern or folder of light maps, as probe_light() writes them or as they were shown
  Parameterisation parameterisation = Parameterisation::lat_long;  ///< of the light maps
  std::filesystem::path folder;                                    ///< of the session to make
  std::optional<double> offset_seconds =
      0.0;  ///< the observed camera's clock is ahead by this; nullopt: told from brightness
  std::optional<double> drift_ppm = 0.0;    ///< and gains this; nullopt: told, too
  double largest_offset_seconds = 3600.0;   ///< where it is told
  std::optional<double> tolerance_seconds;  ///< nullopt: half the light maps' usual interval
  int test_every = 0;                       ///< every so many pairs one is held out; 0: none
  std::optional<std::filesystem::path> mask;
  IfExists if_exists = IfExists::refuse;
};

struct MatchedPair {
  std::filesystem::path observed;
  std::filesystem::path probe;
  double apart_seconds = 0.0;  ///< observed − probe, once the clocks are brought together
};

/// A photograph that did not become part of the session, and why.
struct LeftOut {
  std::filesystem::path file;
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
