// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/hdf5_checksums.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <string_view>

// The library's own, which it exports without a public header.
extern "C" std::uint32_t H5_checksum_metadata(const void* data, std::size_t length, std::uint32_t initial);

namespace refield::fuzz {

namespace {

constexpr std::size_t checksum_bytes = 4;

bool holds(std::span<const std::uint8_t> file, std::size_t at, std::string_view signature) {
  return at + signature.size() <= file.size() &&
         std::memcmp(file.data() + at, signature.data(), signature.size()) == 0;
}

void renew(std::span<std::uint8_t> file, std::size_t at, std::size_t length) {
  if (length > file.size() || at > file.size() - length || file.size() - length - at < checksum_bytes) return;
  const std::uint32_t sum = H5_checksum_metadata(file.data() + at, length, 0);
  for (std::size_t i = 0; i < checksum_bytes; ++i)
    file[at + length + i] = static_cast<std::uint8_t>(sum >> (8 * i));
}

void renew_object_header(std::span<std::uint8_t> file, std::size_t at) {
  if (at + 6 > file.size()) return;
  const std::uint8_t flags = file[at + 5];
  const std::size_t times = flags & 0x20 ? 16 : 0, limits = flags & 0x10 ? 4 : 0;
  const std::size_t size_bytes = std::size_t{1} << (flags & 3);
  const std::size_t prefix = 6 + times + limits + size_bytes;
  if (at + prefix > file.size()) return;
  std::size_t messages = 0;
  for (std::size_t i = std::min<std::size_t>(size_bytes, 4); i-- > 0;)
    messages = messages << 8 | file[at + prefix - size_bytes + i];
  renew(file, at, prefix + messages);
}

}  // namespace

void renew_hdf5_checksums(std::span<std::uint8_t> file) {
  using namespace std::string_view_literals;
  if (holds(file, 0, "\x89HDF\r\n\x1a\n"sv) && file.size() > 8 && file[8] >= 2) renew(file, 0, 44);
  for (std::size_t at = 0; at + 6 < file.size(); ++at)
    if (holds(file, at, "OHDR"sv)) renew_object_header(file, at);
}

}  // namespace refield::fuzz
