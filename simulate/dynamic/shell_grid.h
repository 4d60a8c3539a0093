// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace refield::dynamic {

/// Points on concentric spheres around an object (Iwasaki et al., section 4.2; Zhou et al. 2005). On each
/// sphere they are the corners of an octahedron's faces divided into rings² triangles, so that the equator,
/// in which a floor lies, is a line of the grid; radii grow by one factor.
class ShellGrid {
 public:
  ShellGrid() = default;
  /// rings, shells ≥ 1; 0 < smallest ≤ largest radius.
  ShellGrid(int rings, int shells, float smallest, float largest);

  std::size_t points() const { return side() * side() * radii_.size(); }
  /// Some points on the lower half are there twice: the square into which the octahedron unfolds is kept
  /// whole.
  Eigen::Vector3f position(std::size_t point) const;
  float largest_radius() const { return radii_.back(); }

  /// What a place is interpolated from: the corners of a triangle on the sphere inside of it and on the one
  /// outside. Weights add up to 1, or, beyond the last sphere, to the share (r/distance)² to which light has
  /// fallen off.
  struct Corners {
    std::array<std::uint32_t, 6> point;
    std::array<float, 6> weight;
  };
  Corners around(const Eigen::Vector3f& place) const;

 private:
  std::size_t side() const { return 2 * static_cast<std::size_t>(rings_) + 1; }
  /// Of a corner with |x| + |y| + |z| = rings.
  std::uint32_t number(int x, int y, int z) const;

  int rings_ = 0;
  std::vector<float> radii_;
  float log_smallest_ = 0.0f, log_step_ = 1.0f;
};

}  // namespace refield::dynamic
