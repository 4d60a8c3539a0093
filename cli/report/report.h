// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/report/input.h"
#include "cli/report/pixel_choice.h"
#include "core/base/json.h"
#include "core/session/capture_session.h"
#include "estimate/estimate.h"
#include "relight/held_out.h"

namespace refield::report {

/// Errors of one field against one reference, by kind of light in the order of kinds_of().
struct ReferenceErrors {
  std::string reference;  ///< "photographs" or "exact images"
  std::vector<HeldOutError> kinds;
};

/// A field's figures.
struct FieldFigures {
  std::vector<ReferenceErrors> errors;  ///< empty where the session holds nothing out
  double relight_seconds = 0.0;         ///< a frame, median, all cores
};

/// The kinds of light among held-out frames: natural, bar, square and white first, black last, others
/// between.
std::vector<std::string> kinds_of(const CaptureSession& session);

/// Evaluates all fields, one after the other.
std::vector<FieldFigures> evaluate(const ReportInput& input, const RunContext& run = {});

/// Up to `count` frames of a kind, evenly spread over its held-out frames: no hand picks them.
std::vector<CaptureFrame> spread_frames(const CaptureSession& session, const std::string& kind,
                                        std::size_t count);

/// The page's figures for machines. Errors are relative RMSE, fractions; numbers that are not finite become
/// null.
Json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                  const std::vector<ChosenPixel>& pixels);

/// What the page of a report draws (cli/report/report.js): `figures` (figures_json()), to which pictures,
/// kernels, maps and the logs of stages are added. `check` is check_json() of the capture, or null.
Json page_data(const ReportInput& input, const std::vector<FieldFigures>& evaluated, const KernelStudy& study,
               const std::vector<RunLog>& logs, Json figures, Json check, const RunContext& run);

/// What a check of the photographs finds (estimate/rig/verdict.h): verdict, path of the camera, gains, colour
/// mixing, residual of each photograph.
Json check_json(const FrameReport& found, int photographs);

}  // namespace refield::report
