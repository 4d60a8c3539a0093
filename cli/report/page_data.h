// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <vector>

#include "cli/report/evaluation.h"
#include "cli/report/input.h"
#include "cli/report/pixel_choice.h"
#include "estimate/estimate.h"

namespace refield::report {

/// What the page of a report draws (cli/report/report.js): `figures` (figures_json()), to which pictures,
/// kernels, maps and the logs of stages are added. `check` is check_json() of the capture, or null.
nlohmann::ordered_json page_data(const ReportInput& input, const std::vector<FieldFigures>& evaluated,
                                 const KernelStudy& study, const std::vector<RunLog>& logs,
                                 nlohmann::ordered_json figures, nlohmann::ordered_json check,
                                 const RunContext& run);

/// What a check of the photographs finds (estimate/rig/verdict.h): verdict, path of the camera, gains, colour
/// mixing, residual of each photograph.
nlohmann::ordered_json check_json(const FrameReport& found, int photographs);

}  // namespace refield::report
