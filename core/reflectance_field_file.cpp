// SPDX-License-Identifier: Apache-2.0
#include "core/reflectance_field_file.h"

#include <hdf5.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <type_traits>
#include <utility>

#include "core/errors.h"
#include "core/field_part.h"
#include "core/files.h"
#include "core/hdf5_outline.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr const char* format_name = "refield reflectance field";
constexpr const char* part_format_name = "refield reflectance field part";
constexpr const char* crc_name = "crc32";
constexpr std::uint64_t max_pixels = 1ull << 32;

/// An HDF5 identifier, closed by its own kind of close.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close_function)(hid_t)) : id_(id), close_(close_function) {}
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&&) = delete;
  operator hid_t() const { return id_; }
  bool valid() const { return id_ >= 0; }
  /// Closes now and says whether all of it reached the file.
  bool close() {
    const herr_t status = close_(id_);
    id_ = -1;
    return status >= 0;
  }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// HDF5 prints its error stack by default; ours go through exceptions.
struct SilencedErrors {
  SilencedErrors() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }
};

template <class T>
hid_t native_type() {
  if constexpr (std::is_same_v<T, float>)
    return H5T_NATIVE_FLOAT;
  else if constexpr (std::is_same_v<T, double>)
    return H5T_NATIVE_DOUBLE;
  else if constexpr (std::is_same_v<T, std::int32_t>)
    return H5T_NATIVE_INT32;
  else if constexpr (std::is_same_v<T, std::uint32_t>)
    return H5T_NATIVE_UINT32;
  else
    return H5T_NATIVE_UINT64;
}

template <class T>
hid_t stored_type() {
  if constexpr (std::is_same_v<T, float>)
    return H5T_IEEE_F32LE;
  else if constexpr (std::is_same_v<T, double>)
    return H5T_IEEE_F64LE;
  else if constexpr (std::is_same_v<T, std::int32_t>)
    return H5T_STD_I32LE;
  else if constexpr (std::is_same_v<T, std::uint32_t>)
    return H5T_STD_U32LE;
  else
    return H5T_STD_U64LE;
}

template <class T>
std::string_view stored_type_name() {
  if constexpr (std::is_same_v<T, float>)
    return "f4";
  else if constexpr (std::is_same_v<T, double>)
    return "f8";
  else if constexpr (std::is_same_v<T, std::int32_t>)
    return "i4";
  else if constexpr (std::is_same_v<T, std::uint32_t>)
    return "u4";
  else
    return "u8";
}

/// CRC-32 as zlib, PNG and Python's zlib.crc32 define it. HDF5 guards its own structures by checksums, not
/// the values.
std::uint32_t crc32_of(const void* values, std::size_t bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(crc32_z(0, nullptr, 0), static_cast<const Bytef*>(values), bytes));
}

struct Writer {
  hid_t file;
  const fs::path& path;

  void check(bool ok) const {
    if (!ok) throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot write the reflectance field");
  }

  template <class T>
  void dataset(const char* name, const T* values, std::initializer_list<hsize_t> shape) const {
    const Handle space(H5Screate_simple(static_cast<int>(shape.size()), shape.begin(), nullptr), H5Sclose);
    const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation, false);
    const Handle set(H5Dcreate2(file, name, stored_type<T>(), space, H5P_DEFAULT, creation, H5P_DEFAULT),
                     H5Dclose);
    check(set.valid());
    const auto count = static_cast<std::size_t>(H5Sget_simple_extent_npoints(space));
    if (count > 0) check(H5Dwrite(set, native_type<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
    const Handle scalar(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle sum(H5Acreate2(set, crc_name, H5T_STD_U32LE, scalar, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    const std::uint32_t crc = crc32_of(values, count * sizeof(T));
    check(sum.valid() && H5Awrite(sum, H5T_NATIVE_UINT32, &crc) >= 0);
  }

  void text(const char* name, const std::string& value) const {
    const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type, std::max<std::size_t>(value.size(), 1));
    H5Tset_strpad(type, H5T_STR_NULLPAD);
    H5Tset_cset(type, H5T_CSET_UTF8);
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle attribute(H5Acreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    check(attribute.valid() && H5Awrite(attribute, type, value.c_str()) >= 0);
  }

  void number(const char* name, std::int32_t value) const {
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle attribute(H5Acreate2(file, name, H5T_STD_I32LE, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    check(attribute.valid() && H5Awrite(attribute, H5T_NATIVE_INT32, &value) >= 0);
  }
};

/// Everything that a reader asks for.
constexpr std::array data_set_names = {
    "basis/boxes",
    "basis/monitors",
    "transfer/row_start",
    "transfer/column",
    "transfer/weight",
    "statistics/training_error",
    "statistics/error_evidence",
    "statistics/learning_curve",
    "statistics/predicted_error",
    "statistics/photograph_noise",
};

struct Reader {
  Hdf5Outline outline;
  const fs::path& path;

  [[noreturn]] void fail(const std::string& what) const {
    throw FormatError(path, what + "; the file is damaged or was not written by refield: make it again");
  }

  bool has(const char* name) const { return outline.data_sets.contains(name); }

  template <class T>
  std::vector<T> dataset(const char* name, std::size_t columns) const {
    const auto fail_set = [&](const char* what) { fail(std::string("data set '") + name + "' " + what); };
    if (!has(name)) fail(std::string("has no data set '") + name + "', uncompressed and in one piece");
    const Hdf5DataSet& set = outline.data_sets.at(name);
    if ((set.shape.size() > 1 ? set.shape[1] : 1) != columns) fail_set("has the wrong shape");
    if (set.type != stored_type_name<T>()) fail_set("has the wrong type");
    // A header may promise more than the file holds.
    const std::uint64_t held = fs::file_size(path), rows = set.shape[0], bytes = rows * columns * sizeof(T);
    if (rows > held || bytes != set.bytes || bytes > held || (bytes > 0 && set.offset > held - bytes))
      fail_set("is truncated");
    std::vector<T> values(rows * columns);
    std::ifstream file(path, std::ios::binary);
    if (bytes > 0 && !file.seekg(static_cast<std::streamoff>(set.offset))
                          .read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(bytes)))
      fail_set("cannot be read");
    // Absent where another program wrote the file and left the checksum out.
    if (set.crc32 && *set.crc32 != crc32_of(values.data(), bytes)) fail_set("does not match its checksum");
    return values;
  }

  const std::string& text(const char* name) const {
    const auto found = outline.texts.find(name);
    if (found == outline.texts.end()) fail(std::string("has no attribute '") + name + "' that is a text");
    return found->second;
  }

  Parameterisation parameterisation() const {
    try {
      return parameterisation_from_name(text("light_parameterisation"));
    } catch (const InputError& error) {
      fail(error.what());
    }
  }

  std::int32_t number(const char* name) const {
    const auto found = outline.numbers.find(name);
    if (found == outline.numbers.end()) fail(std::string("has no attribute '") + name + "' that is a number");
    if (!std::in_range<std::int32_t>(found->second))
      fail(std::string("attribute '") + name + "' is out of range");
    return static_cast<std::int32_t>(found->second);
  }
};

void validate(const ReflectanceField& field, const Reader& reader) {
  const SparseTransfer& transfer = field.transfer;
  const std::uint64_t pixels = static_cast<std::uint64_t>(field.width) * field.height;
  if (transfer.row_start.size() != pixels + 1 || transfer.row_start.front() != 0 ||
      transfer.row_start.back() != transfer.column.size() || !std::ranges::is_sorted(transfer.row_start))
    reader.fail("transfer/row_start does not fit the image size");
  if (transfer.weight.size() != transfer.column.size() * 3)
    reader.fail("transfer/weight does not fit transfer/column");
  if (std::ranges::any_of(transfer.column, [&](std::uint32_t k) { return k >= field.basis.size(); }))
    reader.fail("transfer/column names a kernel that is not there");
  if (std::ranges::any_of(transfer.weight, [](float w) { return !std::isfinite(w) || w < 0.0f; }))
    reader.fail("transfer/weight holds a negative or infinite weight");
  for (const Box& box : field.basis.boxes)
    if (!box.inside(field.basis.domain.width, field.basis.domain.height))
      reader.fail("basis/boxes reaches outside the light map");
  if (!field.training_error.empty() && field.training_error.size() != pixels)
    reader.fail("statistics/training_error does not fit the image size");
  if (!field.error_evidence.empty() && field.error_evidence.size() != pixels)
    reader.fail("statistics/error_evidence does not fit the image size");
  if (std::ranges::any_of(field.learning_curve, [](const LearningPoint& point) {
        return !(point.share > 0.0f && std::isfinite(point.error) && point.error >= 0.0f);
      }))
    reader.fail("statistics/learning_curve holds what is no error");
  for (const auto* map : {&field.predicted_error, &field.photograph_noise}) {
    if (map->size() != field.predicted_error.size() || (!map->empty() && map->size() != pixels))
      reader.fail("statistics/predicted_error or photograph_noise does not fit the image size");
    if (std::ranges::any_of(*map, [](float e) { return !std::isfinite(e) || e < 0.0f; }))
      reader.fail("statistics/predicted_error or photograph_noise holds what is no error");
  }
}

constexpr const char* monitors_name = "basis/monitors";
constexpr std::size_t numbers_of_a_monitor = 8;

void write_monitors(const Writer& writer, const std::vector<MonitorPlacement>& monitors) {
  std::vector<double> numbers;
  for (const MonitorPlacement& m : monitors)
    numbers.insert(numbers.end(), {m.width_mm, m.height_mm, m.distance_mm, m.turn.yaw, m.turn.pitch,
                                   m.turn.roll, m.offset_x_mm, m.offset_y_mm});
  writer.dataset(monitors_name, numbers.data(), {monitors.size(), numbers_of_a_monitor});
}

std::vector<MonitorPlacement> read_monitors(const Reader& reader, const LightDomain& domain) {
  std::vector<MonitorPlacement> monitors;
  const auto numbers = reader.dataset<double>(monitors_name, numbers_of_a_monitor);
  for (std::size_t i = 0; i < numbers.size(); i += numbers_of_a_monitor) {
    const double* m = numbers.data() + i;
    monitors.push_back({m[0], m[1], m[2], {m[3], m[4], m[5]}, m[6], m[7]});
  }
  try {
    check_placements(monitors, domain, monitors_name);
  } catch (const InputError& error) {
    reader.fail(error.what());
  }
  return monitors;
}

/// What the file will take, HDF5's own structures included.
std::uint64_t content_bytes(const ReflectanceField& field) {
  constexpr std::uint64_t structures = 64 << 10;
  return structures + field.provenance.size() + field.basis.boxes.size() * sizeof(Box) +
         field.transfer.row_start.size() * sizeof(std::uint64_t) +
         field.transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float)) +
         field.training_error.size() * sizeof(float) + field.error_evidence.size() * sizeof(ErrorEvidence) +
         (field.predicted_error.size() + field.photograph_noise.size()) * sizeof(float);
}

/// `part` is null for a whole field, else it says which rows these are.
void write_field(const fs::path& path, const ReflectanceField& field, const FieldPart* part) {
  const SilencedErrors silenced;
  std::vector<std::int32_t> corners;
  corners.reserve(field.basis.boxes.size() * 4);
  for (const Box& box : field.basis.boxes) corners.insert(corners.end(), {box.x0, box.y0, box.x1, box.y1});
  // HDF5 1.10 does not survive a full disk gracefully when it closes the file: look before.
  require_free_space(fs::absolute(path).parent_path(), content_bytes(field));
  write_atomically(path, [&](const fs::path& temporary) {
    errno = 0;
    const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V110);
    // Without times of creation, which HDF5 keeps for groups by default, equal fields give equal bytes.
    const Handle timeless(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    H5Pset_obj_track_times(timeless, false);
    const Handle timeless_root(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
    H5Pset_obj_track_times(timeless_root, false);
    Handle file(H5Fcreate(temporary.c_str(), H5F_ACC_TRUNC, timeless_root, access), H5Fclose);
    const Writer writer{file, path};
    writer.check(file.valid());
    for (const char* group : {"basis", "transfer", "statistics"}) {
      const Handle created(H5Gcreate2(file, group, H5P_DEFAULT, timeless, H5P_DEFAULT), H5Gclose);
      writer.check(created.valid());
    }
    const SparseTransfer& transfer = field.transfer;
    writer.text("format", part ? part_format_name : format_name);
    writer.number("version", reflectance_field_version);
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
    writer.dataset("basis/boxes", corners.data(), {field.basis.boxes.size(), 4});
    if (!field.monitors.empty()) write_monitors(writer, field.monitors);
    writer.dataset("transfer/row_start", transfer.row_start.data(), {transfer.row_start.size()});
    writer.dataset("transfer/column", transfer.column.data(), {transfer.column.size()});
    writer.dataset("transfer/weight", transfer.weight.data(), {transfer.column.size(), 3});
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
    writer.check(H5Fflush(file, H5F_SCOPE_GLOBAL) >= 0);
    writer.check(file.close());
  });
}

/// Looks into a field or a part and leaves `format` with what the file says it is.
Reader open_field(const fs::path& path, std::string& format) {
  static_assert(std::endian::native == std::endian::little, "values are taken from the file as they stand");
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the reflectance field");
  if (!fs::is_regular_file(path, error) || H5Fis_hdf5(path.c_str()) <= 0)
    throw FormatError(path,
                      "is not a reflectance field (no HDF5 file); give a file that 'refield estimate' wrote");
  auto outline = read_hdf5_outline(path, data_set_names);
  if (!outline)
    throw FormatError(path, "cannot be opened as HDF5; the file is damaged or truncated: make it again");
  Reader reader{std::move(*outline), path};
  if (reader.outline.texts.contains("format")) format = reader.text("format");
  if (format != format_name && format != part_format_name)
    throw FormatError(
        path, "is an HDF5 file but not a reflectance field; give a file that 'refield estimate' wrote");
  if (const int version = reader.number("version"); version != reflectance_field_version)
    throw FormatError(path, "has format version " + std::to_string(version) +
                                ", this program reads version " + std::to_string(reflectance_field_version) +
                                "; use the matching refield or estimate the field again");
  return reader;
}

/// Sizes, light and provenance: what a reader needs before it asks for the numbers.
ReflectanceField read_outline(const Reader& reader) {
  ReflectanceField field;
  field.width = reader.number("width");
  field.height = reader.number("height");
  field.basis.domain = {reader.number("light_width"), reader.number("light_height"),
                        reader.parameterisation()};
  if (field.width <= 0 || field.height <= 0 ||
      static_cast<std::uint64_t>(field.width) * static_cast<std::uint64_t>(field.height) > max_pixels ||
      field.basis.domain.width <= 0 || field.basis.domain.height <= 0)
    reader.fail("has impossible dimensions");
  field.basis.hats = {reader.number("hat_columns"), reader.number("hat_rows")};
  const HatGrid& hats = field.basis.hats;
  if (hats.columns < 0 || hats.rows < 0 || hats.columns > field.basis.domain.width ||
      hats.rows > field.basis.domain.height)
    reader.fail("has an impossible grid of hats");
  field.provenance = reader.text("provenance");
  if (reader.has(monitors_name)) field.monitors = read_monitors(reader, field.basis.domain);
  return field;
}

/// Fills in the numbers; `field.height` must be that of the rows held.
void read_content(const Reader& reader, ReflectanceField& field) {
  const auto corners = reader.dataset<std::int32_t>("basis/boxes", 4);
  for (std::size_t k = 0; k < corners.size(); k += 4)
    field.basis.boxes.push_back({corners[k], corners[k + 1], corners[k + 2], corners[k + 3]});
  field.transfer.row_start = reader.dataset<std::uint64_t>("transfer/row_start", 1);
  field.transfer.column = reader.dataset<std::uint32_t>("transfer/column", 1);
  field.transfer.weight = reader.dataset<float>("transfer/weight", 3);
  field.training_error = reader.dataset<float>("statistics/training_error", 1);
  if (reader.has("statistics/error_evidence")) {
    const auto evidence = reader.dataset<float>("statistics/error_evidence", 5);
    for (std::size_t i = 0; i < evidence.size(); i += 5)
      field.error_evidence.push_back(
          {evidence[i], evidence[i + 1], evidence[i + 2], evidence[i + 3], evidence[i + 4]});
  }
  if (reader.has("statistics/learning_curve")) {
    const auto points = reader.dataset<float>("statistics/learning_curve", 2);
    for (std::size_t i = 0; i < points.size(); i += 2)
      field.learning_curve.push_back({points[i], points[i + 1]});
  }
  if (reader.has("statistics/predicted_error"))
    field.predicted_error = reader.dataset<float>("statistics/predicted_error", 1);
  if (reader.has("statistics/photograph_noise"))
    field.photograph_noise = reader.dataset<float>("statistics/photograph_noise", 1);
  if (field.transfer.row_start.empty()) reader.fail("transfer/row_start is empty");
  validate(field, reader);
}

FieldPart read_part(const fs::path& path, bool with_content) {
  std::string format;
  const Reader reader = open_field(path, format);
  if (format != part_format_name)
    throw InputError(path.string() +
                     ": is a whole field, not a part of one; give files that 'refield estimate --rows' made");
  FieldPart part;
  part.field = read_outline(reader);
  part.image_height = part.field.height;
  part.rows = {reader.number("first_row"), reader.number("last_row")};
  if (part.rows.first < 0 || part.rows.first >= part.rows.last || part.rows.last > part.image_height)
    reader.fail("states impossible rows");
  part.field.height = part.rows.count();
  part.job = reader.text("job");
  if (with_content) read_content(reader, part.field);
  return part;
}

}  // namespace

void write_reflectance_field(const fs::path& path, const ReflectanceField& field) {
  write_field(path, field, nullptr);
}

ReflectanceField read_reflectance_field(const fs::path& path) {
  std::string format;
  const Reader reader = open_field(path, format);
  if (format == part_format_name)
    throw InputError(path.string() + ": holds rows " + std::to_string(reader.number("first_row")) + " to " +
                     std::to_string(reader.number("last_row") - 1) + " of a field of " +
                     std::to_string(reader.number("height")) +
                     " rows; join all parts with 'refield merge PARTS -o WHOLE.rfield' and give that");
  ReflectanceField field = read_outline(reader);
  read_content(reader, field);
  return field;
}

bool is_field_part(const fs::path& path) {
  try {
    std::string format;
    open_field(path, format);
    return format == part_format_name;
  } catch (const Error&) {
    return false;
  }
}

void write_field_part(const fs::path& path, const FieldPart& part) {
  write_field(path, part.field, &part);
}

FieldPart read_field_part(const fs::path& path) {
  return read_part(path, true);
}

FieldPart read_field_part_outline(const fs::path& path) {
  return read_part(path, false);
}

}  // namespace refield
