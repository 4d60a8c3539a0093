// SPDX-License-Identifier: Apache-2.0
#include "acquire/bracket_files.h"

#include <gtest/gtest.h>

#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/rng.h"
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
