// SPDX-License-Identifier: Apache-2.0
// Known environment, photographed on a ray-traced mirror ball, come back as the light map that they were.
#include "acquire/light_probe/light_probe.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "acquire/light_probe/mirror_ball.h"
#include "acquire/light_probe/unwrap.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/units.h"
#include "simulate/rig/light_maps.h"
#include "tests/pipeline/mirror_ball_photo.h"
#include "tests/pipeline/program.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr double two_per_cent = 0.02;  // what a light probe must reach away from its blind spots
constexpr int map_width = 32;

using Indices = std::array<std::complex<double>, 3>;
const Indices chrome = {{{3.09, 3.34}, {3.18, 3.33}, {2.33, 3.14}}};
const Indices silver = {{{0.05, 4.483}, {0.06, 3.586}, {0.04, 2.657}}};

/// Mean over each texel's solid angle of the map as photograph_mirror_ball() looks it up (bilinearly).
Image resampled(const Image& map, int width) {
  constexpr int samples = 16;
  const auto at = [&](int x, int y, int c) {
    return map.at((x + map.width) % map.width, std::clamp(y, 0, map.height - 1), c);
  };
  Image result(width, width / 2, 3);
  for (int y = 0; y < result.height; ++y)
    for (int x = 0; x < width; ++x) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      double total = 0.0;
      for (int s = 0; s < samples * samples; ++s) {
        const double row = y + (s / samples + 0.5) / samples;
        const double solid_angle = std::sin(std::numbers::pi * row / result.height);
        const double px = (x + (s % samples + 0.5) / samples) * map.width / width - 0.5;
        const double py = row * map.height / result.height - 0.5;
        const int ix = static_cast<int>(std::floor(px)), iy = static_cast<int>(std::floor(py));
        const double tx = px - ix, ty = py - iy;
        for (int c = 0; c < 3; ++c)
          sum[c] += solid_angle * ((1 - ty) * ((1 - tx) * at(ix, iy, c) + tx * at(ix + 1, iy, c)) +
                                   ty * ((1 - tx) * at(ix, iy + 1, c) + tx * at(ix + 1, iy + 1, c)));
        total += solid_angle;
      }
      for (int c = 0; c < 3; ++c) result.at(x, y, c) = static_cast<float>(sum[c] / total);
    }
  return result;
}

/// Relative RMSE over the sphere, by solid angle, further than the given angles from the two blind spots.
double error_on_sphere(const Image& found, const Image& truth, const Eigen::Vector3d& camera_looks,
                       double behind_degrees, double camera_degrees) {
  double error = 0.0, signal = 0.0;
  for (int y = 0; y < truth.height; ++y)
    for (int x = 0; x < truth.width; ++x) {
      const double along = lat_long_direction(x + 0.5, y + 0.5, truth.width, truth.height).dot(camera_looks);
      if (along > std::cos(radians_from_degrees(behind_degrees)) ||
          -along > std::cos(radians_from_degrees(camera_degrees)))
        continue;
      const double solid_angle = std::sin(std::numbers::pi * (y + 0.5) / truth.height);
      for (int c = 0; c < 3; ++c) {
        error += solid_angle * std::pow(found.at(x, y, c) - truth.at(x, y, c), 2.0);
        signal += solid_angle * std::pow(truth.at(x, y, c), 2.0);
      }
    }
  return std::sqrt(error / signal);
}

struct Rig {
  MirrorBallScene scene;
  EulerAngles turn;

  /// A photograph of `side`² pixels that the ball fills by `fill`.
  Rig(int side, const Eigen::Vector3d& centre, double fill, const EulerAngles& camera_turn,
      const Indices& mirror)
      : turn(camera_turn) {
    scene.width = scene.height = side;
    scene.ball_centre = centre;
    scene.focal_px = fill * 0.5 * side / std::tan(std::asin(1.0 / centre.norm()));
    scene.world_from_camera = rotation_of(turn);
    scene.refractive_index = mirror;
    scene.samples = 4;
  }
  MirrorBall ball() const {
    return {{scene.focal_px, Eigen::Vector2d(scene.width, scene.height) / 2.0},
            scene.ball_centre.normalized(),
            scene.ball_centre.norm()};
  }
  Eigen::Vector3d looks() const { return scene.world_from_camera * scene.ball_centre.normalized(); }
};

SeenLight probed(const Image& environment, const Rig& rig, const MirrorReflectance& reflectance) {
  UnwrapOptions options;
  options.width = map_width;
  options.reflectance = reflectance;
  return unwrap({photograph_mirror_ball(environment, rig.scene), {}}, rig.ball(), rig.turn, {}, options);
}

TEST(LightProbe, KnownSurroundingsComeBackFromAfar) {
  const Image environment = make_panorama(11, 0, 128);
  const Rig rig(176, {0.0, 0.0, 30.0}, 0.95, {}, chrome);
  const SeenLight light = probed(environment, rig, MirrorReflectance::chrome());
  EXPECT_LT(error_on_sphere(light.radiance, resampled(environment, map_width), rig.looks(), 40.0, 7.0),
            two_per_cent);
}

TEST(LightProbe, KnownSurroundingsComeBackFromNearAndAside) {
  const Image environment = make_panorama(11, 1, 128);
  Rig rig(300, {0.5, -0.4, 4.0}, 0.6, {70.0, 25.0, 10.0}, silver);
  rig.scene.samples = 3;
  const SeenLight light = probed(environment, rig, MirrorReflectance::silver());
  EXPECT_LT(error_on_sphere(light.radiance, resampled(environment, map_width), rig.looks(), 40.0, 7.0),
            two_per_cent);
}

TEST(LightProbe, TwoSidesShowTheWholeSphere) {
  const Image environment = make_panorama(11, 2, 128);
  const Rig east(192, {0.0, 0.0, 12.0}, 0.95, {0.0, 0.0, 0.0}, chrome);
  const Rig north(192, {0.0, 0.0, 12.0}, 0.95, {90.0, 0.0, 0.0}, chrome);
  const SeenLight light = join({probed(environment, east, MirrorReflectance::chrome()),
                                probed(environment, north, MirrorReflectance::chrome())});
  EXPECT_EQ(unseen_fraction(light.weight), 0.0);
  EXPECT_LT(error_on_sphere(light.radiance, resampled(environment, map_width), east.looks(), 0.0, 0.0),
            two_per_cent);
}

TEST(LightProbe, ASmallSunKeepsItsPlaceAndItsEnergy) {
  Image environment(128, 64, 3, 0.2f);
  for (int c = 0; c < 3; ++c) environment.at(25, 20, c) = 2e4f;
  Rig rig(128, {0.0, 0.0, 10.0}, 0.95, {130.0, 0.0, 0.0}, chrome);
  rig.scene.samples = 6;
  const SeenLight light = probed(environment, rig, MirrorReflectance::chrome());
  const auto flux = [](const Image& map) {
    double sum = 0.0;
    for (int y = 0; y < map.height; ++y)
      for (int x = 0; x < map.width; ++x) {
        const double along = lat_long_direction(x + 0.5, y + 0.5, map.width, map.height)
                                 .dot(lat_long_direction(25.5, 20.5, 128, 64));
        if (along > std::cos(radians_from_degrees(12.0)))
          sum += std::sin(std::numbers::pi * (y + 0.5) / map.height) * map.at(x, y, 1) /
                 (static_cast<double>(map.width) * map.height);
      }
    return sum;
  };
  EXPECT_NEAR(flux(light.radiance) / flux(resampled(environment, map_width)), 1.0, 0.01);
}

TEST(LightProbe, FindsTheBallBeforeABackdrop) {
  const Image environment = make_panorama(5, 4, 512);
  for (double distance : {6.0, 40.0}) {
    Rig rig(320, {0.1, -0.06, distance}, 0.85, {}, silver);
    rig.scene.backdrop = Eigen::Vector3f(0.6f, 0.6f, 0.6f);
    ProbeOptics optics;
    optics.focal_px = rig.scene.focal_px;
    optics.principal_px = {160.0, 160.0};
    const Image photograph = photograph_mirror_ball(environment, rig.scene);
    const OutlineFit fit = find_ball(photograph, optics);
    constexpr double third_of_a_pixel = 0.34;
    EXPECT_NEAR((fit.ball.centre_px() - rig.ball().centre_px()).norm(), 0.0, third_of_a_pixel);
    EXPECT_NEAR(fit.ball.radius_px(), rig.ball().radius_px(), third_of_a_pixel);
  }
}

TEST(LightProbe, FillsWhatItDoesNotSee) {
  SeenLight light{Image(64, 32, 3), Image(64, 32, 1), Mask(64 * 32, 0)};
  // A smooth sky with a hole over the pole and another across the map's edge.
  const auto sky = [](int x, int y) {
    return static_cast<float>(
        2.0 + lat_long_direction(x + 0.5, y + 0.5, 64, 32).dot(Eigen::Vector3d(0.3, 0.8, 0.5)));
  };
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) {
      const bool hole = y < 3 || (y > 12 && y < 17 && (x < 2 || x > 61));
      light.weight.at(x, y, 0) = hole ? 0.0f : 1.0f;
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = hole ? 0.0f : sky(x, y);
    }
  fill_unseen(light);
  double worst = 0.0;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x)
      worst = std::max<double>(worst, std::abs(light.radiance.at(x, y, 1) - sky(x, y)));
  constexpr double slope_over_half_a_hole = 0.12;  // a mean cannot follow the slope within the hole
  EXPECT_LT(worst, slope_over_half_a_hole);
  SeenLight nothing{Image(64, 32, 3), Image(64, 32, 1), Mask(64 * 32, 0)};
  EXPECT_THROW(fill_unseen(nothing), InputError);
}

/// The whole step, from files to files.
class ProbeFiles : public ::testing::Test {
 protected:
  ProbeFiles() {
    rig_.scene.samples = 2;
    side_.distance_radii = rig_.scene.ball_centre.norm();
    side_.ball = ImageCircle{rig_.ball().centre_px(), rig_.ball().radius_px()};
    request_.unwrap.width = 32;
    request_.folder = folder_ / "sky";
  }

  /// `peak`: the camera clips there, 0: nowhere.
  void add(const std::string& name, const Image& environment, float peak = 0.0f) {
    Photograph photograph{photograph_mirror_ball(environment, rig_.scene), Image(128, 128, 3, 0.001f)};
    for (std::size_t i = 0; peak > 0.0f && i < photograph.radiance.values.size(); ++i)
      if (photograph.radiance.values[i] >= peak) {
        photograph.radiance.values[i] = peak;
        photograph.sigma.values[i] = std::numeric_limits<float>::infinity();
      }
    write_photograph(folder_ / (name + ".exr"), photograph);
    side_.photographs.push_back(folder_ / (name + ".exr"));
  }
  ProbeSummary run() {
    request_.sides = {side_};
    return probe_light(request_);
  }
  std::string message() {
    try {
      run();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  static Image sky(float sun) {
    Image environment(128, 64, 3, 0.3f);
    for (int c = 0; c < 3; ++c) environment.at(10, 20, c) = sun;
    return environment;
  }

  const TemporaryFolder folder_;
  Rig rig_{128, {0.0, 0.0, 15.0}, 0.9, {}, chrome};
  ProbeSide side_;
  ProbeRequest request_;
};

TEST_F(ProbeFiles, KeepsCloudsAndDiscardsSunAndOverExposure) {
  add("cloudy_20040621_120000", sky(3.0f));
  add("sunny_20040621_120200", sky(3e5f));
  add("blinded_20040621_120400", sky(3e3f), 5.0f);
  const ProbeSummary summary = run();
  ASSERT_EQ(summary.photographs.size(), 3U);
  EXPECT_EQ(summary.photographs[0].verdict.discarded, "");
  EXPECT_THAT(summary.photographs[1].verdict.discarded, HasSubstr("sun only"));
  EXPECT_THAT(summary.photographs[2].verdict.discarded, HasSubstr("over-exposed"));
  EXPECT_EQ(summary.kept(), 1U);
  EXPECT_TRUE(fs::exists(request_.folder / "cloudy_20040621_120000.exr"));
  EXPECT_FALSE(fs::exists(request_.folder / "sunny_20040621_120200.exr"));
  EXPECT_THAT(read_text(request_.folder / "times.tsv"),
              HasSubstr("cloudy_20040621_120000\t2004-06-21T12:00:00.000"));
  EXPECT_NEAR(summary.photographs[0].verdict.mean_radiance[1], 0.3, 0.003);

  EXPECT_THAT(message(), HasSubstr("--force"));  // the maps are there already
  request_.replace = true;
  EXPECT_EQ(run().kept(), 1U);
}

TEST_F(ProbeFiles, FiltersAreMultipliedOut) {
  add("sky", sky(3.0f));
  request_.unwrap.gain = {1000.0, 1100.0, 1200.0};
  EXPECT_NEAR(run().photographs[0].verdict.mean_radiance[2], 360.0, 3.6);
}

TEST_F(ProbeFiles, SaysWhatIsWrongWithTheBall) {
  add("sky", sky(3.0f));
  side_.ball->centre.x() += 100.0;
  EXPECT_THAT(message(), HasSubstr("beyond the photograph"));
  side_.ball = ImageCircle{{64.0, 64.0}, 9.0};
  EXPECT_THAT(message(), HasSubstr("radius of 9 pixels, too few"));
  side_.ball.reset();
  write_exr(folder_ / "sky.exr", Image(128, 128, 3, 0.5f));
  EXPECT_THAT(message(),
              AllOf(HasSubstr("no ball was found with certainty"), HasSubstr("give its circle with --ball")));
  side_.distance_radii.reset();
  EXPECT_THAT(message(), HasSubstr("focal length or the distance"));
  EXPECT_FALSE(fs::exists(request_.folder));  // refused before anything is written
}

TEST_F(ProbeFiles, TheCommandMakesMapsOfTwoSides) {
  const Image environment = sky(3.0f);
  rig_.scene.backdrop = Eigen::Vector3f(0.9f, 0.9f, 0.9f);
  write_exr(folder_ / "east.exr", photograph_mirror_ball(environment, rig_.scene));
  rig_.scene.world_from_camera = rotation_of(EulerAngles{90.0, 0.0, 0.0});
  write_exr(folder_ / "north.exr", photograph_mirror_ball(environment, rig_.scene));
  const std::string log = folder_ / "log";
  ASSERT_EQ(test::run_program({"acquire",
                               "probe",
                               folder_ / "east.exr",
                               "--join",
                               folder_ / "north.exr",
                               "--camera-turn",
                               "0",
                               "--camera-turn",
                               "90",
                               "--distance",
                               "15",
                               "--diameter",
                               "2",
                               "--saturation",
                               "100",
                               "--light-size",
                               "32x16",
                               "--neutral-density",
                               "1",
                               "-o",
                               folder_ / "sky"},
                              log),
            0)
      << read_text(log);
  EXPECT_THAT(read_text(log), HasSubstr("1 light maps of 32×16"));
  EXPECT_THAT(read_text(log), HasSubstr("ball found at --ball"));
  Image expected = resampled(environment, 32);
  for (float& value : expected.values) value *= 10.0f;
  const Image found = read_image(folder_ / "sky" / "east.exr");
  constexpr double outline_of_a_pixel =
      0.03;  // the ball, 58 pixels in radius, is found here, and smooth enough
  EXPECT_LT(error_on_sphere(found, expected, rig_.looks(), 0.0, 0.0), outline_of_a_pixel);
}

/// Maps of your own: REFIELD_ENVIRONMENTS=folder prints a line for each, ball given and ball found.
TEST(LightProbe, EnvironmentsOfYourOwn) {
  const char* folder = std::getenv("REFIELD_ENVIRONMENTS");
  if (!folder) GTEST_SKIP() << "set REFIELD_ENVIRONMENTS to a folder of lat-long maps";
  for (const GlobMatch& match : expand_glob(folder)) {
    const Image environment = read_light_map(match.path, Parameterisation::lat_long).radiance;
    Rig rig(1200, {0.0, 0.0, 15.0}, 0.95, {30.0, 10.0, 0.0}, chrome);
    rig.scene.backdrop = Eigen::Vector3f(0.6f, 0.6f, 0.6f);
    const Photograph photograph{photograph_mirror_ball(environment, rig.scene), {}};
    UnwrapOptions options;
    options.width = 256;
    const Image truth = resampled(environment, options.width);
    const auto error = [&](const MirrorBall& ball) {
      return error_on_sphere(unwrap(photograph, ball, rig.turn, {}, options).radiance, truth, rig.looks(),
                             30.0, 7.0);
    };
    std::printf("%-28s given %.4f", match.path.filename().c_str(), error(rig.ball()));
    ProbeOptics optics;
    optics.focal_px = rig.scene.focal_px;
    optics.principal_px = {600.0, 600.0};
    try {
      const OutlineFit fit = find_ball(photograph.radiance, optics);
      std::printf("  found %.4f, centre off %.2f px, radius off %.2f px\n", error(fit.ball),
                  (fit.ball.centre_px() - rig.ball().centre_px()).norm(),
                  fit.ball.radius_px() - rig.ball().radius_px());
    } catch (const InputError&) {
      std::printf("  not found\n");
    }
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace refield
