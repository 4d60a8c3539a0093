// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/hdf5_reader.h"

#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <fstream>
#include <type_traits>
#include <utility>

#include "core/base/errors.h"
#include "core/base/isolated.h"
#include "core/field_io/hdf5_describe.h"
#include "core/field_io/hdf5_writer.h"

namespace refield {

using Json = nlohmann::json;

std::optional<Hdf5Outline> read_hdf5_outline(const std::filesystem::path& path,
                                             std::span<const char* const> data_sets, const RunContext& run) {
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
