// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace refield {

/// Reads a file from front to back in small pieces. Running past the end throws FormatError, as fail() does.
class ByteReader {
 public:
  explicit ByteReader(const std::filesystem::path& path);

  [[noreturn]] void fail(const std::string& what) const;
  /// Bytes between here and the end.
  std::uint64_t left();
  void skip(std::int64_t bytes);
  int byte();
  std::uint64_t big_endian(int bytes);
  std::uint64_t little_endian(int bytes);
  std::int32_t little_endian_int32() { return static_cast<std::int32_t>(little_endian(4)); }
  /// Up to the next zero byte, which is consumed. At most `longest` bytes, else fails.
  std::string zero_terminated(std::size_t longest) { return until('\0', longest); }
  /// Up to the next line feed, which is consumed.
  std::string line() { return until('\n', 4096); }
  /// How often two bytes follow one another from here to the end.
  int count(std::string_view pair);

 private:
  std::string until(char end, std::size_t longest);
  std::filesystem::path path_;
  std::ifstream file_;
  std::uint64_t size_;
};

}  // namespace refield
