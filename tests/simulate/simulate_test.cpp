// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/simulate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

// The tabletop, small enough for a unit test.
Recipe small_recipe() {
  Recipe recipe =
      read_recipe(std::filesystem::path(REFIELD_SOURCE_DIR) / "datasets_synthetic/tabletop/recipe.toml");
  recipe.scene.camera.width = 16;
  recipe.scene.camera.height = 12;
  recipe.scene.monitor.texels.width = 32;
  recipe.scene.monitor.texels.height = 24;
  recipe.lights = {.train = 3, .natural = 1, .bars = 2, .squares = 1, .white = 1, .black = 1};
  return recipe;
}

// Quick tracing: these tests look at the session, not at the picture.
SimulateOptions quick() {
  return {.quality = 1};
}

/// Mean absolute difference of two pictures, the second looked up `right` pixels to the right, relative to
/// the mean.
double difference(const Image& a, const Image& b, int right) {
  double sum = 0.0, total = 0.0;
  for (int y = 0; y < a.height; ++y)
    for (int x = 2; x < a.width - 2; ++x)
      for (int c = 0; c < 3; ++c) {
        sum += std::abs(a.at(x, y, c) - b.at(x + right, y, c));
        total += a.at(x, y, c);
      }
  return sum / total;
}

// A turn by whole pixels leaves the picture as it is but for that, to what the noise of tracing, the
// perspective of a field of view of 25 degrees and a picture of 16 pixels leave: 0.40 of the difference.
TEST(SimulateSession, ThePictureMovesWithTheCamera) {
  SceneDescription scene = small_recipe().scene;
  const LightMap white{Image(32, 24, 3, 1.0f), Parameterisation::monitor};
  const auto picture = [&] {
    return trace_scene(scene, TraceOptions::of_quality(2, 1)).transport.relight(white);
  };
  const Image before = picture();
  scene.camera = turned(scene.camera, 2.0, 0.0);
  const Image after = picture();
  EXPECT_LT(difference(before, after, 2), 0.5 * difference(before, after, 0));
}

TEST(SimulateSession, PhotographsAreTheTransportTimesTheLight) {
  const test::TemporaryFolder folder;
  Recipe recipe = small_recipe();
  recipe.rig.sensor.mixing[0][1] = 0.1;  // what the sensor mixes is part of both
  const SimulateSummary summary = simulate_session(recipe, quick(), folder.path());
  const ReflectanceField field = read_reflectance_field(folder / transport_file_name);
  CaptureSession session = read_capture_session(folder.path());
  EXPECT_NO_THROW(check_image_sizes(session));
  EXPECT_EQ(session.frames.size(), 9u);
  EXPECT_EQ(summary.lights, 9);
  EXPECT_GT(summary.rays, 0u);
  std::map<std::string, int> kinds;
  for (const CaptureFrame& frame : session.frames) {
    ++kinds[frame.kind];
    const LightMap light = read_light_map(frame.illumination, session.light.parameterisation);
    const Image observed = read_image(frame.observed);
    const Image relit = field.relight(light);
    for (std::size_t i = 0; i < observed.values.size(); ++i)
      ASSERT_NEAR(observed.values[i], relit.values[i], 1e-5f * relit.values[i] + 1e-8f)
          << frame.name;  // float sums
  }
  EXPECT_EQ(kinds, (std::map<std::string, int>{
                       {"natural", 4}, {"bar", 2}, {"square", 1}, {"white", 1}, {"black", 1}}));
  EXPECT_EQ(session.frames_of(FrameRole::train).size(), 3u);
  EXPECT_FALSE(session.ambient);  // these photographs hold no ambient light
  const Image ambient = read_image(folder / ambient_file_name);
  EXPECT_EQ(ambient.width, 16);
  EXPECT_GT(ambient.at(8, 10, 1), 0.0f);
}

TEST(SimulateSession, SameRecipeGivesTheSameFilesAndNoTransportWhereNotWanted) {
  const test::TemporaryFolder a, b;
  SimulateOptions options = quick();
  simulate_session(small_recipe(), options, a.path());
  options.keep_transport = false;
  const SimulateSummary summary = simulate_session(small_recipe(), options, b.path());
  EXPECT_EQ(summary.transport_bytes, 0u);
  EXPECT_FALSE(std::filesystem::exists(b / transport_file_name));
  const CaptureSession one = read_capture_session(a.path()), other = read_capture_session(b.path());
  for (std::size_t k = 0; k < one.frames.size(); ++k) {
    EXPECT_EQ(read_image(one.frames[k].observed).values, read_image(other.frames[k].observed).values);
    EXPECT_EQ(read_image(one.frames[k].illumination).values, read_image(other.frames[k].illumination).values);
  }
}

TEST(SimulateSession, NoiseHasTheAskedSize) {
  const test::TemporaryFolder clean, noisy;
  SimulateOptions options = quick();
  options.keep_transport = false;
  simulate_session(small_recipe(), options, clean.path());
  options.noise = 0.02;
  simulate_session(small_recipe(), options, noisy.path());
  const CaptureSession a = read_capture_session(clean.path()), b = read_capture_session(noisy.path());
  double square = 0.0, count = 0.0;
  for (std::size_t k = 0; k < a.frames.size(); ++k) {
    const Image x = read_image(a.frames[k].observed), y = read_image(b.frames[k].observed);
    for (std::size_t i = 0; i < x.values.size(); ++i)
      if (x.values[i] > 0.0f) {
        square += std::pow(y.values[i] / x.values[i] - 1.0, 2);
        ++count;
      }
  }
  // A sample variance errs by sqrt(2/n); five times that.
  EXPECT_NEAR(std::sqrt(square / count), 0.02, 0.02 * 5.0 / std::sqrt(2.0 * count));
}

TEST(SimulateSession, HalfPrecisionPhotographsFitTheirHalfPrecisionLights) {
  const test::TemporaryFolder folder;
  SimulateOptions options = quick();
  options.precision = Precision::half;
  simulate_session(small_recipe(), options, folder.path());
  const ReflectanceField field = read_reflectance_field(folder / transport_file_name);
  for (const CaptureFrame& frame : read_capture_session(folder.path()).frames) {
    const Image observed = read_image(frame.observed);
    const Image relit = field.relight(read_light_map(frame.illumination, Parameterisation::monitor));
    EXPECT_LE(relative_rmse(relit, observed), 5e-4) << frame.name;  // half: 11 bits
  }
}

TEST(SimulateSession, RefusesSenselessOptions) {
  SimulateOptions options;
  options.noise = -1.0;
  EXPECT_THROW(options.check(), InputError);
  options.noise = 0.0;
  options.quality = 7;
  EXPECT_THROW(options.check(), InputError);
}

}  // namespace
}  // namespace refield
