// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/bracket_files.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "acquire/import/bracket_merge.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/image/image_facts.h"
#include "core/image/image_io.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;

TEST(BracketFiles, RawFramesRoundTripToTheBit) {
  const TemporaryFolder folder;
  Rng random(3);
  for (PixelLayout layout : {PixelLayout::rgb, PixelLayout::grey, PixelLayout::bayer_rggb}) {
    RawFrame frame{7, 5, layout, {}, {}, Seconds(0.1), 1.0, 0};
    for (int i = 0; i < 35 * (layout == PixelLayout::rgb ? 3 : 1); ++i)
      frame.samples.push_back(static_cast<std::uint16_t>(random.below(65536)));
    write_raw_frame(folder / "frame.png", frame);
    const BracketFile file = read_bracket_file(folder / "frame.png", layout);
    EXPECT_EQ(file.bits, 16);
    EXPECT_EQ(file.frame.layout, layout);
    EXPECT_EQ(file.frame.samples, frame.samples);
    EXPECT_FALSE(file.exposure.has_value());
  }
}

TEST(BracketFiles, EqualFramesGiveEqualFiles) {
  const TemporaryFolder folder;
  const RawFrame frame{2, 1, PixelLayout::grey, {1, 2}, {}, Seconds(0.1), 1.0, 0};
  write_raw_frame(folder / "a.png", frame);
  write_raw_frame(folder / "b.png", frame);
  EXPECT_EQ(read_text(folder / "a.png"), read_text(folder / "b.png"));
}

TEST(BracketFiles, EightBitsAndFloatsComeAsStored) {
  const TemporaryFolder folder;
  write_png(folder / "white.png", Image(3, 2, 3, 1.0f));
  const BracketFile eight = read_bracket_file(folder / "white.png");
  EXPECT_EQ(eight.bits, 8);
  EXPECT_EQ(eight.frame.samples, std::vector<std::uint16_t>(18, 255));
  write_exr(folder / "float.exr", Image(3, 2, 3, 2.5f));
  const BracketFile floating = read_bracket_file(folder / "float.exr");
  EXPECT_EQ(floating.bits, 0);
  EXPECT_EQ(floating.linear.values, std::vector<float>(18, 2.5f));
}

TEST(BracketFiles, PicturesAreTurnedAsTheirOrientationSays) {
  const std::vector<std::uint16_t> stored = {1, 2, 3, 4, 5, 6};  // two rows of three
  const std::array<std::vector<std::uint16_t>, 8> shown = {{{1, 2, 3, 4, 5, 6},
                                                            {3, 2, 1, 6, 5, 4},
                                                            {6, 5, 4, 3, 2, 1},
                                                            {4, 5, 6, 1, 2, 3},
                                                            {1, 4, 2, 5, 3, 6},
                                                            {4, 1, 5, 2, 6, 3},
                                                            {6, 3, 5, 2, 4, 1},
                                                            {3, 6, 2, 5, 1, 4}}};
  for (int orientation = 1; orientation <= 8; ++orientation) {
    int width = 3, height = 2;
    EXPECT_EQ(upright(stored, width, height, orientation), shown[orientation - 1]) << orientation;
    EXPECT_EQ(width, orientation < 5 ? 3 : 2);
  }
}

/// Photographs of two exposures as another tool's HDR files, with the noise that it measured.
class MeasuredBracket : public testing::Test {
 protected:
  static constexpr float unmeasured = std::numeric_limits<float>::infinity();

  void write(const std::string& name, std::initializer_list<float> values,
             std::initializer_list<float> sigma) {
    Photograph photograph{Image(static_cast<int>(values.size() / 3), 1, 3), {}};
    photograph.radiance.values = values;
    photograph.sigma = photograph.radiance;
    photograph.sigma.values = sigma;
    write_photograph(folder_ / name, photograph);
  }
  Photograph merge(const std::vector<std::string>& names, std::vector<Seconds> exposures,
                   MergeStatistics* statistics = nullptr) {
    std::vector<std::filesystem::path> paths;
    for (const std::string& name : names) paths.emplace_back(folder_ / name);
    Bracket bracket = read_bracket(paths, {}, exposures);
    return merge_bracket(bracket, {}, statistics);
  }
  const TemporaryFolder folder_;
};

TEST_F(MeasuredBracket, OneFileKeepsItsSigma) {
  write("hdr.exr", {0.25f, 7.5f, -0.01f, 1, 2, 3}, {0.5f, 0.125f, 0.25f, 0, unmeasured, 0.5f});
  const Photograph merged = merge({"hdr.exr"}, {});
  EXPECT_EQ(merged.radiance.values, (std::vector<float>{0.25f, 7.5f, -0.01f, 1, 2, 3}));
  EXPECT_NEAR(merged.sigma.values[1], 0.125f, 1e-6);
  EXPECT_NEAR(merged.sigma.values[3], 0.0f, 1e-6);
  EXPECT_EQ(merged.sigma.values[4], unmeasured);
}

TEST_F(MeasuredBracket, SeveralFilesWeighByTheirSigma) {
  write("short.exr", {0.1f, 1.0f, 9.0f}, {0.01f, 0.02f, unmeasured});
  write("long.exr", {0.44f, 5.0f, 9.0f}, {0.02f, unmeasured, unmeasured});
  MergeStatistics statistics;
  const Photograph merged = merge({"short.exr", "long.exr"}, {Seconds(0.5), Seconds(2.0)}, &statistics);
  // 0.2 ± 0.02 and 0.22 ± 0.01 a second; one sample is clipped in the long exposure, one in both.
  EXPECT_NEAR(merged.radiance.values[0], (0.2 + 4 * 0.22) / 5, 1e-6);
  EXPECT_NEAR(merged.sigma.values[0], 0.01 / std::sqrt(1.25), 1e-6);
  EXPECT_NEAR(merged.radiance.values[1], 2.0, 1e-6);
  EXPECT_NEAR(merged.sigma.values[1], 0.04, 1e-6);
  EXPECT_EQ(merged.sigma.values[2], unmeasured);
  EXPECT_NEAR(merged.radiance.values[2], 18.0, 1e-5);
  EXPECT_NEAR(statistics.clipped_fraction, 1.0 / 3.0, 1e-9);
}

TEST_F(MeasuredBracket, AllFilesCarrySigmaOrNone) {
  write("with.exr", {1, 1, 1}, {0.1f, 0.1f, 0.1f});
  write_exr(folder_ / "without.exr", Image(1, 1, 3, 1.0f));
  write("negative.exr", {1, 1, 1}, {0.1f, -0.1f, 0.1f});
  EXPECT_THROW(merge({"with.exr", "without.exr"}, {Seconds(1), Seconds(2)}), InputError);
  EXPECT_THROW(merge({"negative.exr"}, {}), InputError);
}

TEST(BracketFiles, RefusesWhatIsNoImage) {
  const TemporaryFolder folder;
  EXPECT_THROW(read_bracket_file(folder / "none.png"), DeviceError);
  write_text_atomically(folder / "text.png", "not an image");
  EXPECT_THROW(read_bracket_file(folder / "text.png"), FormatError);
  const RawFrame frame{64,  64, PixelLayout::grey, std::vector<std::uint16_t>(4096, 999), {}, Seconds(1),
                       1.0, 0};
  write_raw_frame(folder / "cut.png", frame);
  std::filesystem::resize_file(folder / "cut.png", 60);
  EXPECT_THROW(read_bracket_file(folder / "cut.png"), FormatError);
}

}  // namespace
}  // namespace refield
