// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/base/errors.h"
#include "core/image/tone_map.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

constexpr LightDomain domain{24, 16, Parameterisation::monitor};

class ViewStateTest : public testing::Test {
 protected:
  ReflectanceField make_field() {
    ReflectanceField field = test::random_field(rng_, 30, 20, domain, 80, 25);
    field.basis.hats = {};
    field.quality.predicted_error.resize(600);
    for (std::size_t p = 0; p < 600; ++p) field.quality.predicted_error[p] = static_cast<float>(p) / 600.0f;
    return field;
  }
  /// What the state holds is what the field gives under this light.
  void expect_relit(const LightMap& light) {
    state_.refresh();
    const Image expected = field_.relight(light);
    ASSERT_TRUE(state_.radiance().same_shape(expected));
    double difference = 0.0, sum = 0.0;
    for (std::size_t i = 0; i < expected.values.size(); ++i) {
      difference += std::pow(state_.radiance().values[i] - expected.values[i], 2.0);
      sum += std::pow(expected.values[i], 2.0);
    }
    constexpr double accuracy = 1e-5;  // of weights of 16 bits, and what incremental relighting keeps to
    EXPECT_LE(std::sqrt(difference), accuracy * std::sqrt(sum));
    if (state_.shown() != Shown::picture) return;
    const auto levels = tone_mapped(state_.radiance(), state_.tone_in_use());
    for (std::size_t p = 0; p < expected.pixel_count(); ++p)
      for (std::size_t c = 0; c < 3; ++c) ASSERT_EQ(state_.picture()[4 * p + c], levels[3 * p + c]);
  }
  void expect_painted_light() {
    state_.refresh();
    expect_relit(state_.light());
  }

  Rng rng_{1};
  const ReflectanceField field_ = make_field();
  ViewState state_{ReflectanceField(field_)};
};

TEST_F(ViewStateTest, StartsLitAndExposed) {
  const auto first = state_.refresh();
  EXPECT_TRUE(first.picture && first.light);
  expect_painted_light();
  EXPECT_EQ(state_.setup().light_sources.size(), 2U);
  const auto white = std::ranges::count_if(state_.picture(), [](std::uint8_t level) { return level == 255; });
  EXPECT_GT(white, 600);        // each pixel's alpha, and some of it
  EXPECT_LT(white, 600 + 200);  // but not much
  const auto nothing = state_.refresh();
  EXPECT_FALSE(nothing.picture || nothing.light || nothing.kernels);
}

TEST_F(ViewStateTest, FollowsTheLight) {
  PaintedLight light_source = state_.setup().light_sources[0];
  for (int i = 0; i < 40; ++i) {
    light_source.x = rng_.uniform();
    light_source.y = rng_.uniform();
    state_.setup().light_sources[0] = light_source;
    const auto done = state_.refresh();
    EXPECT_TRUE(done.picture && done.light);
    expect_painted_light();
  }
  state_.setup().set_map(test::random_light(rng_, domain));
  expect_painted_light();
  state_.setup().set_turns(0.3);
  expect_painted_light();
  state_.reset_light_sources();
  expect_painted_light();
}

TEST_F(ViewStateTest, ProbeIsAColumnOfTheTransfer) {
  const auto alone = [](const Box& box) {
    LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = 1.0f;
    return light;
  };
  for (int i = 0; i < 3; ++i) {  // begins anew each time
    for (int k = 0; k < 10; ++k) {
      const int x = static_cast<int>(rng_.below(domain.width - 2)),
                y = static_cast<int>(rng_.below(domain.height - 1));
      const Box box{x, y, x + 2, y + 1};
      state_.probe(box);
      expect_relit(alone(box));
    }
    PaintedLight light_source = state_.setup().light_sources[1];
    light_source.x = rng_.uniform();
    state_.setup().light_sources[1] = light_source;  // meanwhile
    state_.refresh();
    state_.probe(std::nullopt);
    expect_painted_light();
  }
  state_.probe(Box{20, 3, 30, 4});  // reaches outside
  EXPECT_FALSE(state_.probed());
}

TEST_F(ViewStateTest, ProbeKeepsThePicturesExposure) {
  const double before = state_.tone().exposure;
  state_.probe(Box{3, 3, 5, 5});
  state_.refresh();
  const double during = state_.tone_in_use().exposure;
  EXPECT_NE(during, before);
  state_.probe(Box{8, 9, 10, 11});
  EXPECT_EQ(state_.tone_in_use().exposure, during);
  state_.probe(std::nullopt);
  state_.refresh();
  EXPECT_EQ(state_.tone_in_use().exposure, before);
}

TEST_F(ViewStateTest, PickedPixelShowsItsKernels) {
  state_.pick(PixelPosition{7, 5});
  EXPECT_TRUE(state_.refresh().kernels);
  const std::size_t pixel = 5 * 30 + 7;
  const auto& kernels = state_.kernels();
  ASSERT_EQ(kernels.size(), field_.transfer.row_start[pixel + 1] - field_.transfer.row_start[pixel]);
  // The light that the kernels take is the pixel's.
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0.0;
    for (const PixelKernel& kernel : kernels)
      for (int y = kernel.support.y0; y < kernel.support.y1; ++y)
        for (int x = kernel.support.x0; x < kernel.support.x1; ++x)
          sum += kernel.weight[c] * state_.light().radiance.at(x, y, static_cast<int>(c));
    EXPECT_NEAR(sum, state_.radiance().at(7, 5, static_cast<int>(c)), 1e-4 * (1.0 + sum));
  }
  state_.pick(PixelPosition{30, 5});
  EXPECT_FALSE(state_.picked());
  EXPECT_TRUE(state_.refresh().kernels);
  EXPECT_TRUE(state_.kernels().empty());
}

TEST_F(ViewStateTest, ShowsErrorsAndFalseColours) {
  state_.show(Shown::predicted_error);
  state_.refresh();
  EXPECT_NEAR(state_.error_range(), 0.98, 0.01);
  const auto expected = [&](std::size_t pixel, int c) {
    return std::lround(255.0f *
                       false_colour(state_.field().quality.predicted_error[pixel] / state_.error_range())[c]);
  };
  for (const std::size_t pixel : {0U, 100U, 300U, 599U})
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(state_.picture()[4 * pixel + c], expected(pixel, c), 2);
  // The light does not change this picture.
  state_.setup().ambient = 0.5;
  EXPECT_FALSE(state_.refresh().picture);
  state_.show(Shown::false_colour);
  EXPECT_TRUE(state_.refresh().picture);
  EXPECT_FALSE(state_.has(Shown::photograph_noise));
  EXPECT_THROW(state_.show(Shown::photograph_noise), InputError);
  EXPECT_THROW(ViewState{ReflectanceField{}}, InputError);
}

/// Under an environment that takes long to project onto its light map: 400 thousand texels.
class ViewStateUnderAnEnvironment : public testing::Test {
 protected:
  static constexpr LightDomain cube{256, 6 * 256, Parameterisation::cube};
  static constexpr std::chrono::milliseconds frame{5};

  ViewStateUnderAnEnvironment() {
    state_.setup().light_sources.clear();
    state_.setup().ambient = 0.0;
    state_.setup().environment = std::make_shared<const PreparedEnvironment>(environment_);
    state_.setup().projector = projector_;
    state_.refresh();
  }
  LightMap light_at(double turns) {
    LightPainter painter(cube);
    LightSetup setup = state_.setup();
    setup.set_turns(turns);
    painter.paint(setup);
    return painter.light();
  }

  Rng rng_{4};
  const LightMap environment_ = test::random_light(rng_, {128, 64, Parameterisation::lat_long});
  std::shared_ptr<const EnvironmentProjector> projector_ =
      std::make_shared<const EnvironmentProjector>(cube, std::span<const MonitorPlacement>());
  const ReflectanceField field_ = test::random_field(rng_, 8, 6, cube, 40, 5);
  ViewState state_{ReflectanceField(field_)};
};

// Each frame shows the picture before until the next is ready, and a drag of many frames costs at most one
// projection per frame: what is made next is what is wanted then. The last one is what stays.
TEST_F(ViewStateUnderAnEnvironment, FramesGoOnAndTheNewestTurnWins) {
  const Image before = state_.radiance();
  const std::size_t relit_before = state_.relit();
  constexpr int moves = 60;
  for (int i = 1; i <= moves; ++i) {
    state_.setup().set_turns(0.4 * i / moves);
    state_.refresh(frame);
    if (i == 1 && state_.relit() == relit_before) {
      EXPECT_EQ(state_.radiance().values, before.values);
    }
  }
  state_.refresh();
  EXPECT_TRUE(state_.is_current());
  EXPECT_LE(state_.relit() - relit_before, static_cast<std::size_t>(moves));
  EXPECT_EQ(state_.light().radiance.values, light_at(0.4).radiance.values);
}

TEST_F(ViewStateUnderAnEnvironment, ClosingDoesNotWaitForTheProjection) {
  state_.setup().set_turns(0.1);
  state_.refresh(std::chrono::milliseconds(0));
  EXPECT_FALSE(state_.is_current());
}  // the job is cancelled; a test that hangs here has failed

TEST_F(ViewStateUnderAnEnvironment, ExposureFollowsThePictureThatIsMade) {
  state_.expose_picture();
  const double before = state_.tone().exposure;
  state_.setup().map_gain = 8.0;
  state_.expose_picture();  // of a picture that is not there yet
  state_.refresh();
  EXPECT_NEAR(state_.tone().exposure, before / 8.0, 1e-3 * before);
}

}  // namespace
}  // namespace refield
