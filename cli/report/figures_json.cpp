// SPDX-License-Identifier: Apache-2.0
#include "cli/report/figures_json.h"

#include <nlohmann/json.hpp>

namespace refield::report {

namespace {

using Json = nlohmann::ordered_json;

std::string name_of_kind(const HeldOutError& error) {
  return error.kind.empty() ? "all" : error.kind;
}

Json kinds_json(const std::vector<HeldOutError>& errors) {
  Json json = Json::object();
  for (const HeldOutError& error : errors)
    json[name_of_kind(error)] = {{"images", error.images},
                                 {"relative_rmse", error.relative_rmse},
                                 {"median", error.median},
                                 {"percentile_90", error.percentile_90},
                                 {"tone_mapped_psnr_db", error.tone_mapped_psnr_db}};
  return json;
}

/// The same with each image's own errors.
Json kinds_and_images_json(const std::vector<HeldOutError>& errors) {
  Json json = kinds_json(errors);
  for (const HeldOutError& error : errors)
    for (const HeldOutImage& image : error.per_image)
      json[name_of_kind(error)]["per_image"].push_back(
          {{"name", image.name},
           {"observed", image.observed.string()},
           {"relative_rmse", image.error.relative_rmse},
           {"tone_mapped_psnr_db", image.error.tone_mapped_psnr_db}});
  return json;
}

Json options_json(const EstimateOptions& options) {
  return {{"mode", name_of(options.mode)},
          {"kernels", options.kernels},
          {"spatial_passes", options.spatial_passes}};
}

Json field_json(const FieldEntry& entry, const FieldFigures& figures) {
  const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
  const KernelStatistics& statistics = entry.statistics;
  Json json = {{"path", entry.path.string()},
               {"label", entry.label},
               {"options", entry.options_recorded ? options_json(entry.options) : Json(nullptr)},
               {"file_bytes", entry.file_bytes},
               {"bytes_per_pixel", static_cast<double>(entry.file_bytes) / pixels},
               {"relight_ms", 1000.0 * figures.relight_seconds}};
  json["statistics"] = {{"distinct_boxes", statistics.distinct_boxes},
                        {"mean_kernels", statistics.mean_stored},
                        {"nonzero_share", statistics.nonzero_share},
                        {"share_of_99_percent", statistics.share_of_99_percent},
                        {"share_of_95_percent", statistics.share_of_95_percent}};
  json["errors"] = Json::object();
  for (const ReferenceErrors& errors : figures.errors)
    json["errors"][errors.reference] = kinds_and_images_json(errors.kinds);
  return json;
}

}  // namespace

Json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                  const std::vector<ChosenPixel>& pixels) {
  const CaptureSession& session = input.session;
  Json json;
  json["session"] = {{"folder", text_of(session)},
                     {"width", session.width},
                     {"height", session.height},
                     {"light_width", session.light.width},
                     {"light_height", session.light.height},
                     {"training_images", session.frames_of(FrameRole::train).size()},
                     {"held_out_images", session.frames_of(FrameRole::test).size()}};
  json["fields"] = Json::array();
  for (std::size_t f = 0; f < figures.size(); ++f)
    json["fields"].push_back(field_json(input.fields[f], figures[f]));
  json["pixels"] = Json::array();
  for (const ChosenPixel& pixel : pixels)
    json["pixels"].push_back({{"x", pixel.x}, {"y", pixel.y}, {"kind", pixel.kind}});
  return json;
}

}  // namespace refield::report
