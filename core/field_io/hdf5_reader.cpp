// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/hdf5_reader.h"
#include "core/base/json.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <fstream>

#include "core/base/isolated.h"
#include "core/field_io/hdf5_writer.h"

namespace refield {

std::optional<Hdf5Outline> read_hdf5_outline(const fs::path& path, std::span<const char* const> data_sets,
                                             const RunContext& run) {
  IsolatedReading reading{"hdf5", {path.string()}};
  reading.arguments.insert(reading.arguments.end(), data_sets.begin(), data_sets.end());
  const auto answer = answer_of(reading, describe_hdf5, run);
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
  throw FormatError(path, what, "; the file is damaged or was not written by refield: make it again");
}

const Hdf5DataSet& Hdf5Values::locate(const char* name, const char* type, std::size_t columns) const {
  if (!has(name)) fail(std::string("has no data set '") + name + "', uncompressed and in one piece");
  const Hdf5DataSet& set = outline.data_sets.at(name);
  if ((set.shape.size() > 1 ? set.shape[1] : 1) != columns) fail(named(name, "has the wrong shape"));
  if (set.type != type)
    throw FormatError(path, named(name, "holds "), set.type.empty() ? "another type" : set.type, " where ",
                      type, " is expected (docs/reference/reflectance-field-format.md); convert it");
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

template <class T>
FileVector<T> Hdf5Values::file_vector(const char* name, std::size_t columns, std::uint64_t map_from) const {
  const Hdf5DataSet& set = locate(name, type_name<T>(), columns);
  Hdf5Pieces pieces(*this, name, set);
  if (set.bytes < map_from || set.offset % alignof(T) != 0) {
    FileVector<T> values(set.bytes / sizeof(T));
    pieces.read(std::as_writable_bytes(std::span(values)));
    pieces.finish();
    return values;
  }
  auto file = std::make_shared<const MappedFile>(path);
  if (file->bytes().size() < set.offset + set.bytes) fail(named(name, "is truncated"));  // since locate()
  const auto bytes = file->bytes().subspan(set.offset, set.bytes);
  FileVector<T> values(set.bytes / sizeof(T), FileAllocator<T>(std::move(file), bytes));
  pieces.check(values);
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
  sum_parts(piece.size(), [&](std::size_t first, std::size_t size) {
    const auto to = piece.subspan(first, size);
    std::ifstream file(values_.path, std::ios::binary);
    if (!file.seekg(static_cast<std::streamoff>(set_.offset + done_ + first)) ||
        !file.read(reinterpret_cast<char*>(to.data()), static_cast<std::streamsize>(to.size())))
      fail("cannot be read");
    return crc32_of(to.data(), to.size());
  });
  done_ += piece.size();
}

template <class T>
void Hdf5Pieces::check(const FileVector<T>& values) {
  sum_parts(values.size() * sizeof(T), [&](std::size_t first, std::size_t size) {
    const std::uint32_t sum = crc32_of(reinterpret_cast<const std::byte*>(values.data()) + first, size);
    pass_by(values, first / sizeof(T), (first + size) / sizeof(T));
    return sum;
  });
}

/// `sum_of`: the checksum of the bytes from `first` on, `size` of them; called for all of them, by all
/// threads.
template <class SumOf>
void Hdf5Pieces::sum_parts(std::size_t bytes, const SumOf& sum_of) {
  constexpr std::size_t part_bytes = std::size_t{4} << 20;
  std::vector<std::uint32_t> sums((bytes + part_bytes - 1) / part_bytes);
  const auto size_of = [&](std::size_t i) { return std::min(part_bytes, bytes - i * part_bytes); };
  tbb::parallel_for(std::size_t{0}, sums.size(),
                    [&](std::size_t i) { sums[i] = sum_of(i * part_bytes, size_of(i)); });
  for (std::size_t i = 0; i < sums.size(); ++i) crc_ = crc32_joined(crc_, sums[i], size_of(i));
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
template FileVector<float> Hdf5Values::file_vector(const char*, std::size_t, std::uint64_t) const;
template FileVector<std::uint32_t> Hdf5Values::file_vector(const char*, std::size_t, std::uint64_t) const;

}  // namespace refield
