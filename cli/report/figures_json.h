// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "cli/report/evaluation.h"
#include "cli/report/input.h"
#include "cli/report/pixel_choice.h"

namespace refield::report {

/// The page's figures for machines. Errors are relative RMSE, fractions; numbers that are not finite become
/// null.
nlohmann::ordered_json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                                    const std::vector<ChosenPixel>& pixels);

}  // namespace refield::report
