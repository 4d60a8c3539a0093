// SPDX-License-Identifier: Apache-2.0
// Large fields in the viewer: coarse pixels of all of the image, and those of the visible region.

#include <gtest/gtest.h>

#include <cmath>

#include "relight/viewer/field/view_state.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr int width = 1300, height = 900;  // more than the coarse pixels at most
constexpr LightDomain domain{24, 16, Parameterisation::monitor};
constexpr std::uint64_t any_size = 0;

class LargeField : public testing::Test {
 protected:
  LargeField() { write_reflectance_field(file_, field_); }

  std::unique_ptr<const FieldSampler> open() const { return FieldSampler::open(file_, {}, any_size); }

  /// The image holds the pixels of a grid under a light.
  void expect_pixels(const Image& shown, const PixelGrid& grid, const LightMap& light) const {
    const Image all = field_.relight(light);
    ASSERT_EQ(shown.width, grid.width());
    ASSERT_EQ(shown.height, grid.height());
    double difference = 0.0, sum = 0.0;
    for (int y = 0; y < grid.height(); ++y)
      for (int x = 0; x < grid.width(); ++x)
        for (int c = 0; c < 3; ++c) {
          const float expected = all.at(grid.x_of(x), grid.y_of(y), c);
          difference += std::pow(shown.at(x, y, c) - expected, 2.0);
          sum += std::pow(expected, 2.0);
        }
    EXPECT_LE(std::sqrt(difference), 1e-5 * std::sqrt(sum));
  }

  Rng rng_{1};
  const test::TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "large.rfield";
  const ReflectanceField field_ = test::random_field(rng_, width, height, domain, 80, 3);
};

void finish_reading(DetailLoader& loader, const VisibleRegion& visible) {
  loader.show(visible);
  while (loader.is_reading()) {
    loader.wait_at_rest();
    loader.show(visible);
  }
}

TEST_F(LargeField, DetailFollowsTheVisibleRegion) {
  DetailLoader loader(open(), {});
  const VisibleRegion all{{0, 0, width, height}, 0.5};
  const auto first = loader.coarse();
  EXPECT_EQ(first->grid, (PixelGrid{{0, 0, width, height}, 4}));
  EXPECT_EQ(loader.show(all), first);
  finish_reading(loader, all);
  const auto coarse = loader.coarse();
  EXPECT_EQ(coarse->grid, (PixelGrid{{0, 0, width, height}, 2}));
  EXPECT_EQ(loader.show(all), coarse);
  EXPECT_FALSE(loader.is_reading()) << "the coarse pixels suffice";

  const VisibleRegion seen{{400, 300, 720, 540}, 2.0};
  EXPECT_EQ(loader.show(seen), coarse) << "until the region is read";
  finish_reading(loader, seen);
  const auto detail = loader.show(seen);
  EXPECT_EQ(detail->grid, (PixelGrid{{360, 270, 760, 570}, 1}));
  EXPECT_EQ(loader.show(VisibleRegion{{410, 310, 730, 550}, 2.0}), detail) << "a small move";
  EXPECT_FALSE(loader.is_reading());

  const VisibleRegion beside{{430, 300, 750, 540}, 2.0};
  EXPECT_EQ(loader.show(beside), detail) << "still covered";
  EXPECT_TRUE(loader.is_reading()) << "ahead of the next move";
  finish_reading(loader, beside);
  EXPECT_EQ(loader.show(VisibleRegion{{900, 600, 1220, 840}, 2.0}), coarse) << "elsewhere";
  finish_reading(loader, beside);  // what was read before is given up
  EXPECT_EQ(loader.show(std::nullopt), coarse);
}

TEST_F(LargeField, IsRelitWhereItIsSeen) {
  ViewState state(open());
  EXPECT_EQ(state.image_width(), width);
  state.refresh();
  expect_pixels(state.radiance(), {{0, 0, width, height}, 4}, state.light());
  const auto look_at = [&](const std::optional<VisibleRegion>& visible) {
    do {
      state.look_at(visible);
      state.refresh();
    } while (state.is_reading());
  };
  look_at(std::nullopt);
  expect_pixels(state.radiance(), {{0, 0, width, height}, 2}, state.light());

  const VisibleRegion seen{{400, 300, 720, 540}, 2.0};
  const auto look = [&] { look_at(seen); };
  look();
  const PixelGrid detail{{360, 270, 760, 570}, 1};
  EXPECT_EQ(state.grid(), detail);
  expect_pixels(state.radiance(), detail, state.light());
  PaintedLight moved = state.setup().light_sources[0];
  moved.x = 0.6;
  state.setup().light_sources[0] = moved;
  look();
  expect_pixels(state.radiance(), detail, state.light());

  const PixelPosition odd{401, 303};
  state.pick(odd);
  state.refresh();
  EXPECT_EQ(state.picked(), odd);
  const auto kernels = kernels_of_pixel(field_, std::size_t{303} * width + 401);
  EXPECT_EQ(state.kernels().size(), kernels.size());
  state.look_at(std::nullopt);
  EXPECT_FALSE(state.is_current());
  state.refresh();
  EXPECT_EQ(state.grid().stride, 2);
  expect_pixels(state.radiance(), state.grid(), state.light());
  EXPECT_EQ(state.kernels().size(), kernels.size()) << "stay, though the pixel is not shown";
  state.pick(odd);
  EXPECT_EQ(state.picked(), (PixelPosition{400, 302})) << "the pixel before it that is shown";

  state.probe(Box{3, 4, 9, 10});
  state.refresh();
  look();
  LightMap probe{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int y = 4; y < 10; ++y)
    for (int x = 3; x < 9; ++x)
      for (int c = 0; c < 3; ++c) probe.radiance.at(x, y, c) = 1.0f;
  expect_pixels(state.radiance(), detail, probe);
}

}  // namespace
}  // namespace refield
