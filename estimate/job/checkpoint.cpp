// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/checkpoint.h"

#include <cstring>

#include "core/base/files.h"

namespace refield {

namespace {

constexpr const char* description_name = "job.txt";

/// 64-bit FNV-1a: enough to tell a damaged file from a whole one.
std::uint64_t checksum(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ull;
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3ull;
  return hash;
}

template <class T>
void put(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Takes values off the front; once too little is left, all further ones are zero and `ok` is false.
struct Parser {
  std::string_view bytes;
  bool ok = true;
  template <class T>
  T take() {
    T value{};
    if (bytes.size() < sizeof value) {
      ok = false;
      return value;
    }
    std::memcpy(&value, bytes.data(), sizeof value);
    bytes.remove_prefix(sizeof value);
    return value;
  }
};

}  // namespace

Checkpoint::Checkpoint(const fs::path& output, std::string description)
    : folder_(output.string() + ".partial"), description_(std::move(description)) {}

void Checkpoint::resume() const {
  const fs::path job = folder_ / description_name;
  if (fs::exists(job) && read_text(job) != description_)
    throw InputError(folder_,
                     ": was begun with other options or inputs; give the same ones again, or remove --resume "
                     "to start again");
}

void Checkpoint::remove() const {
  if (!fs::is_directory(folder_)) return;
  const auto is_ours = [](const fs::path& path) {
    const std::string name = path.filename().string();
    return name == description_name || name.starts_with(".partial-") ||
           (name.starts_with("rows-") && path.extension() == ".band");
  };
  std::vector<fs::path> ours;
  for (const auto& entry : fs::directory_iterator(folder_))
    if (is_ours(entry.path())) ours.push_back(entry.path());
  std::error_code error;
  for (const fs::path& path : ours)
    if (fs::remove(path, error); error)
      throw DeviceError(path.string(), error.value(), "cannot remove the finished bands");
  fs::remove(folder_, error);  // stays where another user's files lie in it
}

fs::path Checkpoint::band_path(RowRange rows) const {
  return folder_ / ("rows-" + std::to_string(rows.first) + "-" + std::to_string(rows.last) + ".band");
}

void Checkpoint::store(RowRange rows, const std::vector<PixelKernels>& kernels) const {
  if (!fs::exists(folder_ / description_name)) {
    create_folders(folder_);
    write_text_atomically(folder_ / description_name, description_);
  }
  std::string bytes;
  for (const PixelKernels& pixel : kernels) {
    put(bytes, static_cast<std::uint32_t>(pixel.boxes.size()));
    put(bytes, pixel.squared_residual);
    put(bytes, pixel.squared_samples);
    put(bytes, pixel.evidence);
    for (const Box& box : pixel.boxes) put(bytes, box);
    for (const float weight : pixel.weights) put(bytes, weight);
    put(bytes, static_cast<std::uint32_t>(pixel.smooth.size()));
    for (const float weight : pixel.smooth) put(bytes, weight);
  }
  put(bytes, checksum(bytes));
  write_text_atomically(band_path(rows), bytes);
}

std::optional<std::string> Checkpoint::content_of(RowRange rows) const {
  if (!fs::exists(band_path(rows))) return std::nullopt;
  std::string bytes = read_text(band_path(rows));
  if (bytes.size() < sizeof(std::uint64_t)) return std::nullopt;
  const std::size_t size = bytes.size() - sizeof(std::uint64_t);
  const auto sum = Parser{std::string_view(bytes).substr(size)}.take<std::uint64_t>();
  bytes.resize(size);
  if (sum != checksum(bytes)) return std::nullopt;
  return bytes;
}

std::optional<std::vector<PixelKernels>> Checkpoint::load(RowRange rows, int width) const {
  const auto content = content_of(rows);
  if (!content) return std::nullopt;
  Parser parser{*content};
  std::vector<PixelKernels> kernels(static_cast<std::size_t>(width) * (rows.last - rows.first));
  for (PixelKernels& pixel : kernels) {
    const auto count = parser.take<std::uint32_t>();
    pixel.squared_residual = parser.take<double>();
    pixel.squared_samples = parser.take<double>();
    pixel.evidence = parser.take<ErrorEvidence>();
    if (!parser.ok || count > parser.bytes.size() / (sizeof(Box) + 3 * sizeof(float))) return std::nullopt;
    for (std::uint32_t k = 0; k < count; ++k) pixel.boxes.push_back(parser.take<Box>());
    for (std::uint32_t k = 0; k < 3 * count; ++k) pixel.weights.push_back(parser.take<float>());
    const auto smooth = parser.take<std::uint32_t>();
    if (!parser.ok || smooth > parser.bytes.size() / sizeof(float)) return std::nullopt;
    for (std::uint32_t k = 0; k < smooth; ++k) pixel.smooth.push_back(parser.take<float>());
  }
  if (!parser.ok || !parser.bytes.empty()) return std::nullopt;
  return kernels;
}

}  // namespace refield
