// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/capture_session.h"
#include "core/run_context.h"
#include "estimate/estimate_plan.h"
#include "estimate/frame_check.h"
#include "estimate/options.h"

namespace refield {

/// What an estimation would take, measured on a sample of it: `refield estimate --dry-run`.
struct Foresight {
  EstimatePlan plan;
  FrameReport frames;
  double check_seconds = 0.0;        ///< comparing the frames with each other
  double lights_seconds = 0.0;       ///< reading all lights and building their table
  double photographs_seconds = 0.0;  ///< reading all bands of all photographs
  double fit_seconds = 0.0;
  int sampled_pixels = 0;  ///< that were fitted to find out
  double seconds() const { return check_seconds + lights_seconds + photographs_seconds + fit_seconds; }
};

/// Checks options and all input as estimate_to_file() does (the header of every image, the values of every
/// light, the values of the photographs' rows that the sample reads) and measures on this machine what the
/// work costs: reads all lights, some rows of all photographs, and fits tiles of pixels spread over the
/// picture for about two seconds. Writes nothing. Throws InputError for input that cannot be estimated from.
Foresight foresee_estimate(const CaptureSession& session, const EstimateOptions& options,
                           const RunContext& run);

}  // namespace refield
