// SPDX-License-Identifier: Apache-2.0
#include "core/harmonics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/cube_map.h"

namespace refield {
namespace {

TEST(CubeMap, SolidAnglesAddUpToTheSphereAndCentresAreWhereLightMapsSay) {
  constexpr int resolution = 33;
  double sphere = 0.0;
  for (int y = 0; y < cube_faces * resolution; ++y)
    for (int x = 0; x < resolution; ++x) sphere += cube_solid_angle(x, y, resolution);
  EXPECT_NEAR(sphere, 4.0 * std::numbers::pi, 1e-12);
  for (int face = 0; face < cube_faces; ++face) {
    const Eigen::Vector3d ahead = cube_face_axes(face).row(2);
    EXPECT_LT((cube_direction(16.5, face * resolution + 16.5, resolution) - ahead).norm(), 1e-12);
  }
}

TEST(Harmonics, AreOrthonormal) {
  constexpr int order = 8, resolution = 64;
  constexpr int count = harmonics_of(order);
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(count, count);
  Eigen::VectorXd y(count);
  for (int row = 0; row < cube_faces * resolution; ++row)
    for (int column = 0; column < resolution; ++column) {
      evaluate_harmonics(order, cube_direction(column + 0.5, row + 0.5, resolution), {y.data(), count});
      gram += cube_solid_angle(column, row, resolution) * y * y.transpose();
    }
  // Midpoints of texels integrate products of degree 14 to about (degree / resolution)².
  EXPECT_LT((gram - Eigen::MatrixXd::Identity(count, count)).cwiseAbs().maxCoeff(), 4e-3);
}

TEST(Harmonics, AreTheFunctionsOfThePapersTable) {
  const Eigen::Vector3d d = Eigen::Vector3d(0.3, -0.5, 0.7).normalized();
  const double x = d.x(), y = d.y(), z = d.z(), pi = std::numbers::pi;
  double values[25];
  evaluate_harmonics(5, d, values);
  EXPECT_NEAR(values[0], std::sqrt(1 / (4 * pi)), 1e-14);
  EXPECT_NEAR(values[1], std::sqrt(3 / (4 * pi)) * y, 1e-14);
  EXPECT_NEAR(values[2], std::sqrt(3 / (4 * pi)) * z, 1e-14);
  EXPECT_NEAR(values[3], std::sqrt(3 / (4 * pi)) * x, 1e-14);
  EXPECT_NEAR(values[5], std::sqrt(15 / (4 * pi)) * y * z, 1e-14);
  EXPECT_NEAR(values[6], std::sqrt(5 / (16 * pi)) * (3 * z * z - 1), 1e-14);
  EXPECT_NEAR(values[9], std::sqrt(35 / (32 * pi)) * (3 * x * x * y - y * y * y), 1e-14);
  EXPECT_NEAR(values[23], std::sqrt(315 / (32 * pi)) * z * (x * x * x - 3 * x * y * y), 1e-14);
  EXPECT_NEAR(values[20], std::sqrt(9 / (256 * pi)) * (35 * z * z * z * z - 30 * z * z + 3), 1e-14);
}

}  // namespace
}  // namespace refield
