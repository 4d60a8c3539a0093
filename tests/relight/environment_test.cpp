// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/environment.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/light/cube_map.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double whole_sphere = 4.0 * pi;
// Strips stand for parallels of latitude to 3e-7 of a texel; radiance is kept in float.
constexpr double strip_error = 1e-6;
const MonitorPlacement slanted{520, 320, 400, {35, -20, 10}, 60, -30};
const std::vector<MonitorPlacement> one_monitor{slanted};

LightMap constant(const LightDomain& domain, float radiance) {
  return {Image(domain.width, domain.height, 3, radiance), domain.parameterisation};
}

LightDomain lat_long(int width) {
  return {width, width / 2, Parameterisation::lat_long};
}
LightDomain cube(int width) {
  return {width, 6 * width, Parameterisation::cube};
}
LightDomain window(int width, int height) {
  return {width, height, Parameterisation::monitor};
}

/// By the formulas of the conventions, without the grid that is tested.
Eigen::Vector3f value_at(const LightMap& map, const Eigen::Vector3d& direction) {
  const Image& image = map.radiance;
  int x = 0, y = 0;
  if (map.parameterisation == Parameterisation::lat_long) {
    const Eigen::Vector2d at = lat_long_position(direction.normalized(), image.width, image.height);
    x = std::min(static_cast<int>(at.x()), image.width - 1);
    y = std::min(static_cast<int>(at.y()), image.height - 1);
  } else {
    Eigen::Index axis = 0;
    direction.cwiseAbs().maxCoeff(&axis);
    const int face = 2 * static_cast<int>(axis) + (direction[axis] < 0.0 ? 1 : 0);
    const Eigen::Vector3d d = cube_face_axes(face) * direction;
    const auto texel = [&](double position) {
      return std::clamp(static_cast<int>((position + 1.0) / 2.0 * image.width), 0, image.width - 1);
    };
    x = texel(d.x() / d.z());
    y = face * image.width + texel(-d.y() / d.z());
  }
  return {image.at(x, y, 0), image.at(x, y, 1), image.at(x, y, 2)};
}

/// Of a texel of a lat-long map; of a window's, see window_angle().
double lat_long_angle(const LightDomain& domain, int y) {
  return 2.0 * pi / domain.width *
         (std::cos(pi * y / domain.height) - std::cos(pi * (y + 1) / domain.height));
}

double triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return std::abs(2.0 * std::atan2(a.dot(b.cross(c)), 1.0 + a.dot(b) + b.dot(c) + c.dot(a)));
}

double window_angle(const MonitorPlacement& monitor, const LightDomain& domain, int x, int y) {
  const auto corner = [&](int i, int j) {
    return screen_direction(monitor, static_cast<double>(x + i) / domain.width,
                            static_cast<double>(y + j) / domain.height)
        .normalized();
  };
  return triangle(corner(0, 0), corner(1, 0), corner(1, 1)) +
         triangle(corner(0, 0), corner(1, 1), corner(0, 1));
}

double angle_of(const MonitorPlacement& monitor) {
  return window_angle(monitor, window(1, 1), 0, 0);
}

/// Energy of a window's light, green alone.
double window_energy(const LightMap& light, const MonitorPlacement& monitor) {
  double sum = 0.0;
  for (int y = 0; y < light.radiance.height; ++y)
    for (int x = 0; x < light.radiance.width; ++x)
      sum += window_angle(monitor, light.domain(), x, y) * light.radiance.at(x, y, 1);
  return sum;
}

TEST(SphereGrid, TexelsFillTheSphere) {
  for (const LightDomain& domain : {lat_long(64), lat_long(10), cube(16)}) {
    double sum = 0.0;
    const SphereGrid grid(domain);
    for (const SpherePatch& patch : grid.patches())
      for (int y = 0; y < patch.rows(); ++y)
        for (int x = 0; x < patch.columns(); ++x) sum += solid_angle(patch.texel(x, y));
    EXPECT_NEAR(sum, whole_sphere, 1e-9) << name_of(domain.parameterisation);
  }
}

TEST(SphereGrid, OverlapsOfAPolygonAddUpToIt) {
  Rng rng(3);
  for (const LightDomain& domain : {lat_long(512), lat_long(6), cube(40)}) {
    const SphereGrid grid(domain);
    OverlapFinder finder(grid);
    for (int i = 0; i < 300; ++i) {
      const EulerAngles turn{rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)};
      const double size = std::exp(rng.uniform(-9.0, 0.0));
      SphericalPolygon quad;
      for (const auto& [x, y] : {std::pair{-1, 1}, {1, 1}, {1, -1}, {-1, -1}})
        quad.push_back(rotation_of(turn) * Eigen::Vector3d(size * x, size * y, 1.0));
      double sum = 0.0;
      for (const TexelOverlap& overlap : finder.find(quad)) sum += overlap.solid_angle;
      EXPECT_NEAR(sum, solid_angle(quad), 1e-12 + 1e-9 * solid_angle(quad));
    }
  }
}

// Overlaps of quads that look straight up or down, have a corner at a pole or an edge through it.
TEST(SphereGrid, ThePolesAreNoExceptions) {
  const SphereGrid grid(lat_long(512));
  OverlapFinder finder(grid);
  for (const double pitch : {-90.0, 90.0})
    for (const double yaw : {0.0, 45.0, 33.0})
      for (const auto& [left, right, bottom, top] : {std::array{-0.1, 0.1, -0.1, 0.1},
                                                     {0.0, 0.1, 0.0, 0.1},
                                                     {-0.1, 0.1, 0.0, 0.1},
                                                     {-0.1, 0.0, -0.1, 0.1}}) {
        const Eigen::Matrix3d turn = rotation_of(EulerAngles{yaw, pitch, 0});
        SphericalPolygon quad;
        for (const auto& [x, y] : {std::pair{left, top}, {right, top}, {right, bottom}, {left, bottom}})
          quad.push_back(turn * Eigen::Vector3d(x, y, 1.0));
        double sum = 0.0;
        for (const TexelOverlap& overlap : finder.find(quad)) sum += overlap.solid_angle;
        EXPECT_NEAR(sum, solid_angle(quad), 1e-9) << pitch << " " << yaw << " " << left << " " << bottom;
      }
}

TEST(Environment, AConstantMapStaysConstant) {
  for (const LightDomain& source : {lat_long(40), cube(13)})
    for (const LightDomain& target : {window(17, 9), lat_long(24), cube(8)}) {
      const EnvironmentLight result =
          EnvironmentProjector(target, one_monitor).project(constant(source, 2.5f), {10, 20, 30});
      for (const float value : result.light.radiance.values) ASSERT_FLOAT_EQ(value, 2.5f);
      const bool is_window = target.parameterisation == Parameterisation::monitor;
      EXPECT_NEAR(result.share.sphere, is_window ? angle_of(slanted) / whole_sphere : 1.0, 1e-9);
      EXPECT_NEAR(result.share.energy, result.share.sphere, 1e-6);
    }
}

// The heart of it: a one-texel sun of 1e5 keeps its energy at any resolution of the window, and so does what
// surrounds it.
TEST(Environment, ASunOfOneTexelKeepsItsEnergy) {
  constexpr float radiance = 1e5f;
  LightMap sun = constant(lat_long(4096), 0.0f);
  const Eigen::Vector2d at = lat_long_position(screen_direction(slanted, 0.4, 0.7).normalized(), 4096, 2048);
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  for (int c = 0; c < 3; ++c) sun.radiance.at(x, y, c) = radiance;
  const double energy = radiance * lat_long_angle(sun.domain(), y);
  for (const LightDomain& target : {window(1, 1), window(7, 5), window(128, 80)}) {
    const EnvironmentLight result = EnvironmentProjector(target, one_monitor).project(sun, {});
    EXPECT_NEAR(window_energy(result.light, slanted) / energy, 1.0, strip_error) << target.width;
    EXPECT_NEAR(result.share.energy, 1.0, strip_error);
  }
  sun = constant(lat_long(512), 0.0f);
  sun.radiance.at(350, 3, 0) = radiance;
  for (const LightDomain& target : {lat_long(32), lat_long(90)}) {
    const double near_pole = radiance * lat_long_angle(sun.domain(), 3);
    const LightMap light = EnvironmentProjector(target, {}).project(sun, {12, 34, 56}).light;
    double sum = 0.0;
    for (int row = 0; row < target.height; ++row)
      for (int column = 0; column < target.width; ++column)
        sum += lat_long_angle(target, row) * light.radiance.at(column, row, 0);
    EXPECT_NEAR(sum / near_pole, 1.0, strip_error) << target.width;
  }
}

TEST(Environment, LightOutsideOfTheWindowIsLeftOutAndTold) {
  LightMap sun = constant(lat_long(256), 0.0f);
  for (int c = 0; c < 3; ++c) sun.radiance.at(0, 64, c) = 1e5f;  // behind the camera
  const EnvironmentLight result = EnvironmentProjector(window(16, 10), one_monitor).project(sun, {});
  for (const float value : result.light.radiance.values) EXPECT_EQ(value, 0.0f);
  EXPECT_EQ(result.share.energy, 0.0);
}

// Texel by texel against dense sampling of the map, by formulas of their own.
TEST(Environment, TexelsAreMeansOverTheirSolidAngles) {
  Rng rng(5);
  const EulerAngles turn{70, -15, 25};
  const Eigen::Matrix3d environment_from_scene = rotation_of(turn).transpose();
  const LightDomain target = window(6, 4);
  for (const LightDomain& source : {lat_long(32), cube(9)}) {
    const LightMap map = test::random_light(rng, source);
    const LightMap light = EnvironmentProjector(target, one_monitor).project(map, turn).light;
    for (int y = 0; y < target.height; ++y)
      for (int x = 0; x < target.width; ++x) {
        constexpr int samples = 200;
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        double weight = 0.0;
        for (int j = 0; j < samples; ++j)
          for (int i = 0; i < samples; ++i) {
            const Eigen::Vector3d d = screen_direction(slanted, (x + (i + 0.5) / samples) / target.width,
                                                       (y + (j + 0.5) / samples) / target.height);
            const double angle = std::pow(d.norm(), -3);  // of equal areas on the screen, but for a factor
            sum += angle * value_at(map, environment_from_scene * d).cast<double>();
            weight += angle;
          }
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(light.radiance.at(x, y, c), sum[c] / weight, 2e-3);
      }
  }
}

TEST(Environment, TurningThereAndBackBetweenLatLongAndCube) {
  // Smooth maps survive resampling: to a cube, back to lat-long, and a turn undone.
  LightMap map = constant(lat_long(128), 0.0f);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 128; ++x) {
      const Eigen::Vector3d d = lat_long_direction(x + 0.5, y + 0.5, 128, 64);
      for (int c = 0; c < 3; ++c) map.radiance.at(x, y, c) = static_cast<float>(1.0 + 0.5 * d[c]);
    }
  const LightMap on_cube = EnvironmentProjector(cube(64), {}).project(map, {30, 0, 0}).light;
  const LightMap back = EnvironmentProjector(lat_long(128), {}).project(on_cube, {-30, 0, 0}).light;
  for (std::size_t i = 0; i < map.radiance.values.size(); ++i)
    ASSERT_NEAR(back.radiance.values[i], map.radiance.values[i], 0.02) << i;
}

TEST(Environment, AFullTurnIsNoTurn) {
  Rng rng(8);
  const LightMap map = test::random_light(rng, lat_long(64));
  EXPECT_EQ(EnvironmentProjector(lat_long(64), {}).project(map, {360, 0, -360}).light.radiance.values,
            map.radiance.values);
  const EnvironmentProjector onto_window(window(20, 10), one_monitor);
  const LightMap once = onto_window.project(map, {}).light;
  for (const EulerAngles& turn :
       {EulerAngles{360, 0, 0}, EulerAngles{0, 360, 0}, EulerAngles{0, 0, 360}, EulerAngles{180, 180, 180}}) {
    const LightMap again = onto_window.project(map, turn).light;
    for (std::size_t i = 0; i < once.radiance.values.size(); ++i)
      ASSERT_NEAR(again.radiance.values[i], once.radiance.values[i], 1e-6);
  }
}

// What the map shows ahead goes to the right by yaw: a monitor to the right then shows what one ahead showed.
TEST(Environment, TurningTheMapIsTurningTheMonitorTheOtherWay) {
  Rng rng(9);
  const LightMap map = test::random_light(rng, lat_long(64));
  const LightDomain target = window(12, 8);
  const auto at = [&](const EulerAngles& monitor, const EulerAngles& turn) {
    return EnvironmentProjector(target, std::vector{MonitorPlacement{500, 300, 400, monitor}})
        .project(map, turn)
        .light;
  };
  const LightMap straight = at({}, {});
  for (const EulerAngles& turn :
       {EulerAngles{40, 0, 0}, EulerAngles{0, 50, 0}, EulerAngles{0, 0, 60}, EulerAngles{40, 50, 60}}) {
    const LightMap together = at(turn, turn);
    for (std::size_t i = 0; i < straight.radiance.values.size(); ++i)
      ASSERT_NEAR(together.radiance.values[i], straight.radiance.values[i], 1e-6);
  }
}

TEST(Environment, WindowsThatOverlapCountLightOnce) {
  Rng rng(10);
  const LightMap map = test::random_light(rng, lat_long(64));
  // The second covers the right half of the first and as much beyond it, the third lies far away.
  const MonitorPlacement first{400, 300, 400}, second{400, 300, 400, {}, 200}, third{400, 300, 400, {170}};
  const LightDomain target = window(16, 36);
  const EnvironmentLight three =
      EnvironmentProjector(target, std::vector{first, second, third}).project(map, {});
  const MonitorPlacement both{600, 300, 400, {}, 100};
  EXPECT_NEAR(three.share.sphere, (angle_of(both) + angle_of(third)) / whole_sphere, 1e-9);

  const auto alone = [&](const MonitorPlacement& monitor) {
    return EnvironmentProjector(window(16, 12), std::vector{monitor}).project(map, {}).light;
  };
  const LightMap first_alone = alone(first), third_alone = alone(third);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 16; ++x) {
      const double own = x < 8 ? 1.0 : 0.5;  // half of what both see goes to each
      EXPECT_NEAR(three.light.radiance.at(x, y, 0), own * first_alone.radiance.at(x, y, 0), 1e-5);
      EXPECT_NEAR(three.light.radiance.at(x, y + 24, 0), third_alone.radiance.at(x, y, 0), 1e-5);
    }
  const auto energy = [&](const MonitorPlacement& monitor, int number) {
    LightMap light = constant(window(16, 12), 0.0f);
    for (int y = 0; y < 12; ++y)
      std::ranges::copy(three.light.radiance.row(y + 12 * number), light.radiance.row(y).begin());
    return window_energy(light, monitor);
  };
  EXPECT_NEAR(energy(first, 0) + energy(second, 1), window_energy(alone(both), both), 1e-6);
}

/// The largest difference of two lights, relative to the mean of the first.
double largest_difference(const LightMap& a, const LightMap& b) {
  double difference = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < a.radiance.values.size(); ++i) {
    difference = std::max(difference, std::abs(double{a.radiance.values[i]} - b.radiance.values[i]));
    sum += std::abs(a.radiance.values[i]);
  }
  return difference / (sum / static_cast<double>(a.radiance.values.size()));
}

EulerAngles random_turn(Rng& rng) {
  return {rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)};
}

// The two ways cut parallels of latitude into great circles of different lengths: 1e-6 of a lat-long texel.
constexpr double ways_differ = 2e-5;

/// Sources coarser than, as fine as and finer than the target.
void expect_sums_to_agree_with_clipping(const LightDomain& target,
                                        const std::vector<MonitorPlacement>& monitors,
                                        const std::vector<EulerAngles>& turns) {
  Rng rng(20);
  const EnvironmentProjector projector(target, monitors);
  for (const LightDomain& source :
       {lat_long(16), lat_long(200), LightDomain{30, 15, Parameterisation::lat_long}}) {
    const LightMap map = test::random_light(rng, source);
    const PreparedEnvironment prepared(map);
    ASSERT_TRUE(prepared.has_path_sums());
    for (const EulerAngles& turn : turns) {
      const EnvironmentLight fast = projector.project(prepared, turn),
                             exact = projector.project_exactly(prepared, turn);
      ASSERT_LT(largest_difference(exact.light, fast.light), ways_differ)
          << source.width << " turned by " << turn.yaw << " " << turn.pitch << " " << turn.roll;
      EXPECT_NEAR(fast.share.sphere, exact.share.sphere, 1e-6);
      EXPECT_NEAR(fast.share.energy, exact.share.energy, 1e-5);
    }
  }
}

/// Poles on corners, on edges and inside of texels, and anywhere.
std::vector<EulerAngles> turns_of_poles() {
  Rng rng(25);
  return {{}, {90, 0, 0}, {33, 0, 0}, {0, 90, 0}, {45, -90, 0}, random_turn(rng), random_turn(rng)};
}

TEST(Environment, SumsAlongEdgesOfAWindowAgreeWithClipping) {
  expect_sums_to_agree_with_clipping(window(24, 15), one_monitor, turns_of_poles());
  expect_sums_to_agree_with_clipping(window(1, 1), one_monitor, turns_of_poles());
}

TEST(Environment, SumsAlongEdgesOfSeveralWindowsAgreeWithClipping) {
  // The first two overlap, the others look up and down.
  expect_sums_to_agree_with_clipping(window(6, 24),
                                     {slanted,
                                      {400, 300, 400, {20, 0, 0}},
                                      {400, 300, 400, {0, 80, 0}},
                                      {400, 300, 300, {0, -90, 0}, 30, 20}},
                                     {{}, {40, 20, 10}});
}

TEST(Environment, SumsAlongEdgesOfACubeAgreeWithClipping) {
  expect_sums_to_agree_with_clipping(cube(4), {}, {{}, {45, 0, 0}, {45, -90, 0}});
  expect_sums_to_agree_with_clipping(cube(3), {}, {{}, {12, 34, 56}});
}

// Against dense sampling: clipping a whole sphere of narrow strips takes seconds.
TEST(Environment, TexelsOfALatLongMapAreMeansOverTheirSolidAngles) {
  Rng rng(26);
  const LightDomain target = lat_long(6);
  const LightMap map = test::random_light(rng, lat_long(20));
  for (const EulerAngles& turn : {EulerAngles{0, 90, 0}, random_turn(rng)}) {
    const Eigen::Matrix3d environment_from_scene = rotation_of(turn).transpose();
    const LightMap light = EnvironmentProjector(target, {}).project(map, turn).light;
    for (int y = 0; y < target.height; ++y)
      for (int x = 0; x < target.width; ++x) {
        constexpr int samples = 200;
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        const double north = std::cos(pi * y / target.height), south = std::cos(pi * (y + 1) / target.height);
        for (int j = 0; j < samples; ++j)
          for (int i = 0; i < samples; ++i) {
            const double sine = north + (j + 0.5) / samples * (south - north);
            const Eigen::Vector3d d = lat_long_direction(
                x + (i + 0.5) / samples, std::acos(sine) / pi * target.height, target.width, target.height);
            sum += value_at(map, environment_from_scene * d).cast<double>();
          }
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(light.radiance.at(x, y, c), sum[c] / (samples * samples), 2e-3);
      }
  }
}

TEST(Environment, SumsAlongEdgesKeepASunOfOneTexel) {
  Rng rng(21);
  for (const int width : {32, 400}) {
    LightMap map = constant(lat_long(width), 1.0f);
    for (int c = 0; c < 3; ++c) map.radiance.at(width / 3, width / 7, c) = 1e5f;
    const PreparedEnvironment prepared(map);
    for (const LightDomain& target : {window(32, 20), cube(4)}) {
      const EnvironmentProjector projector(target, one_monitor);
      const EulerAngles turn = random_turn(rng);
      const LightMap fast = projector.project(prepared, turn).light,
                     exact = projector.project_exactly(prepared, turn).light;
      // Texels beside the sun as well: differences of large sums must not show.
      for (std::size_t i = 0; i < fast.radiance.values.size(); ++i)
        ASSERT_NEAR(fast.radiance.values[i], exact.radiance.values[i], 1e-4 * exact.radiance.values[i])
            << width << " " << i;
    }
  }
}

TEST(Environment, LargeMapsWithoutAllPrefixSumsAgreeToo) {
  Rng rng(22);
  const LightMap map = test::random_light(rng, lat_long(2400));  // above 2^21 texels
  const PreparedEnvironment prepared(map);
  for (const LightDomain& target : {window(3, 2), window(1, 1)}) {
    const EnvironmentProjector projector(target, one_monitor);
    const EulerAngles turn{20, 70, 10};
    EXPECT_LT(largest_difference(projector.project_exactly(prepared, turn).light,
                                 projector.project(prepared, turn).light),
              ways_differ);
  }
}

TEST(Environment, BoxesOfACubeHoldTheEnergyOfTheirTexels) {
  Rng rng(23);
  constexpr int side = 8;
  const LightMap map = test::random_light(rng, lat_long(100));
  const PreparedEnvironment prepared(map);
  std::vector<SmallBox> boxes{{0, 0, side, 6 * side}, {0, 2 * side, side, 3 * side}, {3, 3, 5, 5}};
  for (int i = 0; i < 300; ++i) {
    const auto pick = [&](int limit) {
      const auto a = static_cast<std::int16_t>(rng.below(static_cast<std::uint64_t>(limit)));
      const auto most = static_cast<std::uint64_t>(limit - a);
      return std::pair(a, static_cast<std::int16_t>(a + 1 + static_cast<int>(rng.below(most))));
    };
    const auto [x0, x1] = pick(side);
    const auto [y0, y1] = pick(6 * side);
    boxes.push_back({x0, y0, x1, y1});
  }
  const BoxProjector projector(side, {}, boxes);
  for (const EulerAngles& turn : {EulerAngles{}, EulerAngles{0, 90, 0}, random_turn(rng)}) {
    const std::vector<float> sums = projector.project(prepared, turn);
    const LightMap light = EnvironmentProjector(cube(side), {}).project_exactly(prepared, turn).light;
    for (std::size_t k = 0; k < boxes.size(); ++k)
      for (int c = 0; c < 3; ++c) {
        double sum = 0.0;
        for (int y = boxes[k].y0; y < boxes[k].y1; ++y)
          for (int x = boxes[k].x0; x < boxes[k].x1; ++x)
            sum += cube_solid_angle(x, y, side) * light.radiance.at(x, y, c);
        ASSERT_NEAR(sums[3 * k + static_cast<std::size_t>(c)], sum, 1e-5 * sum) << k;
      }
  }
}

/// A box on a face of 8×8 texels, and its light vector by the light of a fine cube map.
Eigen::Matrix3d light_vector(const LightMap& fine, const Box& box) {
  const int scale = fine.radiance.width / 8;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (int y = scale * box.y0; y < scale * box.y1; ++y)
    for (int x = scale * box.x0; x < scale * box.x1; ++x) {
      const Eigen::Vector3d direction = cube_face_axes(y / fine.radiance.width).transpose() *
                                        cube_mean_direction(x, y, fine.radiance.width);
      for (int c = 0; c < 3; ++c)
        sum.col(c) += cube_solid_angle(x, y, fine.radiance.width) * fine.radiance.at(x, y, c) * direction;
    }
  return sum;
}

// The coarse map has wide texels, the fine one no prefix sums of all rows; boxes lie over poles and edges.
TEST(Environment, VectorBoxesHoldTheLightVectorOfTheirTexels) {
  constexpr int side = 8, fine_side = 256;
  constexpr double texels = 2e-3;  // the fine map has no directions inside its texels
  Rng rng(29);
  std::vector<VectorBox> boxes;
  for (int i = 0; i < 60; ++i) {
    const Box box = test::random_box(rng, side, side);
    const int top = side * (i % 6);
    for (int axis = 0; axis < 3; ++axis)
      boxes.push_back({{box.x0, box.y0 + top, box.x1, box.y1 + top}, Eigen::Vector3f::Unit(axis)});
  }
  const BoxProjector projector(side, boxes, {});
  for (const int width : {16, 100, 2400}) {
    LightMap map = test::random_light(rng, lat_long(width));
    const PreparedEnvironment prepared(map);
    for (const EulerAngles& turn : {EulerAngles{}, EulerAngles{0, 90, 0}, random_turn(rng)}) {
      const std::vector<float> sums = projector.project(prepared, turn);
      const LightMap fine = EnvironmentProjector(cube(fine_side), {}).project(prepared, turn).light;
      for (std::size_t k = 0; k < boxes.size(); k += 3) {
        const Eigen::Matrix3d expected = light_vector(fine, boxes[k].box);
        for (int axis = 0; axis < 3; ++axis)
          for (int c = 0; c < 3; ++c)
            ASSERT_NEAR(sums[3 * (k + static_cast<std::size_t>(axis)) + static_cast<std::size_t>(c)],
                        expected(axis, c), texels * expected.col(c).norm())
                << width << " " << k;
      }
    }
  }
}

// Without texels in between: of a light of one everywhere the vectors are known, and a sun of one texel must
// leave no trace in the boxes beside it.
TEST(Environment, VectorBoxesOfWhiteLightAreExactBesideASunToo) {
  constexpr int side = 8;
  Rng rng(30);
  const LightMap white_cube{Image(256, 6 * 256, 3, 1.0f), Parameterisation::cube};
  std::vector<VectorBox> boxes;
  for (int y = 0; y < 6 * side; ++y)
    for (int x = 0; x < side; ++x)
      for (int axis = 0; axis < 3; ++axis)
        boxes.push_back({{x, y, x + 1, y + 1}, Eigen::Vector3f::Unit(axis)});
  const BoxProjector projector(side, boxes, {});
  for (const EulerAngles& turn : {EulerAngles{}, EulerAngles{0, 90, 0}, random_turn(rng)}) {
    LightMap map{Image(400, 200, 3, 1.0f), Parameterisation::lat_long};
    constexpr float sun = 1e5f;
    map.radiance.at(123, 45, 0) = sun;
    const std::vector<float> sums = projector.project(PreparedEnvironment(map), turn);
    int sunny = 0;
    for (std::size_t k = 0; k < boxes.size(); k += 3) {
      const Eigen::Matrix3d expected = light_vector(white_cube, boxes[k].box);
      const Eigen::Vector3d red(sums[3 * k], sums[3 * k + 3], sums[3 * k + 6]),
          green(sums[3 * k + 1], sums[3 * k + 4], sums[3 * k + 7]);
      ASSERT_LT((green - expected.col(1)).norm(), 1e-6 * expected.col(1).norm()) << k;
      const bool has_sun = (red - expected.col(0)).norm() > 1e-4 * expected.col(0).norm();
      sunny += has_sun;
    }
    EXPECT_GE(sunny, 1);
    EXPECT_LE(sunny, 4);
  }
}

// Paths of all lengths, anywhere and beside poles, the equator and corners of texels.
TEST(Environment, PathsInABatchHaveTheSumsOfEachAlone) {
  constexpr double rounding = 1e-11;  // sums are up to 6
  Rng rng(27);
  for (const int width : {16, 200, 400, 2400}) {  // the last without prefix sums of all rows
    const PreparedEnvironment environment(test::random_light(rng, lat_long(width)));
    environment.prepare_vectors({});
    constexpr std::size_t count = 20000;
    struct Path {
      MapPoint a, b;
    };
    std::vector<Path> paths;
    std::vector<PathSums> sums(count);
    std::vector<VectorPathSums> vectors(count);
    PathBatch<PathSums> batch(environment);
    PathBatch<VectorPathSums> vector_batch(environment);
    for (std::size_t i = 0; i < count; ++i) {
      const auto place = [&](int limit) {
        const double anywhere = rng.uniform(0.0, limit);
        return rng.below(3) == 0 ? std::round(anywhere) : anywhere;
      };
      const double row = rng.below(8) == 0 ? rng.uniform(0.0, 1e-2) : place(width / 2);
      const Eigen::Vector3d from = lat_long_direction(place(width), row, width, width / 2);
      const double length = std::exp(rng.uniform(-14.0, -2.0));
      Eigen::Vector3d to = from;
      for (double& coordinate : to) coordinate += length * rng.uniform(-1, 1);
      Path path;
      path.a = environment.point(from, {});
      path.b = environment.point(to, path.a.texel);
      batch.add(path.a, path.b, sums[i]);
      vector_batch.add(path.a, path.b, vectors[i]);
      paths.push_back(path);
    }
    batch.flush();
    vector_batch.flush();
    for (std::size_t i = 0; i < count; ++i) {
      const PathSums alone = environment.along(paths[i].a, paths[i].b);
      ASSERT_NEAR(sums[i].azimuth, alone.azimuth, rounding) << width << " " << i;
      for (int c = 0; c < 3; ++c)
        ASSERT_NEAR(sums[i].light[c], alone.light[c], rounding)
            << width << " " << paths[i].a.direction.transpose();
      const VectorPathSums vectors_alone = environment.vectors_along(paths[i].a, paths[i].b);
      ASSERT_NEAR(vectors[i].azimuth, vectors_alone.azimuth, rounding) << width << " " << i;
      ASSERT_LT((vectors[i].light - vectors_alone.light).cwiseAbs().maxCoeff(), rounding)
          << width << " " << paths[i].a.direction.transpose() << ", " << paths[i].b.direction.transpose();
    }
  }
}

// Texels so small that nearly all of their edges are short.
TEST(Environment, FineWindowsAgreeWithClipping) {
  // The exact way's great circles lie up to 1.3e-7 beside parallels of latitude: 1.2e-4 of a texel's width.
  constexpr double of_contrast = 2e-4;
  constexpr float sun = 1e5f, max_sky = 1.0f;
  Rng rng(28);
  const LightDomain target = window(60, 40);
  for (const EulerAngles& turn : {EulerAngles{0, 90, 0}, random_turn(rng)}) {
    const std::vector monitor{MonitorPlacement{40, 30, 600, turn}};
    const EnvironmentProjector projector(target, monitor);
    LightMap map = test::random_light(rng, lat_long(400));
    const Eigen::Vector2d at =
        lat_long_position(screen_direction(monitor[0], 0.4, 0.7).normalized(), 400, 200);
    for (int c = 0; c < 3; ++c) map.radiance.at(static_cast<int>(at.x()), static_cast<int>(at.y()), c) = sun;
    const LightMap fast = projector.project(PreparedEnvironment(map), {}).light,
                   exact = projector.project_exactly(PreparedEnvironment(map), {}).light;
    for (std::size_t i = 0; i < fast.radiance.values.size(); ++i) {
      const float value = exact.radiance.values[i];
      ASSERT_NEAR(fast.radiance.values[i], value, of_contrast * (value > max_sky ? sun : max_sky)) << i;
    }
  }
}

TEST(Environment, ThreadsDoNotChangeTheLight) {
  Rng rng(24);
  const LightMap map = test::random_light(rng, lat_long(128));
  const EulerAngles turn = random_turn(rng);
  const auto lights = [&] {
    const PreparedEnvironment prepared(map);
    std::vector<float> values =
        EnvironmentProjector(window(100, 75), one_monitor).project(prepared, turn).light.radiance.values;
    const std::vector<SmallBox> boxes{{0, 0, 9, 9}, {9, 0, 64, 200}, {3, 70, 5, 71}};
    std::ranges::copy(BoxProjector(64, {}, boxes).project(prepared, turn), std::back_inserter(values));
    return values;
  };
  const std::vector<float> together = lights();
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(lights(), together);
}

TEST(Environment, FilesAreToldApartByTheirProportions) {
  const test::TemporaryFolder folder;
  write_exr(folder / "a.exr", Image(8, 4, 3, 1.0f));
  write_exr(folder / "b.exr", Image(2, 12, 3, 1.0f));
  write_exr(folder / "c.exr", Image(8, 5, 3, 1.0f));
  EXPECT_EQ(read_environment(folder / "a.exr").parameterisation, Parameterisation::lat_long);
  EXPECT_EQ(read_environment(folder / "b.exr").parameterisation, Parameterisation::cube);
  EXPECT_THROW(read_environment(folder / "c.exr"), InputError);
}

TEST(Environment, AWindowNeedsToKnowWhereItIs) {
  EXPECT_THROW(EnvironmentProjector(window(8, 6), {}), InputError);
  EXPECT_THROW(EnvironmentProjector(window(8, 6), one_monitor).project(constant(window(8, 6), 1.0f), {}),
               InputError);
}

}  // namespace
}  // namespace refield
