// SPDX-License-Identifier: Apache-2.0
#include "cli/chart/pictures.h"

#include <algorithm>

#include "cli/chart/methods.h"
#include "cli/chart/panel.h"
#include "core/files.h"

namespace refield::chart {

namespace {

struct Measure {
  const char* file;
  const char* title;
  const char* x_label;
  bool over_images;  ///< lines over all numbers of images
  double (*value)(const ChartRow&);
};

constexpr Measure measures[] = {
    {"time.svg", "Error against estimation time", "estimation, seconds, files read included", false,
     [](const ChartRow& row) { return row.seconds; }},
    {"size.svg", "Error against size", "bytes a pixel", false,
     [](const ChartRow& row) { return row.bytes_per_pixel; }},
    {"images.svg", "Error against number of images", "training images", true,
     [](const ChartRow& row) { return static_cast<double>(row.images); }},
    {"relighting.svg", "Error against relighting time", "relighting, ms a frame", false,
     [](const ChartRow& row) { return row.relight_ms; }}};

int colour_of(const std::string& method) {
  const auto found = std::ranges::find(all_methods(), method, &Method::name);
  return static_cast<int>(found - all_methods().begin());
}

Panel panel_of(const Measure& measure, const std::vector<ChartRow>& rows,
               const std::vector<std::string>& names, const std::string& error, int most_images) {
  Panel panel;
  panel.x_label = measure.x_label;
  panel.y_label = "relative RMSE";
  panel.lines = measure.over_images;
  for (const ChartRow& row : rows) {
    if (!measure.over_images && row.images != most_images) continue;
    const std::string label = row.label();
    auto track = std::ranges::find(panel.tracks, label, &Track::label);
    if (track == panel.tracks.end())
      track = panel.tracks.insert(track, Track{label, colour_of(row.method), {}});
    track->points.push_back({measure.value(row), error_of(row, names, error)});
  }
  for (Track& track : panel.tracks) std::ranges::sort(track.points);
  return panel;
}

}  // namespace

void write_pictures(const std::filesystem::path& folder, const std::vector<ChartRow>& rows,
                    const std::vector<std::string>& names, const std::vector<std::string>& light_kinds) {
  int most_images = 0;
  for (const ChartRow& row : rows) most_images = std::max(most_images, row.images);
  for (const Measure& measure : measures) {
    std::vector<Panel> panels;
    for (const std::string& light : light_kinds)
      for (const bool median : {false, true}) {
        Panel panel = panel_of(measure, rows, names, median ? light + "_median" : light, most_images);
        panel.title = "Held-out light: " + light + (median ? ", median pixel" : ", whole picture");
        panels.push_back(std::move(panel));
      }
    const std::string title =
        measure.title +
        (measure.over_images ? std::string() : " (" + std::to_string(most_images) + " images)") +
        "; dashed: Pareto front";
    write_text_atomically(folder / measure.file, picture_svg(title, panels, 2));
  }
}

}  // namespace refield::chart
