// SPDX-License-Identifier: Apache-2.0
#include "cli/common/held_out_figures.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace refield::cli {

namespace {

using nlohmann::ordered_json;

ordered_json finite_or_null(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

}  // namespace

ordered_json held_out_figures(const HeldOutError& error) {
  ordered_json figures = {
      {"images", error.images},
      {"trained_on", error.trained_on ? ordered_json(*error.trained_on) : ordered_json(nullptr)},
      {"relative_rmse", finite_or_null(error.relative_rmse)},
      {"median", finite_or_null(error.median)},
      {"percentile_90", finite_or_null(error.percentile_90)},
      {"tone_mapped_psnr_db", finite_or_null(error.tone_mapped_psnr_db)}};
  if (error.prediction)
    figures["predicted_error"] = {{"rank_correlation", finite_or_null(error.prediction->rank_correlation)},
                                  {"median_ratio", finite_or_null(error.prediction->median_ratio)},
                                  {"median", finite_or_null(error.prediction->predicted_median)}};
  figures["per_image"] = ordered_json::array();
  for (const HeldOutImage& image : error.per_image)
    figures["per_image"].push_back(
        {{"name", image.name},
         {"observed", image.observed.string()},
         {"relative_rmse", finite_or_null(image.error.relative_rmse)},
         {"tone_mapped_psnr_db", finite_or_null(image.error.tone_mapped_psnr_db)}});
  return figures;
}

ordered_json held_out_figures(const std::vector<HeldOutError>& errors) {
  ordered_json kinds = ordered_json::object();
  for (const HeldOutError& error : errors)
    kinds[error.kind.empty() ? "all" : error.kind] = held_out_figures(error);
  return kinds;
}

void print_errors(const std::vector<HeldOutError>& errors) {
  const auto label = [](const HeldOutError& error) {
    return error.kind.empty() ? "all" : error.kind.c_str();
  };
  std::printf("%-16s %6s %14s %12s %12s %18s\n", "", "images", "relative RMSE", "median pixel", "90th pct.",
              "tone-mapped PSNR");
  for (const HeldOutError& error : errors)
    std::printf("%-16s %6zu %14.4f %12.4f %12.4f %15.2f dB\n", label(error), error.images,
                error.relative_rmse, error.median, error.percentile_90, error.tone_mapped_psnr_db);
  if (std::ranges::none_of(errors, [](const HeldOutError& error) { return error.per_image.size() > 1; }))
    return;
  std::printf("\n%-16s %6s %14s %12s %12s\n", "per image", "", "median image", "mean", "largest");
  for (const HeldOutError& error : errors) {
    if (error.per_image.size() < 2) continue;
    const ErrorSpread spread = spread_of(error.per_image);
    std::printf("%-16s %6s %14.4f %12.4f %12.4f  %s\n", label(error), "", spread.median, spread.mean,
                spread.largest, error.per_image[spread.worst].name.c_str());
  }
}

}  // namespace refield::cli
