// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "bench/studies/chart/data.h"
#include "bench/studies/peers/peer_model.h"
#include "estimate/options.h"

namespace refield::chart {

/// A way to estimate.
struct Method {
  std::string name;    ///< as on the command line
  std::string title;   ///< for people, with its source
  bool takes_kernels;  ///< whether --max-kernels gives it settings
};

/// All of them, ours first.
const std::vector<Method>& all_methods();
/// Throws InputError for an unknown name, listing the known ones.
const Method& method_named(const std::string& name);

/// A row to be measured.
struct Task {
  std::string method;
  std::string setting;  ///< "default", or "25 kernels"
  int kernels = 0;      ///< 0: not a setting of the method
  int images = 0;
};

/// The grid, by number of images, then method. Where images are too few for a setting it is left out.
std::vector<Task> grid_of(const std::vector<std::string>& methods, const std::vector<int>& kernels,
                          const std::vector<int>& images);

/// Whether the data allow a method at all; if not, why.
std::optional<std::string> reason_against(const std::string& method, const ChartData& data);

/// Estimates from the session's first images, from files to a model in memory. `base` holds what is common
/// to all rows of ours and the paper's (clip level, threads, memory).
peers::Model estimate_model(const Task& task, const ChartData& data, const EstimateOptions& base);

}  // namespace refield::chart
