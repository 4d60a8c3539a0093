// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/mirror_ball.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <complex>
#include <numbers>

#include "acquire/light_probe/unwrap.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/base/units.h"

namespace refield {
namespace {

using ::testing::HasSubstr;

constexpr double exact = 1e-9;

MirrorBall ball_at(double x, double y, double z, double focal_px = 1500.0) {
  const Eigen::Vector3d centre(x, y, z);
  return {{focal_px, {500.0, 400.0}}, centre.normalized(), centre.norm()};
}

/// The reflection by the law itself: intersect, mirror at the normal.
std::optional<Eigen::Vector3d> reflected(const Eigen::Vector3d& centre, const Eigen::Vector3d& ray) {
  const double b = ray.dot(centre);
  const double root = b * b - centre.squaredNorm() + 1.0;
  if (root < 0.0) return std::nullopt;
  const Eigen::Vector3d normal = (b - std::sqrt(root)) * ray - centre;
  return ray - 2.0 * ray.dot(normal) * normal;
}

TEST(MirrorBall, ReflectsByTheLawOfReflection) {
  const Eigen::Vector3d centre(0.7, -0.4, 6.0);
  const MirrorBall ball = ball_at(0.7, -0.4, 6.0);
  Rng random(3);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector2d point(random.uniform(350.0, 1000.0), random.uniform(200.0, 800.0));
    const auto expected = reflected(centre, ball.camera().ray(point));
    const auto found = ball.reflect(point);
    ASSERT_EQ(found.has_value(), expected.has_value()) << point.transpose();
    if (!found) continue;
    ++hits;
    EXPECT_NEAR((found->direction - *expected).norm(), 0.0, exact);
  }
  EXPECT_GT(hits, 500);
}

TEST(MirrorBall, FindsTheImageOfEveryDirectionThatItShows) {
  for (const auto& [x, y, z] :
       {std::tuple{0.0, 0.0, 8.0}, {0.9, -0.5, 3.0}, {0.0, 0.1, 2000.0}, {0.2, 0.0, 1.3}}) {
    const double focal = 300.0 * z;
    const MirrorBall ball = ball_at(x, y, z, focal);
    Rng random(5);
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3d direction =
          Eigen::Vector3d(random.normal(), random.normal(), random.normal()).normalized();
      const double behind = std::acos(std::clamp(direction.dot(ball.towards()), -1.0, 1.0));
      const auto found = ball.find(direction);
      ASSERT_EQ(found.has_value(), behind > ball.half_angle());
      if (!found || found->depth_px < 0.01) continue;
      const auto back = ball.reflect(found->point);
      ASSERT_TRUE(back);
      // Near the outline a tiny step in the image is a large one outside.
      EXPECT_NEAR((back->direction - direction).norm(), 0.0, 1e-6);
      EXPECT_NEAR(back->cos_incidence, found->cos_incidence, 1e-6);
    }
  }
}

TEST(MirrorBall, StatesItsResolution) {
  const MirrorBall ball = ball_at(0.3, 0.2, 5.0);
  const Eigen::Vector3d first = tangents(ball.towards()).first;
  for (double gamma : {10.0, 60.0, 120.0, 150.0}) {
    const auto direction = [&](double degrees) -> Eigen::Vector3d {
      const double angle = radians_from_degrees(degrees);
      return -std::cos(angle) * ball.towards() + std::sin(angle) * first;
    };
    constexpr double step = 1e-3;
    const auto angle_in_image = [&](double degrees) {
      const Eigen::Vector3d ray = ball.camera().ray(ball.find(direction(degrees))->point);
      return std::atan2(ray.cross(ball.towards()).norm(), ray.dot(ball.towards()));
    };
    const double measured = (angle_in_image(gamma + step) - angle_in_image(gamma - step)) *
                            ball.camera().focal_px / radians_from_degrees(2.0 * step);
    EXPECT_NEAR(ball.find(direction(gamma))->pixels_per_radian, measured, 1e-4 * measured);
  }
}

TEST(MirrorBall, IsRefusedWhereThereIsNone) {
  const ProbeCamera camera{1000.0, {500.0, 400.0}};
  EXPECT_THROW(MirrorBall(camera, Eigen::Vector3d::UnitZ(), 0.9), InputError);   // camera within the ball
  EXPECT_THROW(MirrorBall(camera, -Eigen::Vector3d::UnitZ(), 5.0), InputError);  // ball behind the camera
}

TEST(OutlineFit, FindsTheBallBehindAnEllipse) {
  const MirrorBall truth = ball_at(1.2, -0.8, 4.0);
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 400; ++i) points.push_back(truth.outline_point(2.0 * std::numbers::pi * i / 400));
  const ImageCircle start{truth.centre_px() + Eigen::Vector2d(3.0, -2.0), truth.radius_px() + 4.0};
  for (bool focal_known : {true, false}) {
    ProbeOptics optics;
    optics.principal_px = truth.camera().principal_px;
    if (focal_known)
      optics.focal_px = truth.camera().focal_px;
    else
      optics.distance_radii = truth.distance_radii();
    const OutlineFit fit = fit_outline(points, optics, start);
    EXPECT_NEAR((fit.ball.towards() - truth.towards()).norm(), 0.0, 1e-6);
    EXPECT_NEAR(fit.ball.distance_radii(), truth.distance_radii(), 1e-5);
    EXPECT_NEAR(fit.ball.camera().focal_px, truth.camera().focal_px, 1e-2);
    EXPECT_DOUBLE_EQ(fit.support, 1.0);
  }
}

TEST(OutlineFit, IsNotLedAstrayByAThirdOfWrongPoints) {
  const MirrorBall truth = ball_at(0.2, 0.1, 5.0);
  std::vector<Eigen::Vector2d> points;
  Rng random(8);
  for (int i = 0; i < 600; ++i) {
    Eigen::Vector2d p = truth.outline_point(2.0 * std::numbers::pi * i / 600);
    if (i % 3 == 0) p += (truth.centre_px() - p) * random.uniform(0.02, 0.1);  // edges within the ball
    points.push_back(p + 0.2 * Eigen::Vector2d(random.normal(), random.normal()));
  }
  ProbeOptics optics;
  optics.principal_px = truth.camera().principal_px;
  optics.focal_px = truth.camera().focal_px;
  const OutlineFit fit = fit_outline(points, optics, {truth.centre_px(), truth.radius_px() + 2.0});
  constexpr double five_sigma = 5.0 * 0.2 * 0.1;  // 400 good points, 1/sqrt(400/4)
  EXPECT_NEAR((fit.ball.centre_px() - truth.centre_px()).norm(), 0.0, five_sigma);
  EXPECT_NEAR(fit.ball.radius_px(), truth.radius_px(), five_sigma);
  EXPECT_NEAR(fit.support, 2.0 / 3.0, 0.05);
}

TEST(OutlineFit, WantsToKnowTheDistance) {
  try {
    ball_from_circle({{500.0, 400.0}, 100.0}, ProbeOptics{});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("focal length or the distance"));
  }
}

TEST(MirrorReflectance, FollowsFresnelsEquations) {
  const std::array<double, 3> n = {3.09, 0.05, 1.2}, k = {3.34, 4.483, 0.4};
  const auto mirror = MirrorReflectance::conductor(n, k);
  for (int i = 1; i <= 64; ++i) {
    const double cosine = i / 64.0;
    for (int c = 0; c < 3; ++c) {
      const std::complex<double> index(n[c], k[c]);
      const auto inside = std::sqrt(1.0 - (1.0 - cosine * cosine) / (index * index));
      const double across = std::norm((cosine - index * inside) / (cosine + index * inside));
      const double along = std::norm((index * cosine - inside) / (index * cosine + inside));
      constexpr double interpolation = 2e-4;
      EXPECT_NEAR(mirror.at(cosine)[c], 0.5 * (across + along), interpolation) << cosine;
    }
  }
  EXPECT_NEAR(mirror.at(0.0)[0], 1.0, 1e-6);
}

TEST(MirrorReflectance, KnowsChromeAndSilver) {
  // At normal incidence ((n − 1)² + k²) / ((n + 1)² + k²).
  for (float channel : MirrorReflectance::from_text("chrome").at(1.0)) EXPECT_NEAR(channel, 0.554, 0.01);
  for (float channel : MirrorReflectance::from_text("silver").at(1.0)) EXPECT_NEAR(channel, 0.984, 0.01);
  EXPECT_NEAR(MirrorReflectance::from_text("0.5,0.6,0.7").at(1.0)[1], 0.6, 1e-6);
  EXPECT_NEAR(MirrorReflectance::from_text("perfect").at(0.3)[2], 1.0, 1e-6);
  for (const char* text : {"gold", "0", "1.5", "0.5,0.6", "0.5,", "nan", ""})
    EXPECT_THROW(MirrorReflectance::from_text(text), InputError) << text;
}

}  // namespace
}  // namespace refield
