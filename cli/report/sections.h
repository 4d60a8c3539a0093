// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "cli/report/evaluation.h"
#include "cli/report/input.h"
#include "cli/report/pixel_choice.h"
#include "core/base/run_context.h"
#include "estimate/estimate.h"

namespace refield::report {

// The page's parts, in reading order. Each returns HTML that ends with its part, or nothing where the session
// has nothing to show there.

/// Title, one prediction beside its photograph, the figures that matter most.
std::string opening_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                         const RunContext& run);
/// Session, fields, held-out errors by kind of light.
std::string summary_html(const ReportInput& input, const std::vector<FieldFigures>& figures);
/// What a check of the photographs finds (estimate/rig/verdict.h): verdict, path of the camera, gains, colour
/// mixing, residual of each photograph.
std::string check_html(const FrameReport& found, int photographs);
/// Light, photograph, prediction and error for held-out lights (Matusik et al. 2004, figures 1 and 6).
std::string pictures_html(const ReportInput& input, const RunContext& run);
/// Error against the number of images (figure 7) as the fields measured it on their training images, and
/// whether more would help.
std::string more_images_html(const ReportInput& input);
/// Kernels of chosen pixels while they are subdivided (figure 8).
std::string kernels_html(const ReportInput& input, const KernelStudy& study);
/// Kernels that matter (table 1), kernels per pixel, training error.
std::string statistics_html(const ReportInput& input, const RunContext& run);
/// Time and memory of each stage and of relighting.
std::string timing_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                        const std::vector<RunLog>& logs);

/// <section> with its number and heading around `content`; nothing around nothing.
std::string section_html(const std::string& heading, const std::string& content);

}  // namespace refield::report
