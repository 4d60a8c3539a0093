// SPDX-License-Identifier: Apache-2.0
// A camera's RAW file, here a DNG written byte by byte, is read as the sensor's samples.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "acquire/hdr/bracket_files.h"
#include "acquire/import/bracket_merge.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "tests/support/dng_file.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;

using U16 = std::uint16_t;
using U32 = std::uint32_t;
using test::dng;

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
    file_ = read_bracket_file(folder_ / "a.dng", PixelLayout::bayer_rggb);
    ASSERT_TRUE(file_.is_raw);
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

TEST_F(RawFile, StatesItsLayoutAndAperture) {
  EXPECT_NEAR(file_.settings.f_number.value_or(0.0), 2.8, 1e-6);
  constexpr U16 other = 300;
  const std::vector<U16> samples(width * height, other);
  const std::vector<std::pair<PixelLayout, std::vector<std::uint8_t>>> layouts = {
      {PixelLayout::bayer_rggb, {0, 1, 1, 2}},
      {PixelLayout::bayer_grbg, {1, 0, 2, 1}},
      {PixelLayout::bayer_gbrg, {1, 2, 0, 1}},
      {PixelLayout::bayer_bggr, {2, 1, 1, 0}}};
  for (const auto& [layout, colours] : layouts) {
    write_text_atomically(folder_ / "layout.dng", dng(width, height, samples, colours, 0.01));
    EXPECT_EQ(read_bracket_file(folder_ / "layout.dng").frame.layout, layout) << layout_name(layout);
  }
}

TEST_F(RawFile, StatesItsLevels) {
  ASSERT_TRUE(file_.raw_levels);
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
