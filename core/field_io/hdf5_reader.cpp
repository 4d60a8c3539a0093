// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/hdf5_reader.h"

#include <hdf5.h>
#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <type_traits>
#include <utility>

#include "core/base/errors.h"
#include "core/base/isolated.h"
#include "core/field_io/hdf5_writer.h"

namespace refield {

namespace {

using Json = nlohmann::json;

constexpr const char* crc_name = "crc32";

// In the child: identifiers are left to the end of the process, and every call may fail.

/// nullopt unless the attribute is one integer.
std::optional<std::int64_t> integer_of(hid_t attribute) {
  std::int64_t value = 0;
  if (H5Tget_class(H5Aget_type(attribute)) != H5T_INTEGER ||
      H5Sget_simple_extent_npoints(H5Aget_space(attribute)) != 1 ||
      H5Aread(attribute, H5T_NATIVE_INT64, &value) < 0)
    return std::nullopt;
  return value;
}

/// nullopt unless the attribute is one text of fixed length.
std::optional<std::string> text_of(hid_t attribute, std::size_t longest) {
  const hid_t type = H5Aget_type(attribute);
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0 ||
      H5Sget_simple_extent_npoints(H5Aget_space(attribute)) != 1 || H5Tget_size(type) > longest)
    return std::nullopt;
  std::string value(H5Tget_size(type), '\0');
  if (H5Aread(attribute, type, value.data()) < 0) return std::nullopt;
  value.resize(value.find_last_not_of('\0') + 1);
  return value;
}

void describe_attributes(hid_t file, std::size_t longest, Json& outline) {
  H5O_info_t info;
  if (H5Oget_info2(file, &info, H5O_INFO_NUM_ATTRS) < 0) return;
  for (hsize_t i = 0; i < info.num_attrs; ++i) {
    const hid_t attribute =
        H5Aopen_by_idx(file, ".", H5_INDEX_NAME, H5_ITER_INC, i, H5P_DEFAULT, H5P_DEFAULT);
    if (attribute < 0) return;
    std::array<char, 256> name{};
    H5Aget_name(attribute, name.size(), name.data());
    if (const auto number = integer_of(attribute)) outline["numbers"][name.data()] = *number;
    // As bytes: JSON's texts must be UTF-8, a damaged file's need not.
    else if (const auto text = text_of(attribute, longest))
      outline["texts"][name.data()] = Json::binary({text->begin(), text->end()});
    H5Aclose(attribute);
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
  const hid_t set = H5Dopen2(file, name, H5P_DEFAULT);
  if (set < 0) return;
  const hid_t creation = H5Dget_create_plist(set);
  if (H5Pget_layout(creation) == H5D_VIRTUAL || H5Pget_external_count(creation) != 0)
    return refuse("stored in another file");
  if (H5Pget_layout(creation) != H5D_CONTIGUOUS) return refuse("stored in chunks or compressed");
  const hid_t space = H5Dget_space(set);
  const int rank = H5Sget_simple_extent_ndims(space);
  std::array<hsize_t, 2> shape{};
  if (rank < 1 || rank > 2 || H5Sget_simple_extent_dims(space, shape.data(), nullptr) != rank) return;
  Json& described = outline["data_sets"][name];
  described["type"] = type_name(H5Dget_type(set));
  described["shape"] = Json(std::vector<hsize_t>(shape.begin(), shape.begin() + rank));
  described["offset"] = H5Dget_offset(set);
  described["bytes"] = H5Dget_storage_size(set);
  if (H5Aexists(set, crc_name) > 0)
    if (const auto crc = integer_of(H5Aopen(set, crc_name, H5P_DEFAULT)))
      described["crc"] = static_cast<std::uint32_t>(*crc);
}

/// CBOR, to be read by the parent.
std::string describe(const std::filesystem::path& path, std::span<const char* const> data_sets) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  H5PLset_loading_state(0);  // a file may name filters, which would be searched for as shared libraries
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (file < 0) throw std::runtime_error("no HDF5 file");
  Json outline{{"numbers", Json::object()},
               {"texts", Json::object()},
               {"data_sets", Json::object()},
               {"refused", Json::object()}};
  describe_attributes(file, std::filesystem::file_size(path), outline);
  // One link after another: of a path whose first part is missing, HDF5 would complain.
  for (const char* name : data_sets) describe_data_set(file, name, outline);
  std::string bytes;
  Json::to_cbor(outline, bytes);
  return bytes;
}

}  // namespace

std::optional<Hdf5Outline> read_hdf5_outline(const std::filesystem::path& path,
                                             std::span<const char* const> data_sets, const RunContext& run) {
  const auto answer = run_isolated([&] { return describe(path, data_sets); }, {}, run);
  if (!answer) return std::nullopt;
  try {
    const Json described = Json::from_cbor(*answer);
    Hdf5Outline outline;
    outline.numbers = described.at("numbers").get<std::map<std::string, std::int64_t>>();
    for (const auto& [name, text] : described.at("texts").items())
      outline.texts[name] = {text.get_binary().begin(), text.get_binary().end()};
    outline.refused = described.at("refused").get<std::map<std::string, std::string>>();
    for (const auto& [name, set] : described.at("data_sets").items()) {
      Hdf5DataSet& found = outline.data_sets[name];
      found.type = set.at("type");
      found.shape = set.at("shape").get<std::vector<std::uint64_t>>();
      found.offset = set.at("offset");
      found.bytes = set.at("bytes");
      if (set.contains("crc")) found.crc32 = set.at("crc").get<std::uint32_t>();
    }
    return outline;
  } catch (const Json::exception&) {  // the library overwrote what it should not have
    return std::nullopt;
  }
}

namespace fs = std::filesystem;

namespace {

template <class T>
const char* type_name() {
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

std::string named(const char* name, const char* what) {
  return std::string("data set '") + name + "' " + what;
}

}  // namespace

void Hdf5Values::fail(const std::string& what) const {
  throw FormatError(path, what + "; the file is damaged or was not written by refield: make it again");
}

const Hdf5DataSet& Hdf5Values::locate(const char* name, const char* type, std::size_t columns) const {
  if (!has(name)) fail(std::string("has no data set '") + name + "', uncompressed and in one piece");
  const Hdf5DataSet& set = outline.data_sets.at(name);
  if ((set.shape.size() > 1 ? set.shape[1] : 1) != columns) fail(named(name, "has the wrong shape"));
  if (set.type != type) fail(named(name, "has the wrong type"));
  // A header may promise more than the file holds.
  const auto value_bytes = static_cast<std::uint64_t>(type[1] - '0');
  const std::uint64_t held = fs::file_size(path), rows = set.shape[0], bytes = rows * columns * value_bytes;
  if (rows > held || bytes != set.bytes || bytes > held || (bytes > 0 && set.offset > held - bytes))
    fail(named(name, "is truncated"));
  return set;
}

template <class T>
std::vector<T> Hdf5Values::dataset(const char* name, std::size_t columns) const {
  const Hdf5DataSet& set = locate(name, type_name<T>(), columns);
  std::vector<T> values(set.bytes / sizeof(T));
  Hdf5Pieces pieces(*this, name, set);
  pieces.read(std::as_writable_bytes(std::span(values)));
  pieces.finish();
  return values;
}

const std::string& Hdf5Values::text(const char* name) const {
  const auto found = outline.texts.find(name);
  if (found == outline.texts.end()) fail(std::string("has no attribute '") + name + "' that is a text");
  return found->second;
}

std::int32_t Hdf5Values::number(const char* name) const {
  const auto found = outline.numbers.find(name);
  if (found == outline.numbers.end()) fail(std::string("has no attribute '") + name + "' that is a number");
  if (!std::in_range<std::int32_t>(found->second))
    fail(std::string("attribute '") + name + "' is out of range");
  return static_cast<std::int32_t>(found->second);
}

Hdf5Pieces::Hdf5Pieces(const Hdf5Values& values, const char* name, const Hdf5DataSet& set)
    : values_(values), name_(name), set_(set) {}

void Hdf5Pieces::read(std::span<std::byte> piece) {
  // Copying from the system's cache and the checksum keep one core busy longer than laying a field out.
  constexpr std::size_t part_bytes = std::size_t{4} << 20;
  std::vector<std::uint32_t> sums((piece.size() + part_bytes - 1) / part_bytes);
  const auto part = [&](std::size_t i) {
    return piece.subspan(i * part_bytes, std::min(part_bytes, piece.size() - i * part_bytes));
  };
  tbb::parallel_for(std::size_t{0}, sums.size(), [&](std::size_t i) {
    const auto to = part(i);
    std::ifstream file(values_.path, std::ios::binary);
    if (!file.seekg(static_cast<std::streamoff>(set_.offset + done_ + i * part_bytes)) ||
        !file.read(reinterpret_cast<char*>(to.data()), static_cast<std::streamsize>(to.size())))
      fail("cannot be read");
    sums[i] = crc32_of(to.data(), to.size());
  });
  for (std::size_t i = 0; i < sums.size(); ++i) crc_ = crc32_joined(crc_, sums[i], part(i).size());
  done_ += piece.size();
}

void Hdf5Pieces::finish() const {
  if (set_.crc32 && *set_.crc32 != crc_) fail("does not match its checksum");
}

void Hdf5Pieces::fail(const char* what) const {
  values_.fail(named(name_, what));
}

template std::vector<float> Hdf5Values::dataset(const char*, std::size_t) const;
template std::vector<double> Hdf5Values::dataset(const char*, std::size_t) const;
template std::vector<std::int32_t> Hdf5Values::dataset(const char*, std::size_t) const;
template std::vector<std::uint32_t> Hdf5Values::dataset(const char*, std::size_t) const;
template std::vector<std::uint64_t> Hdf5Values::dataset(const char*, std::size_t) const;

}  // namespace refield
