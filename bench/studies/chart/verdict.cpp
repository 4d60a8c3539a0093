// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/verdict.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>

namespace refield::chart {

namespace {

std::string padded(std::string text, std::size_t width) {
  if (text.size() < width) text.append(width - text.size(), ' ');
  return text;
}

std::string three_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

}  // namespace

std::vector<Verdict> verdicts_of(const std::vector<ChartRow>& rows, const std::vector<std::string>& names) {
  std::set<int> counts;
  for (const ChartRow& row : rows) counts.insert(row.images);
  const double infinity = std::numeric_limits<double>::infinity();
  std::vector<Verdict> verdicts;
  for (const int images : counts)
    for (std::size_t k = 0; k < names.size(); ++k) {
      Verdict verdict{images, names[k], "", infinity, std::numeric_limits<double>::quiet_NaN(), "", infinity};
      for (const ChartRow& row : rows) {
        if (row.images != images || !std::isfinite(row.errors[k])) continue;
        if (row.errors[k] < verdict.error) {
          verdict.error = row.errors[k];
          verdict.best = row.label();
        }
        if (row.method == "ours") {
          if (row.setting == "default") verdict.ours = row.errors[k];
        } else if (row.errors[k] < verdict.rival_error) {
          verdict.rival_error = row.errors[k];
          verdict.rival = row.label();
        }
      }
      if (std::isfinite(verdict.error)) verdicts.push_back(std::move(verdict));
    }
  return verdicts;
}

std::string verdict_table(const std::vector<Verdict>& verdicts, int images) {
  std::string text = padded("error, " + std::to_string(images) + " images", 28) + padded("ours", 9) +
                     padded("best other", 11) + "\n";
  for (const Verdict& verdict : verdicts) {
    if (verdict.images != images) continue;
    text += padded(verdict.measure, 28) + padded(three_digits(verdict.ours), 9);
    if (verdict.rival.empty())
      text += "no other method";
    else
      text += padded(three_digits(verdict.rival_error), 9) + padded(verdict.rival, 18) +
              (std::isnan(verdict.ours) ? ""
               : verdict.ours_is_best() ? "ours is best"
                                        : "BEATS OURS");
    text += "\n";
  }
  return text;
}

}  // namespace refield::chart
