// SPDX-License-Identifier: Apache-2.0
// A camera's RAW file, here a DNG written byte by byte, is read as the sensor's samples.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "acquire/hdr/bracket_files.h"
#include "acquire/import/bracket_merge.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;

template <class T>
std::string bytes_of(std::initializer_list<T> values) {
  return {reinterpret_cast<const char*>(values.begin()), values.size() * sizeof(T)};
}
using U8 = std::uint8_t;
using U16 = std::uint16_t;
using U32 = std::uint32_t;
using I32 = std::int32_t;

/// A little-endian TIFF with one image of 16-bit Bayer samples and the tags that DNG 1.4 requires.
std::string dng(U32 width, U32 height, const std::vector<U16>& samples, std::initializer_list<U8> colours,
                double seconds) {
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
      {33422, byte, 4, bytes_of<U8>(colours)},
      {33434, rational, 1, bytes_of<U32>({static_cast<U32>(std::lround(seconds * 1e6)), 1000000})},
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

constexpr U32 width = 64, height = 48;

std::vector<U16> samples_of(double light) {
  std::vector<U16> samples;
  for (U32 y = 0; y < height; ++y)
    for (U32 x = 0; x < width; ++x)
      samples.push_back(
          static_cast<U16>(std::min(4095.0, 256.0 + light * (10.0 + x * 17 % 90 + y * 31 % 70))));
  return samples;
}

class RawFile : public ::testing::Test {
 protected:
  void SetUp() override {
    write_text_atomically(folder_ / "a.dng", dng(width, height, samples_of(2.0), {0, 1, 1, 2}, 0.0125));
    try {
      file_ = read_bracket_file(folder_ / "a.dng", PixelLayout::bayer_rggb);
    } catch (const FormatError& error) {
      GTEST_SKIP() << "OpenImageIO was built without LibRaw: " << error.what();
    }
    if (!file_.is_raw) GTEST_SKIP() << "OpenImageIO was built without LibRaw: it took the file for a TIFF";
  }
  const TemporaryFolder folder_;
  BracketFile file_;
};

TEST_F(RawFile, GivesTheSensorsSamples) {
  EXPECT_EQ(file_.frame.width, static_cast<int>(width));
  EXPECT_EQ(file_.frame.height, static_cast<int>(height));
  EXPECT_EQ(file_.frame.samples, samples_of(2.0));
  ASSERT_TRUE(file_.exposure);
  EXPECT_NEAR(file_.exposure->count(), 0.0125, 1e-6);
}

TEST_F(RawFile, StatesItsLevels) {
  if (!file_.raw_levels) {
    BracketCamera camera;
    camera.layout = "bayer_rggb";
    EXPECT_THROW(read_bracket({folder_ / "a.dng"}, camera), InputError);
    GTEST_SKIP() << "SKIPPED: built without LibRaw (libraw-dev)";
  }
  EXPECT_EQ(file_.raw_levels->black, 256.0);
  EXPECT_EQ(file_.raw_levels->saturation, 4095.0);
}

TEST_F(RawFile, IsMergedWithWhatIsKnownOfTheCamera) {
  write_text_atomically(folder_ / "b.dng", dng(width, height, samples_of(8.0), {0, 1, 1, 2}, 0.05));
  BracketCamera camera;
  camera.layout = "bayer_rggb";
  if (!file_.raw_levels) {
    camera.black = 256.0;
    camera.saturation = 4095.0;
  }
  Bracket bracket = read_bracket({folder_ / "a.dng", folder_ / "b.dng"}, camera);
  const Photograph merged = merge_bracket(bracket, camera);
  // Radiance 1 fills 65535 in a second; light 2 in 12.5 ms.
  for (int y = 0; y < static_cast<int>(height); ++y)
    for (int x = 0; x < static_cast<int>(width); ++x) {
      const double dn = 2.0 * (10.0 + x * 17 % 90 + y * 31 % 70);
      EXPECT_NEAR(merged.radiance.at(x, y, bayer_channel(PixelLayout::bayer_rggb, x, y)),
                  dn / 65535.0 / 0.0125, 1e-3 * dn / 65535.0 / 0.0125);
    }
  camera.black = 200.0;  // an option overrules the file
  camera.saturation = 4000.0;
  bracket = read_bracket({folder_ / "a.dng", folder_ / "b.dng"}, camera);
  const Photograph lifted = merge_bracket(bracket, camera);
  EXPECT_GT(lifted.radiance.at(0, 0, 0), merged.radiance.at(0, 0, 0) + 56.0f / 65535.0f / 0.05f);
}

}  // namespace
}  // namespace refield
