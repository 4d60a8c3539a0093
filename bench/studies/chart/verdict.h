// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "bench/studies/chart/row.h"

namespace refield::chart {

/// Who is best in one column of the chart at one number of images.
struct Verdict {
  int images = 0;
  std::string measure;  ///< name of the column, see error_names()
  std::string best;     ///< method and setting
  double error = 0.0;
  double ours = 0.0;  ///< error of our default setting; NaN where it was not charted
  std::string rival;  ///< best method that is not ours; empty without one
  double rival_error = 0.0;
  bool ours_is_best() const { return ours <= rival_error; }
};

/// One for each number of images and column, in this order. Columns without any finite error are left out.
std::vector<Verdict> verdicts_of(const std::vector<ChartRow>& rows, const std::vector<std::string>& names);

/// The verdicts as a table for people, at one number of images.
std::string verdict_table(const std::vector<Verdict>& verdicts, int images);

}  // namespace refield::chart
