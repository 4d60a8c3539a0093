// SPDX-License-Identifier: Apache-2.0
#include "tests/support/dng_file.h"

#include <cmath>

namespace refield::test {

namespace {

template <class T>
std::string bytes_of(std::initializer_list<T> values) {
  return {reinterpret_cast<const char*>(values.begin()), values.size() * sizeof(T)};
}
using U8 = std::uint8_t;
using U16 = std::uint16_t;
using U32 = std::uint32_t;
using I32 = std::int32_t;

}  // namespace

std::string dng(U32 width, U32 height, const std::vector<U16>& samples, const std::vector<U8>& colours,
                double seconds, double f_number) {
  struct Tag {
    U16 number, type;
    U32 count;
    std::string value;
  };
  constexpr U16 byte = 1, ascii = 2, word = 3, dword = 4, rational = 5, signed_rational = 10;
  const auto text = [](std::string value) { return value + '\0'; };
  const U32 strip_bytes = width * height * 2;
  std::vector<Tag> tags = {
      {254, dword, 1, bytes_of<U32>({0})},
      {256, dword, 1, bytes_of({width})},
      {257, dword, 1, bytes_of({height})},
      {258, word, 1, bytes_of<U16>({16})},
      {259, word, 1, bytes_of<U16>({1})},      // not compressed
      {262, word, 1, bytes_of<U16>({32803})},  // colour filter array
      {271, ascii, 8, text("refield")},
      {272, ascii, 8, text("virtual")},
      {273, dword, 1, bytes_of<U32>({0})},  // where the strip begins: filled in below
      {277, word, 1, bytes_of<U16>({1})},
      {278, dword, 1, bytes_of({height})},
      {279, dword, 1, bytes_of({strip_bytes})},
      {306, ascii, 20, text("2004:06:21 12:30:05")},
      {33421, word, 2, bytes_of<U16>({2, 2})},
      {33422, byte, 4, std::string(colours.begin(), colours.end())},
      {33434, rational, 1, bytes_of<U32>({static_cast<U32>(std::lround(seconds * 1e6)), 1000000})},
      {33437, rational, 1, bytes_of<U32>({static_cast<U32>(std::lround(f_number * 100)), 100})},
      {50706, byte, 4, bytes_of<U8>({1, 4, 0, 0})},
      {50708, ascii, 16, text("refield virtual")},
      {50710, byte, 3, bytes_of<U8>({0, 1, 2})},
      {50714, word, 1, bytes_of<U16>({256})},
      {50717, word, 1, bytes_of<U16>({4095})},
      {50721, signed_rational, 9, bytes_of<I32>({1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1})},
      {50728, rational, 3, bytes_of<U32>({1, 1, 1, 1, 1, 1})},
      {50778, word, 1, bytes_of<U16>({21})}};
  const std::size_t first_extra = 8 + 2 + 12 * tags.size() + 4;
  std::size_t extra_bytes = 0;
  for (const Tag& tag : tags)
    if (tag.value.size() > 4) extra_bytes += tag.value.size();
  std::string directory, extra;
  for (Tag& tag : tags) {
    if (tag.number == 273) tag.value = bytes_of({static_cast<U32>(first_extra + extra_bytes)});
    directory += bytes_of({tag.number, tag.type}) + bytes_of({tag.count});
    if (tag.value.size() > 4) {
      directory += bytes_of({static_cast<U32>(first_extra + extra.size())});
      extra += tag.value;
    } else {
      directory += tag.value + std::string(4 - tag.value.size(), '\0');
    }
  }
  return std::string("II*\0", 4) + bytes_of<U32>({8}) + bytes_of({static_cast<U16>(tags.size())}) +
         directory + bytes_of<U32>({0}) + extra +
         std::string(reinterpret_cast<const char*>(samples.data()), strip_bytes);
}

}  // namespace refield::test
