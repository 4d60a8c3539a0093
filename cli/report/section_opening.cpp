// SPDX-License-Identifier: Apache-2.0
#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"
#include "core/image_io.h"
#include "core/run_context.h"

namespace refield::report {

namespace {

std::string tile(const std::string& value, const std::string& what) {
  return "<div class=\"tile\"><b>" + escaped(value) + "</b><span>" + escaped(what) + "</span></div>";
}

/// The session's folder; the one around it where that is called "session", as captures are often kept. Of
/// pairs the folder of the photographs, or the one that holds the light maps' folder, too.
std::string session_name(const CaptureSession& session) {
  if (session.folder.empty() && !session.frames.empty()) {
    const CaptureFrame& frame = session.frames.front();
    const auto observed = std::filesystem::weakly_canonical(frame.observed).parent_path();
    const auto light = std::filesystem::weakly_canonical(frame.illumination).parent_path();
    const bool side_by_side = observed != light && observed.parent_path() == light.parent_path();
    return (side_by_side ? observed.parent_path() : observed).filename().string();
  }
  auto folder = std::filesystem::weakly_canonical(session.folder);
  if (!folder.has_filename()) folder = folder.parent_path();
  if (folder.filename() == "session" && folder.has_parent_path()) folder = folder.parent_path();
  return folder.filename().string();
}

std::string first_impression(const ReportInput& input, const RunContext& run) {
  const auto kinds = kinds_of(input.session);
  if (kinds.empty()) return "";
  const CaptureFrame frame = spread_frames(input.session, kinds.front(), 1).front();
  const LightMap light = read_light_map(frame.illumination, input.session.light.parameterisation, run);
  const Image observed = read_photograph(frame.observed).radiance;
  const double exposure = display_exposure(observed, input.mask);
  const auto figure = [&](const Image& image, double scale, const std::string& title,
                          const std::string& text) {
    return "<figure>" + image_html(shrunk(image, max_picture_width), scale, title) + "<figcaption><b>" +
           escaped(title) + "</b> " + escaped(text) + "</figcaption></figure>";
  };
  return "<div class=\"hero\">" +
         figure(light.radiance, display_exposure(light.radiance, {}), "Light",
                "on the display, never used in estimation") +
         figure(observed, exposure, "Photograph", "of the scene under this light") +
         figure(input.fields.front().field.relight(light), exposure, "Prediction",
                "by " + input.fields.front().label + ", same exposure") +
         "</div>";
}

}  // namespace

std::string section_html(const std::string& heading, const std::string& content) {
  if (content.empty()) return "";
  return "<section><h2>" + escaped(heading) + "</h2>\n" + content + "</section>\n";
}

std::string opening_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                         const RunContext& run) {
  const FieldEntry& entry = input.fields.front();
  std::string tiles;
  if (!figures.front().errors.empty()) {
    const ReferenceErrors& errors = figures.front().errors.back();
    for (const char* kind : {"natural", "bar"})
      if (const HeldOutError* error = find_kind(errors.kinds, kind))
        tiles +=
            tile(percent(error->relative_rmse), std::string("relative RMSE, held-out ") +
                                                    (kind == std::string("bar") ? "bars" : "natural light"));
    if (tiles.empty() && !errors.kinds.empty()) {  // pairs of images state no kind of light
      const HeldOutError& error = errors.kinds.front();
      tiles +=
          tile(percent(error.relative_rmse), "relative RMSE, " + counted(error.images, "held-out image"));
      if (!error.per_image.empty())
        tiles += tile(percent(spread_of(error.per_image).median), "relative RMSE of the median image");
    }
  }
  const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
  tiles += tile(fixed(entry.statistics.mean_stored, 1), "kernels per pixel");
  tiles += tile(significant(static_cast<double>(entry.file_bytes) / pixels, 3), "bytes per pixel on disk");
  tiles += tile(duration_text(figures.front().relight_seconds), "to relight a frame");
  return "<header><p class=\"kicker\">Reflectance field report</p><h1>" +
         escaped(session_name(input.session)) + "</h1>\n" + first_impression(input, run) +
         "<div class=\"tiles\">" + tiles + "</div>" +
         (input.fields.size() > 1
              ? "<p class=\"note\">Picture and figures above: " + escaped(entry.label) + ".</p>"
              : "") +
         "</header>\n";
}

}  // namespace refield::report
