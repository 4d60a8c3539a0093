// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "bench/studies/chart/data.h"

namespace refield::chart {

/// One method at one setting, fitted to the first images: a row of chart.csv.
struct ChartRow {
  std::string method;
  std::string setting;
  int images = 0;
  double seconds = 0.0;  ///< to estimate, files read included
  double relight_ms = 0.0;
  double bytes_per_pixel = 0.0;
  double functions_per_pixel = 0.0;  ///< basis functions (kernels, wavelets, images) that a pixel has
  /// Relative RMSE by name, in the order of error_names().
  std::vector<double> errors;

  /// Method and setting, as pictures and tables name them.
  std::string label() const { return setting.empty() ? method : method + ", " + setting; }
};

/// For each kind of light L: "L" (whole picture), "L_median", "L_p90" (over pixels), and for each kind of
/// pixel K: "L_K" (all its pixels together), "L_K_median".
std::vector<std::string> error_names(const ChartData& data);

/// An error by name; NaN where there is no such column.
double error_of(const ChartRow& row, const std::vector<std::string>& names, const std::string& name);

std::string csv_of(const std::vector<ChartRow>& rows, const std::vector<std::string>& names);

/// Rows of a chart.csv whose columns are those of `names`; none where they differ. Throws FormatError for a
/// damaged file.
std::vector<ChartRow> rows_of_csv(const std::filesystem::path& path, const std::vector<std::string>& names);

}  // namespace refield::chart
