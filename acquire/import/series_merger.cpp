// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/series_merger.h"

#include "core/errors.h"

namespace refield {

namespace fs = std::filesystem;

Photograph SeriesMerger::merge(const std::vector<fs::path>& paths, bool counts) {
  Bracket bracket = read_bracket(paths, request_.camera, request_.exposures);
  MergeStatistics statistics;
  Photograph merged;
  try {
    merged = merge_bracket(bracket, request_.camera, &statistics);
  } catch (const InputError& error) {
    throw InputError(paths.front().string() + ": " + error.what());
  }
  require_same_size(merged.radiance, paths.front());
  if (counts) add(statistics, bracket.exposures);
  return merged;
}

void SeriesMerger::require_same_size(const Image& merged, const fs::path& path) {
  if (width_ == 0) {
    width_ = merged.width;
    height_ = merged.height;
  }
  if (merged.width != width_ || merged.height != height_)
    throw InputError(path.string() + ": is " + shape_text(merged) + ", the photographs before are " +
                     std::to_string(width_) + "×" + std::to_string(height_) +
                     "; give photographs of one camera");
}

void SeriesMerger::add(const MergeStatistics& statistics, const std::vector<Seconds>& exposures) {
  if (exposures_.empty()) {
    exposures_ = exposures;
    useful_.assign(exposures.size(), 0.0);
  }
  for (std::size_t i = 0; i < useful_.size(); ++i) useful_[i] += statistics.useful_fraction[i];
  clipped_ += statistics.clipped_fraction;
  ++merged_;
}

void SeriesMerger::report(ImportSummary& summary) const {
  summary.exposures = exposures_;
  if (merged_ == 0) return;
  for (double useful : useful_) summary.useful_fraction.push_back(useful / merged_);
  summary.clipped_fraction = clipped_ / merged_;
}

}  // namespace refield
