// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/json.h"
#include "core/base/run_context.h"
#include "core/session/capture_session.h"
#include "estimate/estimate.h"

namespace refield {

/// What a check of a capture found of one property, for people to act on.
struct VerdictRow {
  std::string property;  ///< "pairing", "motion", "colour", "tone curve", "clipping", ...
  RigFinding::State state = RigFinding::State::good;
  std::string measured;  ///< "the picture moved steadily, by 0.30 pixels"
  /// Relative leave-one-out residual of the photographs without and with the correction; empty where nothing
  /// is corrected.
  std::optional<double> residual_before, residual_after;
  std::string remedy;  ///< one sentence; empty where the state is good
};

/// Whether photographs and lights of a capture obey B = T L, and what to do where they do not.
struct CaptureVerdict {
  int photographs = 0;
  std::vector<VerdictRow> rows;
  double typical_residual = 0.0;  ///< relative, median over photographs and pixels; 0: too few to tell
  double noise = 0.0;             ///< of photographs, relative standard deviation; 0: unknown

  /// The worst of the rows.
  RigFinding::State state() const;
};

/// "good", "corrected", "suspicious" or "unusable".
std::string_view name_of(RigFinding::State state);

/// Checks the training photographs of a capture as an estimation does before it fits: reads a sample of the
/// pixels of all photographs and all lights, seconds for most captures. Does not change anything. Throws
/// InputError for input that cannot be estimated from.
CaptureVerdict check_capture(const CaptureSession& session, const EstimateOptions& options,
                             const RunContext& run = {});

/// The verdict of frames that check_frames() has assessed.
CaptureVerdict verdict_of(const FrameReport& report, int photographs);

/// A table for people, one line per row and another for each remedy.
std::string verdict_table(const CaptureVerdict& verdict);
/// The same for programs.
Json verdict_json(const CaptureVerdict& verdict);

/// That a training error is larger than noise explains, with the likely cause from the verdict; empty where
/// it is not. `shared_error` is the part of it that neighbouring pixels share, where that is known.
std::string unexplained_error(double training_error, double noise, std::optional<double> shared_error,
                              const CaptureVerdict& verdict);

}  // namespace refield
