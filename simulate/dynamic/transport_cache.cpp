// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/transport_cache.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/errors.h"
#include "core/base/files.h"

namespace refield::dynamic {

namespace fs = std::filesystem;

namespace {

/// Increased whenever the file's layout changes.
constexpr std::string_view magic = "refield transport 1\n";
constexpr std::string_view prefix = "transport-", suffix = ".cache";

/// 128 bits, as two 64-bit hashes with different multipliers; against accidents, not against attackers.
class Hash {
 public:
  void add(const void* data, std::size_t bytes) {
    const auto* at = static_cast<const char*>(data);
    for (; bytes >= 8; at += 8, bytes -= 8) {
      std::uint64_t word;
      std::memcpy(&word, at, 8);
      mix(word);
    }
    std::uint64_t last = bytes;
    std::memcpy(reinterpret_cast<char*>(&last) + 1, at, bytes);
    mix(last);
  }
  std::array<std::uint64_t, 2> value() const { return {a_, b_}; }

 private:
  void mix(std::uint64_t word) {
    a_ = (a_ ^ word) * 0x9e3779b97f4a7c15u;
    a_ ^= a_ >> 32;
    b_ = (b_ + word) * 0xd6e8feb86659fd93u;
    b_ ^= b_ >> 29;
  }
  std::uint64_t a_ = 0x243f6a8885a308d3u, b_ = 0x13198a2e03707344u;
};

/// Of the program itself: one built anew may compute something else.
std::string build_of_program() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  return std::to_string(fs::file_size(program, error)) + " " +
         std::to_string(fs::last_write_time(program, error).time_since_epoch().count());
}

// An archive passes over all members of what it reads, writes or hashes.

class Writer {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const T& value) { raw(&value, sizeof value); }
  template <class T>
  void values(const T* data, std::size_t count) {
    raw(data, count * sizeof(T));
  }
  std::string bytes;

 private:
  void raw(const void* data, std::size_t count) { bytes.append(static_cast<const char*>(data), count); }
};

class Hasher {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const T& value) { hash.add(&value, sizeof value); }
  template <class T>
  void values(const T* data, std::size_t count) {
    hash.add(data, count * sizeof(T));
  }
  Hash hash;
};

/// Where the bytes end early or say what cannot be, is_good() is false from then on.
class Reader {
 public:
  explicit Reader(std::span<const char> bytes) : bytes_(bytes) {}
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(T& value) { values(&value, 1); }
  template <class T>
  void values(T* data, std::size_t count) {
    if (!holds<T>(count)) return;
    if (count > 0) std::memcpy(static_cast<void*>(data), bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
  }
  /// Whether that many numbers are still there.
  template <class T>
  bool holds(std::uint64_t count) {
    is_good_ = is_good_ && count <= bytes_.size() / sizeof(T);
    return is_good_;
  }
  bool is_at_end() const { return is_good_ && bytes_.empty(); }

 private:
  std::span<const char> bytes_;
  bool is_good_ = true;
};

template <class Archive>
constexpr bool is_reader = std::is_same_v<Archive, Reader>;

template <class Archive, class T>
void exchange(Archive& archive, std::vector<T>& list) {
  std::uint64_t count = list.size();
  archive(count);
  if constexpr (is_reader<Archive>) {
    if (!archive.template holds<T>(count)) return;
    list.resize(count);
  }
  archive.values(list.data(), list.size());
}

template <class Archive>
void exchange(Archive& archive, std::vector<bool>& list) {
  std::vector<char> bytes(list.begin(), list.end());
  exchange(archive, bytes);
  if constexpr (is_reader<Archive>) list.assign(bytes.begin(), bytes.end());
}

template <class Archive, class Scalar, int rows_known, int columns_known, int options>
void exchange(Archive& archive, Eigen::Matrix<Scalar, rows_known, columns_known, options>& matrix) {
  std::int64_t rows = matrix.rows(), columns = matrix.cols();
  archive(rows);
  archive(columns);
  if constexpr (is_reader<Archive>) {
    constexpr std::int64_t most = std::numeric_limits<std::int32_t>::max();
    const bool fits = rows >= 0 && columns >= 0 && rows <= most && columns <= most &&
                      (columns_known == Eigen::Dynamic || columns == columns_known);
    if (!archive.template holds<Scalar>(fits ? static_cast<std::uint64_t>(rows * columns) : UINT64_MAX))
      return;
    matrix.resize(rows, columns);
  }
  archive.values(matrix.data(), static_cast<std::size_t>(matrix.size()));
}

template <class Archive>
void exchange(Archive& archive, LowRank& low_rank) {
  std::uint64_t blocks = low_rank.blocks;
  archive(blocks);
  if constexpr (is_reader<Archive>) low_rank.blocks = blocks;
  archive(low_rank.width);
  archive(low_rank.rank);
  exchange(archive, low_rank.values);
  exchange(archive, low_rank.scale);
  exchange(archive, low_rank.mix);
  archive(low_rank.error);
}

/// All but the grid, which the options and the radius tell.
template <class Archive>
void exchange(Archive& archive, ObjectTransport& transport) {
  transport.factors.exchange([&](auto& member) {
    if constexpr (std::is_arithmetic_v<std::remove_reference_t<decltype(member)>>)
      archive(member);
    else
      exchange(archive, member);
  });
  exchange(archive, transport.modes.to_weights);
  exchange(archive, transport.modes.strength);
  exchange(archive, transport.leaving);
  exchange(archive, transport.returning);
  exchange(archive, transport.coverage);
  exchange(archive, transport.outside);
  exchange(archive, transport.receiving);
  archive(transport.order);
  archive(transport.radius);
}

/// All that object_transport() reads of an object, but its name and motion.
void hash_object(Hasher& hasher, const MovingObject& object) {
  const auto list = [&](const auto& values) {
    hasher(values.size());
    hasher.values(values.data(), values.size());
  };
  list(object.mesh.positions);
  list(object.mesh.normals);
  list(object.mesh.colours);
  list(object.mesh.triangles);
  const Brdf& brdf = object.brdf;
  hasher.values(brdf.diffuse.data(), 3);
  hasher.values(brdf.specular.data(), 3);
  hasher(static_cast<int>(brdf.lobe));
  hasher(brdf.exponent);
  hasher(brdf.roughness);
  hasher(brdf.table != nullptr);
  if (brdf.table == nullptr) return;
  hasher(brdf.table->theta_in());
  hasher(brdf.table->theta_out());
  hasher(brdf.table->delta_phi());
  list(brdf.table->values());
}

void hash_options(Hasher& hasher, const TransportOptions& options) {
  hasher(options.fields ? 1 : 0);
  hasher(options.order);
  hasher(options.functions);
  hasher(options.factors.largest);
  hasher(options.factors.error);
  hasher(static_cast<int>(options.modes));
  hasher(options.rings);
  hasher(options.shells);
  hasher(options.smallest_radius);
  hasher(options.largest_radius);
  hasher(options.directions);
  hasher(options.compression);
}

std::string hex_text(const std::array<std::uint64_t, 2>& value) {
  char text[40];
  std::snprintf(text, sizeof text, "%016llx%016llx", static_cast<unsigned long long>(value[0]),
                static_cast<unsigned long long>(value[1]));
  return text;
}

/// Of a file's content; its header's second line.
std::string checksum_line(std::string_view content) {
  Hash hash;
  hash.add(content.data(), content.size());
  return hex_text(hash.value()) + "\n";
}

std::optional<fs::path> variable(const char* name) {
  const char* value = std::getenv(name);
  if (value == nullptr || *value == '\0') return std::nullopt;
  return value;
}

}  // namespace

TransportCache::TransportCache(fs::path folder, std::uint64_t max_bytes)
    : folder_(std::move(folder)), max_bytes_(max_bytes) {}

TransportCache TransportCache::from_environment() {
  if (const auto own = variable("REFIELD_CACHE")) return TransportCache(*own == "off" ? fs::path() : *own);
  // The XDG specification has relative paths ignored.
  if (const auto home = variable("XDG_CACHE_HOME"); home && home->is_absolute())
    return TransportCache(*home / "refield");
  if (const auto home = variable("HOME"); home && home->is_absolute())
    return TransportCache(*home / ".cache" / "refield");
  return TransportCache({});
}

fs::path TransportCache::file_of(const MovingObject& object, const TransportOptions& options) const {
  static const std::string build = build_of_program();
  Hasher hasher;
  hasher.values(build.data(), build.size());
  hash_object(hasher, object);
  hash_options(hasher, options);
  return folder_ / (std::string(prefix) + hex_text(hasher.hash.value()) + std::string(suffix));
}

std::optional<ObjectTransport> TransportCache::load(const MovingObject& object,
                                                    const TransportOptions& options) const {
  if (folder_.empty()) return std::nullopt;
  try {
    const fs::path file = file_of(object, options);
    std::error_code error;
    if (!fs::is_regular_file(file, error)) return std::nullopt;
    const std::string bytes = read_text(file);
    std::string_view rest = bytes;
    if (!rest.starts_with(magic)) return std::nullopt;
    rest.remove_prefix(magic.size());
    constexpr std::size_t checksum_bytes = 33;
    const std::string_view checksum = rest.substr(0, checksum_bytes);
    rest.remove_prefix(checksum.size());
    if (checksum != checksum_line(rest)) return std::nullopt;
    Reader reader(rest);
    ObjectTransport transport;
    exchange(reader, transport);
    if (!reader.is_at_end()) return std::nullopt;
    transport.grid = shell_grid_of(options, transport.radius);
    fs::last_write_time(file, fs::file_time_type::clock::now(), error);  // used: the last to be removed
    return transport;
  } catch (const Error&) {
    return std::nullopt;
  }
}

void TransportCache::store(const MovingObject& object, const TransportOptions& options,
                           const ObjectTransport& transport) const {
  if (folder_.empty()) return;
  try {
    Writer writer;
    exchange(writer, const_cast<ObjectTransport&>(transport));  // a writer changes nothing
    if (magic.size() + writer.bytes.size() > max_bytes_) return;
    create_folders(folder_);
    write_text_atomically(file_of(object, options),
                          std::string(magic) + checksum_line(writer.bytes) + writer.bytes);
    remove_oldest();
  } catch (const Error&) {
    // A full or read-only disk: the next start precomputes again.
  }
}

void TransportCache::remove_oldest() const {
  struct File {
    fs::file_time_type used;
    std::uint64_t bytes;
    fs::path path;
  };
  std::vector<File> files;
  std::uint64_t sum = 0;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(prefix) || !name.ends_with(suffix)) continue;
    std::error_code gone;  // another run may remove files, too
    const File file{entry->last_write_time(gone), entry->file_size(gone), entry->path()};
    if (gone) continue;
    sum += file.bytes;
    files.push_back(file);
  }
  std::ranges::sort(files, {}, &File::used);
  for (auto file = files.begin(); sum > max_bytes_ && file != files.end(); ++file)
    if (fs::remove(file->path, error)) sum -= file->bytes;
}

}  // namespace refield::dynamic
