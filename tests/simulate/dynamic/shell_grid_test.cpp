// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/object_transport.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/rng.h"

namespace refield::dynamic {
namespace {

Eigen::Vector3f anywhere(Rng& rng, double least, double most) {
  const Eigen::Vector3d direction(rng.normal(), rng.normal(), rng.normal());
  return (direction.normalized() * std::exp(rng.uniform(std::log(least), std::log(most)))).cast<float>();
}

TEST(ShellGrid, IsItselfAtItsPoints) {
  const ShellGrid grid(5, 4, 0.5f, 4.0f);
  for (std::size_t p = 0; p < grid.points(); ++p) {
    const Eigen::Vector3f place = grid.position(p);
    const auto corners = grid.around(place);
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::size_t i = 0; i < corners.point.size(); ++i)
      sum += corners.weight[i] * grid.position(corners.point[i]);
    EXPECT_LT((sum - place).norm(), 1e-3f * place.norm()) << p;
  }
}

TEST(ShellGrid, InterpolatesWithWeightsThatAddUpToOne) {
  const ShellGrid grid(8, 12, 0.1f, 4.0f);
  Rng rng(1);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3f place = anywhere(rng, 0.1, 4.0);
    const auto corners = grid.around(place);
    float sum = 0.0f;
    Eigen::Vector3f mean = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < corners.point.size(); ++k) {
      ASSERT_LT(corners.point[k], grid.points());
      EXPECT_GE(corners.weight[k], -1e-5f);
      sum += corners.weight[k];
      mean += corners.weight[k] * grid.position(corners.point[k]);
    }
    EXPECT_NEAR(sum, 1.0f, 1e-4f);
    // Chords of triangles and of steps between shells: no nearer than the grid is fine.
    EXPECT_LT((mean - place).norm(), 0.2f * place.norm());
  }
}

TEST(ShellGrid, FallsOffBeyondTheLastShell) {
  const ShellGrid grid(4, 3, 0.5f, 2.0f);
  const auto corners = grid.around({0.0f, 0.0f, 8.0f});
  float sum = 0.0f;
  for (const float weight : corners.weight) sum += weight;
  EXPECT_NEAR(sum, 1.0f / 16.0f, 1e-4f);
}

TEST(ShellGrid, KeepsTheSidesOfAFloorApart) {
  const ShellGrid grid(8, 6, 0.1f, 4.0f);
  Rng rng(2);
  for (int i = 0; i < 1000; ++i) {
    Eigen::Vector3f place = anywhere(rng, 0.1, 4.0);
    place.y() = std::abs(place.y());
    const auto corners = grid.around(place);
    for (std::size_t k = 0; k < corners.point.size(); ++k)
      EXPECT_TRUE(corners.weight[k] < 1e-5f || grid.position(corners.point[k]).y() > -1e-5f);
  }
}

TEST(ShellGrid, TakesTheOrigin) {
  const ShellGrid grid(4, 3, 0.5f, 2.0f);
  for (const float weight : grid.around(Eigen::Vector3f::Zero()).weight) EXPECT_TRUE(std::isfinite(weight));
}

}  // namespace
}  // namespace refield::dynamic
