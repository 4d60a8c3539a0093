// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/field_sampler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "core/base/errors.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr LightDomain domain{16, 8, Parameterisation::lat_long};
constexpr std::uint64_t any_size = 0;

class FieldSamplerTest : public testing::Test {
 protected:
  FieldSamplerTest() {
    field_.quality.training_error.clear();
    for (std::size_t p = 0; p < 41 * 23; ++p) field_.quality.training_error.push_back(static_cast<float>(p));
    write_reflectance_field(file_, field_);
  }

  Rng rng_{3};
  const test::TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "f.rfield";
  ReflectanceField field_ = test::random_field(rng_, 41, 23, domain, 60, 7);
};

TEST_F(FieldSamplerTest, PixelsAreThoseOfTheField) {
  const auto file = FieldSampler::open(file_, {}, any_size);
  ASSERT_TRUE(file);
  const LightMap light = test::random_light(rng_, domain);
  const Image all = field_.relight(light);
  for (const PixelGrid& grid : {PixelGrid{{0, 0, 41, 23}, 1}, PixelGrid{{0, 0, 41, 23}, 5},
                                PixelGrid{{7, 3, 30, 22}, 3}, PixelGrid{{40, 22, 41, 23}, 4}}) {
    const ReflectanceField part = file->read(grid);
    EXPECT_LE(part.basis.boxes.size(), field_.basis.boxes.size());
    const Image shown = part.relight(light);
    ASSERT_EQ(shown.width, grid.width());
    ASSERT_EQ(shown.height, grid.height());
    for (int y = 0; y < grid.height(); ++y)
      for (int x = 0; x < grid.width(); ++x) {
        const int of_x = grid.x_of(x), of_y = grid.y_of(y);
        for (int c = 0; c < 3; ++c) ASSERT_EQ(shown.at(x, y, c), all.at(of_x, of_y, c));
        ASSERT_EQ(part.quality.training_error[static_cast<std::size_t>(y) * grid.width() + x],
                  static_cast<float>(of_y * 41 + of_x));
        const auto back = grid.position_of({of_x, of_y});
        ASSERT_TRUE(back && back->x == x && back->y == y);
      }
  }
  EXPECT_THROW(file->read({{0, 0, 42, 23}, 1}), InputError);
  EXPECT_THROW(file->read({{0, 0, 41, 23}, 0}), InputError);
}

TEST_F(FieldSamplerTest, LeavesSmallAndOtherFilesToOthers) {
  EXPECT_FALSE(FieldSampler::open(file_));
  EXPECT_FALSE(FieldSampler::open(folder_ / "missing.rfield", {}, any_size));
  Rng rng(5);
  write_reflectance_field(file_, test::random_field(rng, 9, 7, {4, 24, Parameterisation::cube}, 20, 5));
  EXPECT_FALSE(FieldSampler::open(file_, {}, any_size)) << "a cube map";
}

TEST_F(FieldSamplerTest, RefusesWhatItReadsAndCannotUse) {
  field_.transfer.weight[3] = 0.25f;  // no other weight: bytes to find
  write_reflectance_field(file_, field_);
  std::ifstream in(file_, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const auto at = bytes.find(std::string(reinterpret_cast<const char*>(field_.transfer.weight.data()), 24));
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at + 12, 4, std::string("\x00\x00\xc0\x7f", 4));  // NaN
  std::ofstream(file_, std::ios::binary) << bytes;
  const auto file = FieldSampler::open(file_, {}, any_size);
  EXPECT_THAT(test::message_of<FormatError>([&] {
                file->read({{0, 0, 41, 23}, 1});
              }),
              testing::AllOf(testing::HasSubstr(file_.string()), testing::HasSubstr("not finite")));
  EXPECT_NO_THROW(file->read({{20, 11, 41, 23}, 1})) << "pixels that are sound";
}

}  // namespace
}  // namespace refield
