// SPDX-License-Identifier: Apache-2.0
#include "core/field_content.h"

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "core/errors.h"
#include "core/precomputed_content.h"
#include "core/reflectance_field_file.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr const char* field_format_name = "refield reflectance field";
constexpr const char* part_format_name = "refield reflectance field part";
constexpr std::uint64_t max_pixels = 1ull << 32;

/// Everything that a reader asks for.
constexpr std::array data_set_names = {
    "basis/boxes",
    "basis/monitors",
    "transfer/row_start",
    "transfer/column",
    "transfer/weight",
    "tiles/start",
    "tiles/memory",
    "statistics/training_error",
    "statistics/error_evidence",
    "statistics/learning_curve",
    "statistics/predicted_error",
    "statistics/photograph_noise",
    mesh_data_set_names[0],
    mesh_data_set_names[1],
    mesh_data_set_names[2],
    mesh_data_set_names[3],
    mesh_data_set_names[4],
};

constexpr const char* monitors_name = "basis/monitors";
constexpr std::size_t numbers_of_a_monitor = 8;

void write_monitors(const Hdf5Writer& writer, const std::vector<MonitorPlacement>& monitors) {
  std::vector<double> numbers;
  for (const MonitorPlacement& m : monitors)
    numbers.insert(numbers.end(), {m.width_mm, m.height_mm, m.distance_mm, m.turn.yaw, m.turn.pitch,
                                   m.turn.roll, m.offset_x_mm, m.offset_y_mm});
  writer.dataset(monitors_name, numbers.data(), {monitors.size(), numbers_of_a_monitor});
}

std::vector<MonitorPlacement> read_monitors(const Hdf5Values& values, const LightDomain& domain) {
  std::vector<MonitorPlacement> monitors;
  const auto numbers = values.dataset<double>(monitors_name, numbers_of_a_monitor);
  for (std::size_t i = 0; i < numbers.size(); i += numbers_of_a_monitor) {
    const double* m = numbers.data() + i;
    monitors.push_back({m[0], m[1], m[2], {m[3], m[4], m[5]}, m[6], m[7]});
  }
  try {
    check_placements(monitors, domain, monitors_name);
  } catch (const InputError& error) {
    values.fail(error.what());
  }
  return monitors;
}

Parameterisation parameterisation_of(const Hdf5Values& values) {
  try {
    return parameterisation_from_name(values.text("light_parameterisation"));
  } catch (const InputError& error) {
    values.fail(error.what());
  }
}

void check_statistics(const ReflectanceField& field, const Hdf5Values& values) {
  const std::uint64_t pixels = static_cast<std::uint64_t>(field.width) * field.height;
  if (!field.training_error.empty() && field.training_error.size() != pixels)
    values.fail("statistics/training_error does not fit the image size");
  if (!field.error_evidence.empty() && field.error_evidence.size() != pixels)
    values.fail("statistics/error_evidence does not fit the image size");
  if (std::ranges::any_of(field.learning_curve, [](const LearningPoint& point) {
        return !(point.share > 0.0f && std::isfinite(point.error) && point.error >= 0.0f);
      }))
    values.fail("statistics/learning_curve holds what is no error");
  for (const auto* map : {&field.predicted_error, &field.photograph_noise}) {
    if (map->size() != field.predicted_error.size() || (!map->empty() && map->size() != pixels))
      values.fail("statistics/predicted_error or photograph_noise does not fit the image size");
    if (std::ranges::any_of(*map, [](float e) { return !std::isfinite(e) || e < 0.0f; }))
      values.fail("statistics/predicted_error or photograph_noise holds what is no error");
  }
}

}  // namespace

void write_outline(const Hdf5Writer& writer, const ReflectanceField& field, int version,
                   const FieldPart* part) {
  writer.text("format", part ? part_format_name : field_format_name);
  writer.number("version", version);
  writer.number("width", field.width);
  writer.number("height", part ? part->image_height : field.height);
  if (part) {
    writer.number("first_row", part->rows.first);
    writer.number("last_row", part->rows.last);
    writer.text("job", part->job);
  }
  writer.number("light_width", field.basis.domain.width);
  writer.number("light_height", field.basis.domain.height);
  writer.number("hat_columns", field.basis.hats.columns);
  writer.number("hat_rows", field.basis.hats.rows);
  writer.text("light_parameterisation", std::string(name_of(field.basis.domain.parameterisation)));
  writer.text("provenance", field.provenance);
  std::vector<std::int32_t> corners;
  corners.reserve(field.basis.boxes.size() * 4);
  for (const Box& box : field.basis.boxes) corners.insert(corners.end(), {box.x0, box.y0, box.x1, box.y1});
  writer.dataset("basis/boxes", corners.data(), {field.basis.boxes.size(), 4});
  if (!field.monitors.empty()) write_monitors(writer, field.monitors);
  write_precomputed(writer, field);
}

void write_statistics(const Hdf5Writer& writer, const ReflectanceField& field) {
  writer.dataset("statistics/training_error", field.training_error.data(), {field.training_error.size()});
  if (!field.error_evidence.empty()) {
    std::vector<float> evidence;
    for (const ErrorEvidence& pixel : field.error_evidence)
      evidence.insert(evidence.end(), {pixel.leave_one_out, pixel.shared, pixel.cross_validated,
                                       pixel.from_half, pixel.from_quarter});
    writer.dataset("statistics/error_evidence", evidence.data(), {field.error_evidence.size(), 5});
  }
  if (!field.learning_curve.empty()) {
    std::vector<float> points;
    for (const LearningPoint& point : field.learning_curve)
      points.insert(points.end(), {point.share, point.error});
    writer.dataset("statistics/learning_curve", points.data(), {field.learning_curve.size(), 2});
  }
  if (!field.predicted_error.empty()) {
    writer.dataset("statistics/predicted_error", field.predicted_error.data(),
                   {field.predicted_error.size()});
    writer.dataset("statistics/photograph_noise", field.photograph_noise.data(),
                   {field.photograph_noise.size()});
  }
}

std::uint64_t outline_bytes(const ReflectanceField& field) {
  constexpr std::uint64_t structures = 64 << 10;
  return structures + precomputed_bytes(field) + field.provenance.size() +
         field.basis.boxes.size() * sizeof(Box) + field.training_error.size() * sizeof(float) +
         field.error_evidence.size() * sizeof(ErrorEvidence) +
         (field.predicted_error.size() + field.photograph_noise.size()) * sizeof(float);
}

FieldFile open_field(const fs::path& path) {
  static_assert(std::endian::native == std::endian::little, "values are taken from the file as they stand");
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the reflectance field");
  if (!fs::is_regular_file(path, error) || H5Fis_hdf5(path.c_str()) <= 0)
    throw FormatError(path,
                      "is not a reflectance field (no HDF5 file); give a file that 'refield estimate' wrote");
  auto outline = read_hdf5_outline(path, data_set_names);
  if (!outline)
    throw FormatError(path, "cannot be opened as HDF5; the file is damaged or truncated: make it again");
  FieldFile file{{std::move(*outline), path}, false, 0};
  const std::string format = file.values.outline.texts.contains("format") ? file.values.text("format") : "";
  if (format != field_format_name && format != part_format_name)
    throw FormatError(
        path, "is an HDF5 file but not a reflectance field; give a file that 'refield estimate' wrote");
  file.part = format == part_format_name;
  file.version = file.values.number("version");
  if (file.version != reflectance_field_version && (file.version != packed_field_version || file.part))
    throw FormatError(path, "has format version " + std::to_string(file.version) +
                                ", this program reads version " + std::to_string(reflectance_field_version) +
                                " and packed " + std::to_string(packed_field_version) +
                                "; use the matching refield or estimate the field again");
  return file;
}

ReflectanceField read_outline(const Hdf5Values& values) {
  ReflectanceField field;
  field.width = values.number("width");
  field.height = values.number("height");
  field.basis.domain = {values.number("light_width"), values.number("light_height"),
                        parameterisation_of(values)};
  if (field.width <= 0 || field.height <= 0 ||
      static_cast<std::uint64_t>(field.width) * static_cast<std::uint64_t>(field.height) > max_pixels ||
      field.basis.domain.width <= 0 || field.basis.domain.height <= 0)
    values.fail("has impossible dimensions");
  field.basis.hats = {values.number("hat_columns"), values.number("hat_rows")};
  const HatGrid& hats = field.basis.hats;
  if (hats.columns < 0 || hats.rows < 0 || hats.columns > field.basis.domain.width ||
      hats.rows > field.basis.domain.height)
    values.fail("has an impossible grid of hats");
  field.provenance = values.text("provenance");
  read_precomputed(values, field);
  if (values.has(monitors_name)) field.monitors = read_monitors(values, field.basis.domain);
  return field;
}

void read_boxes(const Hdf5Values& values, ReflectanceField& field) {
  const auto corners = values.dataset<std::int32_t>("basis/boxes", 4);
  field.basis.boxes.reserve(corners.size() / 4);
  for (std::size_t k = 0; k < corners.size(); k += 4)
    field.basis.boxes.push_back({corners[k], corners[k + 1], corners[k + 2], corners[k + 3]});
  for (const Box& box : field.basis.boxes)
    if (!box.inside(field.basis.domain.width, field.basis.domain.height))
      values.fail("basis/boxes reaches outside the light map");
}

void read_statistics(const Hdf5Values& values, ReflectanceField& field) {
  field.training_error = values.dataset<float>("statistics/training_error", 1);
  if (values.has("statistics/error_evidence")) {
    const auto evidence = values.dataset<float>("statistics/error_evidence", 5);
    for (std::size_t i = 0; i < evidence.size(); i += 5)
      field.error_evidence.push_back(
          {evidence[i], evidence[i + 1], evidence[i + 2], evidence[i + 3], evidence[i + 4]});
  }
  if (values.has("statistics/learning_curve")) {
    const auto points = values.dataset<float>("statistics/learning_curve", 2);
    for (std::size_t i = 0; i < points.size(); i += 2)
      field.learning_curve.push_back({points[i], points[i + 1]});
  }
  if (values.has("statistics/predicted_error"))
    field.predicted_error = values.dataset<float>("statistics/predicted_error", 1);
  if (values.has("statistics/photograph_noise"))
    field.photograph_noise = values.dataset<float>("statistics/photograph_noise", 1);
  check_statistics(field, values);
}

}  // namespace refield
