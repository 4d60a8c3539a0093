// SPDX-License-Identifier: Apache-2.0
#include "core/base/json.h"
#include "core/field_io/hdf5_reader.h"

#include <hdf5.h>

#include <array>
#include <cstring>

namespace refield {

Hdf5Id::~Hdf5Id() {
  if (valid()) H5Idec_ref(id_);
}

namespace {

constexpr const char* crc_name = "crc32";

/// Silences the library, and keeps it from searching for filters that a file names as shared libraries; the
/// caller's settings come back at the end.
class QuietLibrary {
 public:
  QuietLibrary() {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    H5PLget_loading_state(&plugins_);
    H5PLset_loading_state(0);
  }
  ~QuietLibrary() {
    H5PLset_loading_state(plugins_);
    H5Eset_auto2(H5E_DEFAULT, print_, data_);
  }
  QuietLibrary(const QuietLibrary&) = delete;
  QuietLibrary& operator=(const QuietLibrary&) = delete;

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
  unsigned plugins_ = 0;
};

// Every call may fail.

/// nullopt unless the attribute is one integer.
std::optional<std::int64_t> integer_of(hid_t attribute) {
  std::int64_t value = 0;
  if (H5Tget_class(Hdf5Id(H5Aget_type(attribute))) != H5T_INTEGER ||
      H5Sget_simple_extent_npoints(Hdf5Id(H5Aget_space(attribute))) != 1 ||
      H5Aread(attribute, H5T_NATIVE_INT64, &value) < 0)
    return std::nullopt;
  return value;
}

/// nullopt unless the attribute is one text; of variable length as h5py writes `str`.
std::optional<std::string> text_of(hid_t attribute, std::size_t longest) {
  const Hdf5Id type(H5Aget_type(attribute));
  if (H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(Hdf5Id(H5Aget_space(attribute))) != 1)
    return std::nullopt;
  if (H5Tis_variable_str(type) > 0) {
    char* text = nullptr;
    if (H5Aread(attribute, type, &text) < 0 || !text) return std::nullopt;
    std::string value(text, ::strnlen(text, longest));
    H5free_memory(text);
    return value;
  }
  if (H5Tget_size(type) > longest) return std::nullopt;
  std::string value(H5Tget_size(type), '\0');
  if (H5Aread(attribute, type, value.data()) < 0) return std::nullopt;
  value.resize(value.find_last_not_of('\0') + 1);
  return value;
}

void describe_attributes(hid_t file, std::size_t longest, Json& outline) {
  H5O_info_t info;
  if (H5Oget_info2(file, &info, H5O_INFO_NUM_ATTRS) < 0) return;
  for (hsize_t i = 0; i < info.num_attrs; ++i) {
    const Hdf5Id attribute(
        H5Aopen_by_idx(file, ".", H5_INDEX_NAME, H5_ITER_INC, i, H5P_DEFAULT, H5P_DEFAULT));
    if (attribute < 0) return;
    std::array<char, 256> name{};
    H5Aget_name(attribute, name.size(), name.data());
    if (const auto number = integer_of(attribute)) outline["numbers"][name.data()] = *number;
    // As bytes: JSON's texts must be UTF-8, a damaged file's need not.
    else if (const auto text = text_of(attribute, longest))
      outline["texts"][name.data()] = Json::binary({text->begin(), text->end()});
  }
}

std::string type_name(hid_t type) {
  for (const auto& [known, name] :
       {std::pair{H5T_IEEE_F32LE, "f4"}, std::pair{H5T_IEEE_F64LE, "f8"}, std::pair{H5T_STD_I32LE, "i4"},
        std::pair{H5T_STD_U32LE, "u4"}, std::pair{H5T_STD_U64LE, "u8"}})
    if (H5Tequal(type, known) > 0) return name;
  return "";
}

enum class Path { absent, inside, elsewhere };

/// Looks at each link of a path before the library follows it: an external link would make it open whatever
/// file the link names.
Path path_of(hid_t file, const std::string& name) {
  for (std::size_t end = name.find('/');; end = name.find('/', end + 1)) {
    H5L_info_t link;
    if (H5Lget_info(file, name.substr(0, end).c_str(), &link, H5P_DEFAULT) < 0) return Path::absent;
    if (link.type != H5L_TYPE_HARD) return Path::elsewhere;
    if (end == std::string::npos) return Path::inside;
  }
}

void describe_data_set(hid_t file, const char* name, Json& outline) {
  const Path path = path_of(file, name);
  if (path == Path::absent) return;
  const auto refuse = [&](const char* what) { outline["refused"][name] = what; };
  if (path == Path::elsewhere) return refuse("a link to another place or file");
  const Hdf5Id set(H5Dopen2(file, name, H5P_DEFAULT));
  if (set < 0) return;
  const Hdf5Id creation(H5Dget_create_plist(set));
  if (H5Pget_layout(creation) == H5D_VIRTUAL || H5Pget_external_count(creation) != 0)
    return refuse("stored in another file");
  if (H5Pget_layout(creation) != H5D_CONTIGUOUS) return refuse("stored in chunks or compressed");
  const Hdf5Id space(H5Dget_space(set));
  const int rank = H5Sget_simple_extent_ndims(space);
  std::array<hsize_t, 2> shape{};
  if (rank < 1 || rank > 2 || H5Sget_simple_extent_dims(space, shape.data(), nullptr) != rank) return;
  Json& described = outline["data_sets"][name];
  described["type"] = type_name(Hdf5Id(H5Dget_type(set)));
  described["shape"] = Json(std::vector<hsize_t>(shape.begin(), shape.begin() + rank));
  described["offset"] = H5Dget_offset(set);
  described["bytes"] = H5Dget_storage_size(set);
  if (H5Aexists(set, crc_name) > 0)
    if (const auto crc = integer_of(Hdf5Id(H5Aopen(set, crc_name, H5P_DEFAULT))))
      described["crc"] = static_cast<std::uint32_t>(*crc);
}

}  // namespace

std::string describe_hdf5(const std::vector<std::string>& arguments) {
  const std::string& path = arguments.at(0);
  const QuietLibrary quiet;
  const Hdf5Id access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_file_locking(access, false, true);  // network file systems may refuse flock(); OutputLock holds ours
  const Hdf5Id file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access));
  if (file < 0) throw std::runtime_error("no HDF5 file");
  Json outline{{"numbers", Json::object()},
               {"texts", Json::object()},
               {"data_sets", Json::object()},
               {"refused", Json::object()}};
  describe_attributes(file, fs::file_size(path), outline);
  // One link after another: of a path whose first part is missing, HDF5 would complain.
  for (std::size_t i = 1; i < arguments.size(); ++i) describe_data_set(file, arguments[i].c_str(), outline);
  std::string bytes;
  Json::to_cbor(outline, bytes);
  return bytes;
}

}  // namespace refield
