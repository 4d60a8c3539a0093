// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <vector>

#include "acquire/import/import_series.h"

namespace refield {

/// Merges one bracket after the other and keeps what they have in common.
class SeriesMerger {
 public:
  explicit SeriesMerger(const ImportRequest& request) : request_(request) {}

  /// `counts`: this photograph enters the statistics of report(). Throws InputError naming the file, also for
  /// another size than those before.
  Photograph merge(const std::vector<std::filesystem::path>& paths, bool counts);
  void report(ImportSummary& summary) const;

 private:
  void require_same_size(const Image& merged, const std::filesystem::path& path);
  void add(const MergeStatistics& statistics, const std::vector<Seconds>& exposures);

  const ImportRequest& request_;
  int width_ = 0, height_ = 0;
  std::vector<Seconds> exposures_;
  std::vector<double> useful_;
  double clipped_ = 0.0;
  int merged_ = 0;
};

}  // namespace refield
