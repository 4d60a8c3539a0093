// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "bench/studies/chart/data.h"
#include "bench/studies/chart/row.h"
#include "estimate/options.h"

namespace refield::chart {

struct ChartOptions {
  std::vector<std::string> methods;  ///< empty: all that the data allow
  std::vector<int> images;           ///< empty: 25, 50, 100, 180 and all, as far as there are that many
  std::vector<int> kernels = {10, 25};
  bool resume = false;            ///< keep the rows of an earlier chart of the same data
  std::vector<std::string> redo;  ///< methods whose rows are measured anew all the same
  EstimateOptions estimate;       ///< what ours and paper mode share; mode and kernels are set by the rows
};

struct ChartResult {
  std::vector<ChartRow> rows;
  std::vector<std::string> names;                             ///< of the rows' errors
  std::vector<std::pair<std::string, std::string>> left_out;  ///< method, and why
  std::string reference_note;
  std::string kinds_note;
  int kept_rows = 0;  ///< taken over by `resume`
};

/// Runs the grid and writes chart.csv (after every row) and, where no map of pixel kinds was given,
/// kinds.png, derived from our own field of all images. Rows whose setting the images are too few for are
/// left out. Throws InputError for options or data that do not fit, Interrupted between rows.
ChartResult make_chart(const Sources& sources, const ChartOptions& options,
                       const std::filesystem::path& folder);

}  // namespace refield::chart
