// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "estimate/quality/outlier_frames.h"
#include "estimate/rig/rig_model.h"

namespace refield {

/// What was found of one thing that a rig can do besides B = T L.
struct RigFinding {
  /// `good`: nothing was found, nothing is changed. `suspicious`: found, but not corrected.
  enum class State { good, corrected, suspicious, unusable };
  std::string effect;  ///< "pairing", "motion", "colour", "tone", "gain", "room light"
  State state = State::good;
  double amount = 0.0;   ///< largest: frames (pairing), pixels (motion), else relative
  std::string measured;  ///< for people: "the picture moved steadily, by 0.30 pixels (...)"
  /// Relative leave-one-out residual of the photographs (root mean square), without and with the correction.
  double residual_before = 0.0, residual_after = 0.0;
};

struct RigReport {
  RigModel model;
  std::vector<RigFinding> findings;
};

/// Fewer photographs say too little: no rig is estimated.
inline constexpr int min_frames_for_rig = 24;

/// The pairing of photographs and lights that the photographs prefer: another offset, also from some
/// photograph on (one before it is doubled or missing), and photographs that show each other's lights.
/// `doubtful`: photographs that do not fit the others may be a sign of it, which makes the search wider.
/// Returns light_of, see RigModel, empty where the pairs are right or no pairing fits; `finding` tells which.
/// Source: the criterion is the leave-one-out residual of ridge regression (find_outlier_frames()).
std::vector<int> find_pairing(const LightFeatures& lights, const PixelSample& sample,
                              std::span<const CaptureFrame> frames, bool doubtful, RigFinding& finding,
                              const RunContext& run);

/// Numbers of the images of each primary alone, without light of the others. Colour mixing follows from their
/// photographs directly, and makes them look like outliers until it is known.
std::array<std::vector<int>, 3> primary_images(const LightFeatures& lights);

/// Estimates motion, colour mixing, tone curve, gains and room light from the photographs and lights of
/// `frames`, which are paired rightly, by the leave-one-out residual of ridge regression on coarse lights:
/// Gauss-Newton steps for each effect in turn, until nothing changes. An effect is corrected where it
/// explains more than what undisturbed captures show; else it stays exactly at none. `left_out`: frames that
/// do not take part. Reads four bands of 32 rows, or all of a small picture. Deterministic.
RigReport estimate_rig(std::span<const CaptureFrame> frames, const std::vector<char>& left_out,
                       const CaptureSession& session, const Mask& mask, float clip_level,
                       const LightFeatures& lights, const RunContext& run);

}  // namespace refield
