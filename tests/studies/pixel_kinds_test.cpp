// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/pixel_kinds.h"

#include <gtest/gtest.h>

#include <fstream>

#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "tests/support/temporary_folder.h"

namespace refield::chart {
namespace {

TEST(PixelKinds, ComeBackAsWritten) {
  const test::TemporaryFolder folder;
  PixelKinds kinds{3, 2, {"diffuse", "glossy", "refraction", "hard_shadow", "mixed"}, {0, 1, 2, 3, 4, 5}};
  write_pixel_kinds(folder / "k.png", kinds);
  const PixelKinds read = read_pixel_kinds(folder / "k.png", 3, 2);
  EXPECT_EQ(read.names, kinds.names);
  EXPECT_EQ(read.labels, kinds.labels);
}

TEST(PixelKinds, APaintedPictureWithNamesOfItsOwn) {
  const test::TemporaryFolder folder;
  Image image(2, 1, 1);
  image.at(1, 0, 0) = 1.0f;
  write_png(folder / "k.png", image);
  std::ofstream(folder / "k.json") << R"({"255": "window"})";
  const PixelKinds read = read_pixel_kinds(folder / "k.png", 2, 1);
  EXPECT_EQ(read.names, std::vector<std::string>{"window"});
  EXPECT_EQ(read.labels, (std::vector<std::uint8_t>{0, 1}));
}

TEST(PixelKinds, MaskOfAKindLiesWithinTheMask) {
  const PixelKinds kinds{4, 1, {"a", "b"}, {1, 2, 2, 0}};
  EXPECT_EQ(kinds.mask_of(1, {}), (Mask{0, 1, 1, 0}));
  EXPECT_EQ(kinds.mask_of(1, {1, 0, 1, 1}), (Mask{0, 0, 1, 0}));
}

TEST(PixelKinds, RefusesWhatDoesNotFit) {
  const test::TemporaryFolder folder;
  write_pixel_kinds(folder / "k.png", {3, 2, {"a"}, {0, 1, 0, 1, 0, 1}});
  EXPECT_THROW(read_pixel_kinds(folder / "k.png", 2, 3), InputError);
  for (const char* names : {"", "[1]", R"({"fifty": "a"})", R"({"256": "a"})", R"({"50": 1})"}) {
    std::ofstream(folder / "k.json") << names;
    EXPECT_THROW(read_pixel_kinds(folder / "k.png", 3, 2), FormatError) << names;
  }
  EXPECT_THROW(write_pixel_kinds(folder / "k.png", {1, 1, std::vector<std::string>(6, "x"), {0}}),
               InputError);
}

}  // namespace
}  // namespace refield::chart
