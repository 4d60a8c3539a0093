// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "bench/studies/chart/methods.h"
#include "bench/studies/chart/row.h"

namespace refield::chart {

/// Errors of a model on the held-out frames, in the order of error_names().
std::vector<double> held_out_errors(const peers::Model& model, const ChartData& data);

/// Estimates, relights and compares: one row.
ChartRow measure(const Task& task, const ChartData& data, const EstimateOptions& base);

}  // namespace refield::chart
