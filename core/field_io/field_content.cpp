// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/field_content.h"

#include <hdf5.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>

#include "core/field_io/reflectance_field_file.h"
#include "core/light/cube_map.h"

namespace refield {

namespace {

constexpr const char* field_format_name = "refield reflectance field";
constexpr const char* part_format_name = "refield reflectance field part";
constexpr std::uint64_t max_pixels = 1ull << 32;
/// Limits of light maps: sides as for images, and texels that a machine of 4 GiB can hold once.
constexpr int max_light_side = 1 << 16;
constexpr std::uint64_t max_light_texels = 1ull << 28;
/// Hats need no bytes in the file: a forged grid must not take memory of its own.
constexpr std::uint64_t max_hats = 1ull << 24;

constexpr const char* colour_space_name = "colour_space";
constexpr const char* rec709_name = "lin_rec709";  // as OpenColorIO's configurations call it
constexpr const char* boxes_name = "basis/boxes";
constexpr const char* vector_boxes_name = "basis/vector_boxes";
constexpr const char* vectors_name = "basis/vectors";
constexpr const char* monitors_name = "basis/monitors";
constexpr std::size_t numbers_of_a_monitor = 8;
constexpr const char* observed_name = "basis/observed_light";
constexpr const char* interpolation_name = "basis/interpolation";
constexpr const char* mixing_name = "output_from_primaries";
constexpr const char* light_cells_name = "statistics/light_cells";
constexpr const char* light_directions_name = "statistics/light_directions";
constexpr const char* light_variances_name = "statistics/light_variances";
constexpr const char* measure_name = "light_measure";
constexpr const char* solid_angle_name = "solid_angle";
constexpr const char* harmonics_name = "harmonics_order";
constexpr const char* outgoing_name = "outgoing_order";
constexpr std::size_t numbers_of_a_camera = 12;

/// Everything that a reader asks for.
constexpr std::array data_set_names = {
    boxes_name,
    vector_boxes_name,
    vectors_name,
    monitors_name,
    observed_name,
    interpolation_name,
    mixing_name,
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
    "statistics/training_signal",
    light_cells_name,
    light_directions_name,
    light_variances_name,
    light_class_name,
    "mesh/positions",
    "mesh/normals",
    "mesh/colours",
    "mesh/triangles",
    "mesh/camera",
};

void write_monitors(const Hdf5Writer& writer, const std::vector<MonitorPlacement>& monitors) {
  std::vector<double> numbers;
  for (const MonitorPlacement& m : monitors)
    numbers.insert(numbers.end(), {m.width_mm, m.height_mm, m.distance_mm, m.turn.yaw, m.turn.pitch,
                                   m.turn.roll, m.offset_x_mm, m.offset_y_mm});
  writer.dataset(monitors_name, numbers.data(), {monitors.size(), numbers_of_a_monitor});
}

Parameterisation parameterisation_of(const Hdf5Values& values) {
  try {
    return parameterisation_from_name(values.text("light_parameterisation"));
  } catch (const InputError& error) {
    values.fail(error.what());
  }
}

/// Sizes of the picture, the light map and the grid of hats.
std::string fault_of_sizes(const FieldOutline& field) {
  const auto area = [](int width, int height) {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  };
  const LightDomain& light = field.basis.domain;
  if (field.width <= 0 || field.height <= 0 || area(field.width, field.height) > max_pixels ||
      light.width <= 0 || light.height <= 0)
    return "has impossible dimensions";
  if (light.width > max_light_side || light.height > max_light_side ||
      area(light.width, light.height) > max_light_texels)
    return "has a light map of " + std::to_string(light.width) + "×" + std::to_string(light.height) +
           " texels, more than any that can be estimated with";
  const HatGrid& hats = field.basis.hats;
  if (hats.columns < 0 || hats.rows < 0 || hats.columns > light.width || hats.rows > light.height ||
      area(hats.columns, hats.rows) > max_hats)
    return "has an impossible grid of hats";
  return "";
}

std::string fault_of_boxes(const std::vector<Box>& boxes, const char* name, const LightDomain& domain) {
  const auto inside = [&](const Box& box) { return box.inside(domain.width, domain.height); };
  return std::ranges::all_of(boxes, inside) ? "" : std::string(name) + " reaches outside the light map";
}

void write_boxes(const Hdf5Writer& writer, const char* name, const std::vector<Box>& boxes) {
  std::vector<std::int32_t> corners;
  corners.reserve(boxes.size() * 4);
  for (const Box& box : boxes) corners.insert(corners.end(), {box.x0, box.y0, box.x1, box.y1});
  writer.dataset(name, corners.data(), {boxes.size(), 4});
}

std::string fault_of_monitors(const std::vector<MonitorPlacement>& monitors, const LightDomain& domain) {
  try {
    check_placements(monitors, domain, monitors_name);
    return "";
  } catch (const InputError& error) {
    return error.what();
  }
}

void require_sound(const Hdf5Values& values, const std::string& fault) {
  if (!fault.empty()) values.fail(fault);
}

std::vector<Box> read_box_list(const Hdf5Values& values, const char* name, const LightDomain& domain) {
  const auto corners = values.dataset<std::int32_t>(name, 4);
  std::vector<Box> boxes;
  boxes.reserve(corners.size() / 4);
  for (std::size_t k = 0; k < corners.size(); k += 4)
    boxes.push_back({corners[k], corners[k + 1], corners[k + 2], corners[k + 3]});
  require_sound(values, fault_of_boxes(boxes, name, domain));
  return boxes;
}

/// Boxes that cannot overlap everywhere: each texel of them is visited for each light.
std::vector<Box> read_separate_boxes(const Hdf5Values& values, const char* name, const LightDomain& domain) {
  std::vector<Box> boxes = read_box_list(values, name, domain);
  std::int64_t area = 0;
  for (const Box& box : boxes) area += box.area();
  if (area > std::int64_t{domain.width} * domain.height)
    values.fail(std::string(name) + " has rectangles that overlap");
  return boxes;
}

std::vector<MonitorPlacement> read_monitors(const Hdf5Values& values, const LightDomain& domain) {
  std::vector<MonitorPlacement> monitors;
  const auto numbers = values.dataset<double>(monitors_name, numbers_of_a_monitor);
  for (std::size_t i = 0; i < numbers.size(); i += numbers_of_a_monitor) {
    const double* m = numbers.data() + i;
    monitors.push_back({m[0], m[1], m[2], {m[3], m[4], m[5]}, m[6], m[7]});
  }
  require_sound(values, fault_of_monitors(monitors, domain));
  return monitors;
}

// What the files of fields with precomputed transport hold besides: measure and harmonics of the basis, and
// the mesh. Captured fields have none of it, and their files no trace of it.

/// Three numbers an element.
template <class Triple>
void write_triples(const Hdf5Writer& writer, const char* name, const std::vector<Triple>& triples) {
  using Number = std::remove_cvref_t<decltype(triples[0][0])>;
  static_assert(sizeof(Triple) == 3 * sizeof(Number));
  writer.dataset(name, reinterpret_cast<const Number*>(triples.data()), {triples.size(), 3});
}

template <class Triple>
std::vector<Triple> read_triples(const Hdf5Values& values, const char* name) {
  using Number = std::remove_cvref_t<decltype(std::declval<Triple>()[0])>;
  const std::vector<Number> numbers = values.dataset<Number>(name, 3);
  if constexpr (std::is_same_v<Number, float>)
    if (!std::ranges::all_of(numbers, [](float number) { return std::isfinite(number); }))
      values.fail(std::string(name) + " contains a value that is not a number");
  std::vector<Triple> triples(numbers.size() / 3);
  for (std::size_t i = 0; i < numbers.size(); ++i) triples[i / 3][i % 3] = numbers[i];
  return triples;
}

void write_camera(const Hdf5Writer& writer, const PinholeCamera& camera) {
  std::vector<float> numbers;
  for (const auto* triple : {&camera.position, &camera.target, &camera.up})
    numbers.insert(numbers.end(), {triple->x(), triple->y(), triple->z()});
  numbers.insert(numbers.end(), {camera.vertical_field_of_view_degrees, static_cast<float>(camera.width),
                                 static_cast<float>(camera.height)});
  writer.dataset("mesh/camera", numbers.data(), {1, numbers_of_a_camera});
}

PinholeCamera read_camera(const Hdf5Values& values) {
  constexpr float max_side_px = 1 << 16;
  const auto n = values.dataset<float>("mesh/camera", numbers_of_a_camera);
  if (n.size() != numbers_of_a_camera || !(n[10] >= 1 && n[10] <= max_side_px) ||
      !(n[11] >= 1 && n[11] <= max_side_px))
    values.fail("mesh/camera is not a valid camera");
  PinholeCamera camera{{n[0], n[1], n[2]},      {n[3], n[4], n[5]},     {n[6], n[7], n[8]}, n[9],
                       static_cast<int>(n[10]), static_cast<int>(n[11])};
  try {
    camera.check();
  } catch (const InputError& error) {
    values.fail(error.what());
  }
  return camera;
}

OutputMesh read_mesh(const Hdf5Values& values, const FieldOutline& field) {
  OutputMesh mesh;
  mesh.positions = read_triples<Eigen::Vector3f>(values, "mesh/positions");
  mesh.normals = read_triples<Eigen::Vector3f>(values, "mesh/normals");
  mesh.colours = read_triples<Eigen::Array3f>(values, "mesh/colours");
  mesh.triangles = read_triples<std::array<std::uint32_t, 3>>(values, "mesh/triangles");
  const std::size_t vertices = mesh.positions.size();
  if (vertices == 0 || mesh.normals.size() != vertices || mesh.colours.size() != vertices)
    values.fail("mesh/positions, normals and colours do not fit each other");
  for (const auto& triangle : mesh.triangles)
    if (std::ranges::any_of(triangle, [&](std::uint32_t vertex) { return vertex >= vertices; }))
      values.fail("mesh/triangles refers to a vertex that does not exist");
  if (values.has_number(outgoing_name)) mesh.outgoing_order = values.number(outgoing_name);
  if (mesh.outgoing_order < 0 || mesh.outgoing_order > largest_harmonics_order)
    values.fail("has an impossible order of outgoing harmonics");
  if (field.width != output_image_width || field.height != output_image_height(mesh.outputs()))
    values.fail("has an image that does not fit its mesh");
  if (values.has("mesh/camera")) mesh.camera = read_camera(values);
  return mesh;
}

std::vector<VectorBox> read_vector_boxes(const Hdf5Values& values, const LightBasis& basis) {
  const std::vector<Box> boxes = read_box_list(values, vector_boxes_name, basis.domain);
  const auto vectors = read_triples<Eigen::Vector3f>(values, vectors_name);
  const int side = basis.domain.width;
  const auto on_one_face = [&](const Box& box) { return box.y0 / side == (box.y1 - 1) / side; };
  if (basis.measure != Measure::solid_angle || vectors.size() != boxes.size() ||
      !std::ranges::all_of(boxes, on_one_face))
    values.fail(std::string(vector_boxes_name) + " does not fit the light map's faces or " + vectors_name);
  std::vector<VectorBox> kernels;
  for (std::size_t k = 0; k < boxes.size(); ++k) kernels.push_back({boxes[k], vectors[k]});
  return kernels;
}

void write_precomputed(const Hdf5Writer& writer, const FieldOutline& field) {
  if (field.basis.measure == Measure::solid_angle) writer.text(measure_name, solid_angle_name);
  if (field.basis.harmonics.order > 0) writer.number(harmonics_name, field.basis.harmonics.order);
  if (!field.basis.vector_boxes.empty()) {
    std::vector<Box> boxes;
    std::vector<Eigen::Vector3f> vectors;
    for (const VectorBox& kernel : field.basis.vector_boxes) {
      boxes.push_back(kernel.box);
      vectors.push_back(kernel.vector);
    }
    write_boxes(writer, vector_boxes_name, boxes);
    write_triples(writer, vectors_name, vectors);
  }
  if (!field.mesh) return;
  const OutputMesh& mesh = *field.mesh;
  if (mesh.outgoing_order > 0) writer.number(outgoing_name, mesh.outgoing_order);
  writer.group("mesh");
  write_triples(writer, "mesh/positions", mesh.positions);
  write_triples(writer, "mesh/normals", mesh.normals);
  write_triples(writer, "mesh/colours", mesh.colours);
  write_triples(writer, "mesh/triangles", mesh.triangles);
  if (mesh.camera) write_camera(writer, *mesh.camera);
}

std::uint64_t precomputed_bytes(const FieldOutline& field) {
  if (!field.mesh) return 0;
  return field.mesh->positions.size() * 9 * sizeof(float) +
         field.mesh->triangles.size() * 3 * sizeof(std::uint32_t);
}

void read_precomputed(const Hdf5Values& values, FieldOutline& field) {
  LightBasis& basis = field.basis;
  if (values.outline.texts.contains(measure_name)) {
    if (values.text(measure_name) != solid_angle_name)
      values.fail("measures light by '" + values.text(measure_name) +
                  "', which this version does not support");
    basis.measure = Measure::solid_angle;
    if (basis.domain != cube_domain(basis.domain.width))
      values.fail("measures light by solid angle, but not over a cube map");
  }
  if (values.has_number(harmonics_name)) basis.harmonics.order = values.number(harmonics_name);
  if (basis.harmonics.order < 0 || basis.harmonics.order > largest_harmonics_order ||
      basis.harmonics.order > basis.domain.width ||
      (basis.harmonics.order > 0 && basis.measure != Measure::solid_angle))
    values.fail("has impossible harmonics");
  if (values.has(vector_boxes_name)) basis.vector_boxes = read_vector_boxes(values, basis);
  if (values.has("mesh/positions")) field.mesh = read_mesh(values, field);
}

}  // namespace

void write_outline(const Hdf5Writer& writer, const FieldOutline& field, int version, const FieldPart* part) {
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
  if (field.colour_space == ColourSpace::rec709) writer.text(colour_space_name, rec709_name);
  writer.text("provenance", field.provenance);
  write_boxes(writer, boxes_name, field.basis.boxes);
  if (!field.observed_light.empty()) write_boxes(writer, observed_name, field.observed_light);
  if (const auto& interpolation = field.basis.interpolation) {
    const std::array numbers = {interpolation->length, interpolation->fine_share, interpolation->fine_length,
                                interpolation->reach};
    writer.dataset(interpolation_name, numbers.data(), {1, numbers.size()});
  }
  if (const LightErrorModel& model = field.quality.light_error; model.known()) {
    write_boxes(writer, light_cells_name, model.cells);
    const std::size_t count = model.cells.size();
    writer.dataset(light_directions_name, model.directions.data(), {model.directions.size() / count, count});
    writer.dataset(light_variances_name, model.variances.data(), {model.classes(), count});
  }
  if (field.mixes_colours()) {
    const Eigen::Matrix3f columns = field.output_from_primaries.transpose();  // rows, as the file has them
    writer.dataset(mixing_name, columns.data(), {3, 3});
  }
  if (!field.monitors.empty()) write_monitors(writer, field.monitors);
  write_precomputed(writer, field);
}

std::string fault_of_statistics(const FieldOutline& field) {
  const FieldQuality& quality = field.quality;
  const std::uint64_t pixels = static_cast<std::uint64_t>(field.width) * field.height;
  const auto is_no_error = [](float e) { return !std::isfinite(e) || e < 0.0f; };
  if (!quality.training_error.empty() && quality.training_error.size() != pixels)
    return "statistics/training_error does not fit the image size";
  if (std::ranges::any_of(quality.training_error, is_no_error))
    return "statistics/training_error contains an invalid error";
  if (std::ranges::any_of(quality.learning_curve, [&](const LearningPoint& point) {
        return !(point.share > 0.0f) || is_no_error(point.error);
      }))
    return "statistics/learning_curve contains an invalid error";
  if (!quality.training_signal.empty() && quality.training_signal.size() != pixels)
    return "statistics/training_signal does not fit the image size";
  if (std::ranges::any_of(quality.training_signal, is_no_error))
    return "statistics/training_signal contains an invalid value";
  const LightErrorModel& model = quality.light_error;
  if (!model.is_sound())
    return "statistics/light_directions or light_variances does not fit statistics/light_cells";
  if (std::ranges::any_of(model.directions, [](float value) { return !std::isfinite(value); }) ||
      std::ranges::any_of(model.variances, is_no_error))
    return "statistics/light_directions or light_variances contains an invalid value";
  if (quality.light_class.size() != (model.classes() > 1 ? quality.training_signal.size() : 0) ||
      std::ranges::any_of(quality.light_class, [&](std::uint32_t of) { return of >= model.classes(); }))
    return "statistics/light_class does not fit statistics/light_variances and training_signal";
  if (model.known() && quality.training_signal.size() < quality.predicted_error.size())
    return "statistics/training_signal is missing";
  for (const auto* map : {&quality.predicted_error, &quality.photograph_noise}) {
    if (map->size() != quality.predicted_error.size() || (!map->empty() && map->size() != pixels))
      return "statistics/predicted_error or photograph_noise does not fit the image size";
    if (std::ranges::any_of(*map, is_no_error))
      return "statistics/predicted_error or photograph_noise contains an invalid error";
  }
  return "";
}

std::string fault_of_outline(const FieldOutline& field) {
  if (std::string fault = fault_of_sizes(field); !fault.empty()) return fault;
  if (std::string fault = fault_of_boxes(field.basis.boxes, boxes_name, field.basis.domain); !fault.empty())
    return fault;
  if (!field.monitors.empty())
    if (std::string fault = fault_of_monitors(field.monitors, field.basis.domain); !fault.empty())
      return fault;
  return "";
}

namespace {

/// With all threads.
template <class T, class Is>
bool any_of(const FileVector<T>& values, const Is& is) {
  constexpr std::size_t stretch = std::size_t{1} << 20;
  std::atomic<bool> found = false;
  tbb::parallel_for(std::size_t{0}, (values.size() + stretch - 1) / stretch, [&](std::size_t i) {
    const std::size_t first = i * stretch, last = std::min(first + stretch, values.size());
    if (std::any_of(values.begin() + static_cast<std::ptrdiff_t>(first),
                    values.begin() + static_cast<std::ptrdiff_t>(last), is))
      found = true;
    pass_by(values, first, last);
  });
  return found;
}

}  // namespace

std::string fault_of_transfer(const SparseTransfer& transfer, std::uint64_t pixels, std::size_t kernels) {
  if (transfer.row_start.size() != pixels + 1 || transfer.row_start.front() != 0 ||
      transfer.row_start.back() != transfer.column.size() || !std::ranges::is_sorted(transfer.row_start))
    return "transfer/row_start does not fit the image size";
  if (transfer.weight.size() != transfer.column.size() * 3)
    return "transfer/weight does not fit transfer/column";
  if (any_of(transfer.column, [&](std::uint32_t k) { return k >= kernels; }))
    return "transfer/column refers to a kernel that does not exist";
  if (any_of(transfer.weight, [](float w) { return !std::isfinite(w); }))
    return "transfer/weight holds a weight that is not finite";
  return "";
}

std::string fault_of_rows(const ReflectanceField& field) {
  const std::string fault = fault_of_outline(field);
  return !fault.empty()
             ? fault
             : fault_of_transfer(field.transfer, static_cast<std::uint64_t>(field.width) * field.height,
                                 field.basis.size());
}

void require_readable(const std::string& fault, const fs::path& destination) {
  if (!fault.empty())
    throw SolverError(destination.string() + ": was not written, because it could not be read again (" +
                      fault +
                      "); the photographs or light maps may hold values too large or too small for the "
                      "computation; scale them and run again");
}

void write_statistics(const Hdf5Writer& writer, const FieldQuality& quality,
                      std::span<const ErrorEvidence> evidence) {
  const auto write = [&](const char* name, const auto& values) {
    if (!values.empty()) writer.dataset(name, values.data(), {values.size()});
  };
  writer.dataset("statistics/training_error", quality.training_error.data(), {quality.training_error.size()});
  if (!evidence.empty()) {
    std::vector<float> numbers;
    for (const ErrorEvidence& pixel : evidence)
      numbers.insert(numbers.end(), {pixel.leave_one_out, pixel.noise, pixel.samples, pixel.cross_validated,
                                     pixel.from_half, pixel.from_quarter, pixel.expected});
    writer.dataset("statistics/error_evidence", numbers.data(), {evidence.size(), 7});
  }
  if (!quality.learning_curve.empty()) {
    std::vector<float> points;
    for (const LearningPoint& point : quality.learning_curve)
      points.insert(points.end(), {point.share, point.error});
    writer.dataset("statistics/learning_curve", points.data(), {quality.learning_curve.size(), 2});
  }
  write("statistics/training_signal", quality.training_signal);
  write(light_class_name, quality.light_class);
  write("statistics/predicted_error", quality.predicted_error);
  write("statistics/photograph_noise", quality.photograph_noise);
}

std::uint64_t outline_bytes(const FieldOutline& field) {
  constexpr std::uint64_t structures = 64 << 10;
  return structures + precomputed_bytes(field) + field.provenance.size() +
         field.basis.boxes.size() * sizeof(Box) + field.basis.vector_boxes.size() * sizeof(VectorBox) +
         field.quality.training_error.size() * sizeof(float) +
         field.quality.light_error.cells.size() * sizeof(Box) +
         (field.quality.predicted_error.size() + field.quality.photograph_noise.size() +
          field.quality.training_signal.size() + field.quality.light_class.size() +
          field.quality.light_error.directions.size() + field.quality.light_error.variances.size()) *
             sizeof(float);
}

FieldFile open_field(const fs::path& path, const RunContext& run) {
  static_assert(std::endian::native == std::endian::little, "values are taken from the file as they stand");
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the reflectance field");
  if (!fs::is_regular_file(path, error) || H5Fis_hdf5(path.c_str()) <= 0)
    throw FormatError(path,
                      "is not a reflectance field (no HDF5 file); give a file written by 'refield estimate'");
  auto outline = read_hdf5_outline(path, data_set_names, run);
  if (!outline)
    throw FormatError(path, "cannot be opened as HDF5; the file is damaged or truncated: make it again");
  FieldFile file{{std::move(*outline), path}, false, 0};
  if (const auto& refused = file.values.outline.refused; !refused.empty())
    throw FormatError(path, "data set '" + refused.begin()->first + "' is " + refused.begin()->second +
                                "; a field must be complete and uncompressed in one file; create it again");
  const std::string format = file.values.outline.texts.contains("format") ? file.values.text("format") : "";
  if (format != field_format_name && format != part_format_name)
    throw FormatError(
        path, "is an HDF5 file but not a reflectance field; give a file written by 'refield estimate'");
  file.part = format == part_format_name;
  file.version = file.values.number("version");
  if (file.version != reflectance_field_version && (file.version != packed_field_version || file.part))
    throw FormatError(path, "has format version ", file.version, ", this program reads version ",
                      reflectance_field_version, " and packed ", packed_field_version,
                      "; use the matching refield or estimate the field again");
  return file;
}

FieldOutline read_outline(const Hdf5Values& values) {
  FieldOutline field;
  field.width = values.number("width");
  field.height = values.number("height");
  field.basis.domain = {values.number("light_width"), values.number("light_height"),
                        parameterisation_of(values)};
  field.basis.hats = {values.number("hat_columns"), values.number("hat_rows")};
  require_sound(values, fault_of_sizes(field));
  if (values.outline.texts.contains(colour_space_name)) {
    if (values.text(colour_space_name) != rec709_name)
      values.fail("is in the colour space '" + values.text(colour_space_name) +
                  "', which this version does not support");
    field.colour_space = ColourSpace::rec709;
  }
  field.provenance = values.text("provenance");
  if (values.has(mixing_name)) {
    const auto numbers = values.dataset<float>(mixing_name, 3);
    if (numbers.size() != 9 || !std::ranges::all_of(numbers, [](float v) { return std::isfinite(v); }))
      values.fail(std::string(mixing_name) + " is not a matrix of 3 × 3 numbers");
    field.output_from_primaries =
        Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(numbers.data());
  }
  read_precomputed(values, field);
  if (values.has(monitors_name)) field.monitors = read_monitors(values, field.basis.domain);
  if (values.has(observed_name))
    field.observed_light = read_separate_boxes(values, observed_name, field.basis.domain);
  if (values.has(interpolation_name)) {
    const auto numbers = values.dataset<double>(interpolation_name, 4);
    if (numbers.size() != 4) values.fail(std::string(interpolation_name) + " is not one row of 4 numbers");
    const auto& interpolation = field.basis.interpolation.emplace(
        LightInterpolation{field.observed_light, numbers[0], numbers[1], numbers[2], numbers[3]});
    if (const std::string fault = interpolation.fault(field.basis.domain); !fault.empty())
      values.fail(std::string(interpolation_name) + " " + fault);
  }
  if (values.has(light_cells_name) && values.has(light_directions_name) && values.has(light_variances_name)) {
    LightErrorModel& model = field.quality.light_error;
    model.cells = read_separate_boxes(values, light_cells_name, field.basis.domain);
    model.directions = values.dataset<float>(light_directions_name, model.cells.size());
    model.variances = values.dataset<float>(light_variances_name, model.cells.size());
  }
  return field;
}

void read_boxes(const Hdf5Values& values, FieldOutline& field) {
  field.basis.boxes = read_box_list(values, boxes_name, field.basis.domain);
}

std::vector<ErrorEvidence> read_error_evidence(const Hdf5Values& values, std::size_t pixels) {
  if (!values.has("statistics/error_evidence")) return {};
  const auto numbers = values.dataset<float>("statistics/error_evidence", 7);
  if (numbers.size() != pixels * 7) values.fail("statistics/error_evidence does not fit the image size");
  std::vector<ErrorEvidence> evidence;
  evidence.reserve(pixels);
  for (std::size_t i = 0; i < numbers.size(); i += 7)
    evidence.push_back({.leave_one_out = numbers[i],
                        .noise = numbers[i + 1],
                        .samples = numbers[i + 2],
                        .expected = numbers[i + 6],
                        .cross_validated = numbers[i + 3],
                        .from_half = numbers[i + 4],
                        .from_quarter = numbers[i + 5]});
  return evidence;
}

void read_statistics(const Hdf5Values& values, FieldOutline& field) {
  FieldQuality& quality = field.quality;
  quality.training_error = values.dataset<float>("statistics/training_error", 1);
  if (values.has("statistics/learning_curve")) {
    const auto points = values.dataset<float>("statistics/learning_curve", 2);
    for (std::size_t i = 0; i < points.size(); i += 2)
      quality.learning_curve.push_back({points[i], points[i + 1]});
  }
  const auto read = [&]<class Value>(const char* name, std::vector<Value>& numbers) {
    if (values.has(name)) numbers = values.dataset<Value>(name, 1);
  };
  read("statistics/predicted_error", quality.predicted_error);
  read("statistics/training_signal", quality.training_signal);
  read(light_class_name, quality.light_class);
  read("statistics/photograph_noise", quality.photograph_noise);
  require_sound(values, fault_of_statistics(field));
}

}  // namespace refield
