// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <sstream>

#include "acquire/capture/session_writer.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/field/field_statistics.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "estimate/rig/verdict.h"

namespace refield::cli {

namespace {

Json size_of(int width, int height) {
  return {{"width", width}, {"height", height}};
}

Json describe(const LightDomain& domain, const std::vector<MonitorPlacement>& monitors) {
  Json light = size_of(domain.width, domain.height);
  light["parameterisation"] = name_of(domain.parameterisation);
  for (const MonitorPlacement& monitor : monitors) light["monitors"].push_back(text_of(monitor));
  return light;
}

/// The cap on kernels that the field was estimated with, as its provenance says; 0 when it does not.
int kernel_cap(const Json& provenance) {
  if (!provenance.is_object()) return 0;
  const auto kernels = provenance.find("kernels");
  return kernels != provenance.end() && kernels->is_number_integer() ? kernels->get<int>() : 0;
}

/// What light is summed over.
Json describe(const LightBasis& basis) {
  Json described;
  if (basis.hats.count() > 0) described["hats"] = {basis.hats.columns, basis.hats.rows};
  if (basis.harmonics.order > 0) described["harmonics_order"] = basis.harmonics.order;
  if (!basis.vector_boxes.empty()) described["vector_boxes"] = basis.vector_boxes.size();
  described["boxes"] = basis.boxes.size();
  described["sums"] = basis.measure == Measure::texels ? "texels" : "radiance times solid angle";
  return described;
}

Json describe(const SparseTransfer& transfer) {
  return {{"stored", "rows"}, {"weight_bits", 32}, {"entries", transfer.entries()}};
}

Json describe(const TransferTiles& tiles) {
  std::uint64_t weights = 0;
  bool grey = true;
  std::visit(
      [&](const auto& transfer) {
        for (int at = 0; at < transfer.tiles(); ++at) {
          const auto tile = transfer.tile(at);
          weights += tile.record_weight.size() + 3 * tile.sparse.size();
          grey = grey && tile.is_grey();
        }
      },
      tiles);
  return {{"stored", "tiles"},
          {"weight_bits", tiles.index() == 0 ? 8 : 16},
          {"weights", weights},
          {"channels", grey ? 1 : 3}};
}

Json describe(const OutputMesh& mesh) {
  return {{"vertices", mesh.positions.size()},
          {"triangles", mesh.triangles.size()},
          {"outputs_per_vertex", mesh.outputs() / std::max<std::size_t>(1, mesh.positions.size())}};
}

Json provenance_of(const FieldOutline& field) {
  Json provenance = json_if_valid(field.provenance);
  if (provenance.is_discarded()) provenance = field.provenance;
  return provenance;
}

/// Of precomputed transport: no statistics of estimation, and no rows made from tiles, which memory might
/// not hold.
Json describe_precomputed(const fs::path& path, const FieldOutline& outline, Json transfer) {
  Json info{{"kind", "precomputed reflectance field"},
            {"format_version", reflectance_field_version},
            {"bytes", fs::file_size(path)}};
  if (outline.mesh)
    info["mesh"] = describe(*outline.mesh);
  else
    info["image"] = size_of(outline.width, outline.height);
  info["light"] = describe(outline.basis.domain, outline.monitors);
  info["basis"] = describe(outline.basis);
  info["transfer"] = std::move(transfer);
  info["provenance"] = provenance_of(outline);
  return info;
}

bool is_precomputed(const FieldOutline& field) {
  return field.basis.measure == Measure::solid_angle;
}

Json describe_field(const fs::path& path, const ReflectanceField& field) {
  Json provenance = provenance_of(field);
  const KernelStatistics kernels = kernel_statistics(field, kernel_cap(provenance));
  Json info{{"kind", "reflectance field"},
            {"format_version", reflectance_field_version},
            {"bytes", fs::file_size(path)},
            {"image", size_of(field.width, field.height)},
            {"colour_space", name_of(field.colour_space)},
            {"light", describe(field.basis.domain, field.monitors)},
            {"basis", describe(field.basis)},
            {"transfer", describe(field.transfer)},
            {"pixels_in_scene", kernels.pixels},
            {"distinct_boxes", kernels.distinct_boxes},
            {"kernels",
             {{"allowed", kernels.kernels},
              {"stored", kernels.stored},
              {"mean_per_pixel", kernels.mean_stored},
              {"nonzero_percent", 100.0 * kernels.nonzero_share},
              {"percent_for_99_percent_of_energy", 100.0 * kernels.share_of_99_percent},
              {"percent_for_95_percent_of_energy", 100.0 * kernels.share_of_95_percent},
              {"pixels_by_number_of_kernels", kernels.histogram}}}};
  if (!field.quality.training_error.empty())
    info["training_error"] = {{"median", quantile(field.quality.training_error, 0.5)},
                              {"percentile_90", quantile(field.quality.training_error, 0.9)}};
  if (!field.quality.predicted_error.empty()) {
    std::vector<float> predicted, noise;
    for (std::size_t p = 0; p < field.quality.predicted_error.size(); ++p)
      if (field.quality.predicted_error[p] > 0.0f) {
        predicted.push_back(field.quality.predicted_error[p]);
        noise.push_back(field.quality.photograph_noise[p]);
      }
    info["predicted_error"] = {{"median", quantile(predicted, 0.5)},
                               {"percentile_90", quantile(predicted, 0.9)},
                               {"photograph_noise_median", quantile(noise, 0.5)}};
    if (const LearningCurve curve(field.quality.learning_curve, quantile(noise, 0.5)); curve.known())
      info["more_images"] = curve.advice();
  }
  info["provenance"] = std::move(provenance);
  return info;
}

Json describe_whole_field(const fs::path& path) {
  auto either = read_either_field(path, run_context());
  if (const auto* field = std::get_if<ReflectanceField>(&either)) {
    if (!is_precomputed(*field)) return describe_field(path, *field);
    return describe_precomputed(path, *field, describe(field->transfer));
  }
  auto& packed = std::get<PackedField>(either);
  const Json transfer = describe(packed.tiles);
  Json info = is_precomputed(packed.outline) ? describe_precomputed(path, packed.outline, transfer)
                                             : describe_field(path, expand(std::move(packed)));
  if (info["kind"] == "reflectance field") info["kind"] = "packed reflectance field";
  info["format_version"] = packed_field_version;
  info["transfer"] = transfer;
  return info;
}

Json describe_part(const fs::path& path) {
  const FieldPart part = read_field_part(path, run_context());
  Json info = describe_field(path, part.field);
  info["kind"] = "part of a reflectance field";
  info["rows"] = {part.rows.first, part.rows.last};
  info["whole_image"] = size_of(part.field.width, part.image_height);
  info["job"] = part.job;
  return info;
}

/// The check that an estimation makes before it fits; none where frames are too few to be compared.
std::optional<CaptureVerdict> checked(const CaptureSession& session) {
  if (std::ssize(session.frames_of(FrameRole::train)) < min_frames_to_assess) return std::nullopt;
  return check_capture(session, {}, run_context());
}

Json describe_session(const fs::path& folder) {
  const CaptureSession session = read_capture_session(folder);
  std::map<std::string, std::map<std::string, int>> counts;
  std::size_t with_sigma = 0;
  for (const CaptureFrame& frame : session.frames) {
    ++counts[std::string(name_of(frame.role))][frame.kind.empty() ? "unnamed" : frame.kind];
    with_sigma += read_image_header(frame.observed).has_sigma;
  }
  Json info{{"kind", "capture session"},
            {"image", size_of(session.width, session.height)},
            {"colour_space", name_of(session.colour_space())},
            {"light", describe(session.light, session.monitors)},
            {"frames", session.frames.size()},
            {"frames_by_role_and_kind", counts},
            {"frames_with_noise_estimate", with_sigma},
            {"ambient_frame", session.ambient.has_value()}};
  if (const auto& colour = session.colour)
    info["colour_chart"] = {{"photograph", colour->chart},
                            {"delta_e_2000_median", colour->median_delta_e},
                            {"delta_e_2000_largest", colour->largest_delta_e}};
  if (session.mask) {
    const Mask mask = read_mask(*session.mask, session.width, session.height);
    info["pixels_in_scene"] = std::ranges::count_if(mask, [](unsigned char m) { return m != 0; });
  }
  return info;
}

Json describe_values(const Image& image) {
  float low = INFINITY;
  float high = -INFINITY;
  double sum = 0.0;
  std::size_t finite = 0, nan = 0, infinite = 0, negative = 0;
  for (const float value : image.values) {
    nan += std::isnan(value);
    infinite += std::isinf(value);
    if (!std::isfinite(value)) continue;
    negative += value < 0.0f;
    low = std::min(low, value);
    high = std::max(high, value);
    sum += value;
    ++finite;
  }
  Json values{{"nan", nan}, {"infinite", infinite}, {"negative", negative}};
  if (finite > 0) {
    values["lowest"] = low;
    values["mean"] = sum / static_cast<double>(finite);
    values["highest"] = high;
  }
  return values;
}

Json describe_image(const fs::path& path) {
  const ImageHeader header = read_image_header(path);
  return {{"kind", "image"},
          {"bytes", fs::file_size(path)},
          {"image", size_of(header.width, header.height)},
          {"has_noise_estimate", header.has_sigma},
          {"radiance", describe_values(read_image(path))}};
}

Json describe_path(const fs::path& path) {
  if (fs::is_directory(path)) return describe_session(path);
  if (path.extension() == ".rfield")
    return is_field_part(path, run_context()) ? describe_part(path) : describe_whole_field(path);
  return describe_image(path);
}

/// What the import wrote of itself, line by line.
std::vector<std::string> notes_of(const fs::path& session) {
  std::vector<std::string> notes;
  if (!fs::is_regular_file(session / session_notes_name)) return notes;
  std::istringstream lines(read_text(session / session_notes_name));
  for (std::string line; std::getline(lines, line);) notes.push_back(line);
  return notes;
}

}  // namespace

void add_info(CLI::App& app, const Common& common, Action& action) {
  const auto path = std::make_shared<fs::path>();
  CLI::App* verb = app.add_subcommand(
      "info",
      "Print a summary of a reflectance field, capture session or image.\n"
      "\n"
      "The photographs of a session are checked as an estimation does before it fits: pairing, camera "
      "motion, colours, tone curve, brightness, room light, drift, clipping, noise and outlier frames, each "
      "with its effect on the error and a remedy.\n"
      "\n"
      "Examples:\n"
      "  refield info scene.rfield\n"
      "  refield info session --json");
  verb->add_option("file", *path, "File: reflectance field (.rfield), session folder or image")->required();
  verb->callback([path, &common, &action] {
    action = [path, &common] {
      Json info = describe_path(*path);
      std::optional<CaptureVerdict> verdict;
      if (fs::is_directory(*path)) verdict = checked(read_capture_session(*path));
      const std::vector<std::string> notes = notes_of(*path);
      if (!notes.empty() && common.json) info["import_notes"] = notes;
      if (verdict && common.json) info["check"] = verdict_json(*verdict);
      if (common.json)
        print_json(info);
      else
        print_figures(info);
      if (common.json) return;
      if (verdict) std::printf("%s", verdict_table(*verdict).c_str());
      for (const std::string& note : notes)
        std::printf("  import          note        %s\n", printable(note).c_str());
    };
  });
}

}  // namespace refield::cli
