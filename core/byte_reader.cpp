// SPDX-License-Identifier: Apache-2.0
#include "core/byte_reader.h"

#include <cerrno>

#include "core/errors.h"

namespace refield {

ByteReader::ByteReader(const std::filesystem::path& path)
    : path_(path), file_(path, std::ios::binary), size_(std::filesystem::file_size(path)) {
  if (!file_) throw DeviceError(path.string(), errno, "cannot open");
}

void ByteReader::fail(const std::string& what) const {
  throw FormatError(path_, what + "; the file is damaged or truncated");
}

std::uint64_t ByteReader::left() {
  return size_ - static_cast<std::uint64_t>(file_.tellg());
}

void ByteReader::skip(std::int64_t bytes) {
  if (bytes < 0 || static_cast<std::uint64_t>(bytes) > left()) fail("ends within its header");
  file_.seekg(bytes, std::ios::cur);
}

int ByteReader::byte() {
  const int value = file_.get();
  if (value == std::ifstream::traits_type::eof()) fail("ends within its header");
  return value;
}

std::uint64_t ByteReader::big_endian(int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | static_cast<std::uint64_t>(byte());
  return value;
}

std::uint64_t ByteReader::little_endian(int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<std::uint64_t>(byte()) << (8 * i);
  return value;
}

std::string ByteReader::until(char end, std::size_t longest) {
  std::string text;
  for (int value = byte(); value != static_cast<unsigned char>(end); value = byte()) {
    if (text.size() == longest) fail("has a name or line of more than " + std::to_string(longest) + " bytes");
    text.push_back(static_cast<char>(value));
  }
  return text;
}

int ByteReader::count(std::string_view pair) {
  int found = 0, before = -1;
  for (int value = file_.get(); value != std::ifstream::traits_type::eof(); value = file_.get()) {
    found += before == static_cast<unsigned char>(pair[0]) && value == static_cast<unsigned char>(pair[1]);
    before = value;
  }
  return found;
}

}  // namespace refield
