// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"

namespace refield {

/// A convex polygon on the sphere, smaller than a half of it: corners in order, as directions of any length,
/// joined by great circles. Fewer than three corners: empty.
using SphericalPolygon = std::vector<Eigen::Vector3d>;

/// Divides a polygon by the plane through the origin: `inside` gets what lies where normal · p ≥ 0, `outside`
/// the rest. Their old content is lost; `polygon` must be neither of them.
void split(const SphericalPolygon& polygon, const Eigen::Vector3d& normal, SphericalPolygon& inside,
           SphericalPolygon& outside);

/// Steradians: the sum over the triangles of a fan (van Oosterom and Strackee 1983, eq. 8).
double solid_angle(const SphericalPolygon& polygon);

/// Texels of a light map that lie on a plane as seen from the origin, so that their edges are great circles:
/// a cube's face, a monitor's window, or a narrow strip of a lat-long map from pole to pole.
struct SpherePatch {
  /// Rows: right, up, ahead. A direction with coordinates (x, y, z) in these axes, z > 0, is seen at
  /// (x/z, y/z).
  Eigen::Matrix3d axes;
  /// Where the edges of columns, from left to right, and of rows, from top to bottom, cut the axes' x–z and
  /// y–z planes: (x, z) and (y, z) of a direction, z ≥ 0.
  using Edges = std::shared_ptr<const std::vector<Eigen::Vector2d>>;
  Edges column_edges, row_edges;
  int first_column = 0, first_row = 0;  ///< of the light map

  int columns() const { return static_cast<int>(column_edges->size()) - 1; }
  int rows() const { return static_cast<int>(row_edges->size()) - 1; }

  /// Normals of edges; they point right and down.
  Eigen::Vector3d column_normal(int edge) const {
    const Eigen::Vector2d& at = (*column_edges)[edge];
    return {at[1], 0.0, -at[0]};
  }
  Eigen::Vector3d row_normal(int edge) const {
    const Eigen::Vector2d& at = (*row_edges)[edge];
    return {0.0, -at[1], at[0]};
  }

  /// The outline of a texel, column and row counted from 0 within the patch.
  SphericalPolygon texel(int column, int row) const { return rectangle(column, row, column + 1, row + 1); }
  /// Outline of all texels together.
  SphericalPolygon outline() const { return rectangle(0, 0, columns(), rows()); }

 private:
  SphericalPolygon rectangle(int left, int top, int right, int bottom) const;
};

/// A light map's texels on the sphere. Those of lat-long maps are cut into strips so narrow that the great
/// circles along their upper and lower edges stand for parallels of latitude: a texel's solid angle is right
/// to 1e-6, the whole map's exactly.
class SphereGrid {
 public:
  /// `monitors`: where the windows of a monitor map stand, unused otherwise. Throws InputError for a monitor
  /// map without, and for a cube that is not six squares.
  explicit SphereGrid(const LightDomain& domain, std::span<const MonitorPlacement> monitors = {});

  const LightDomain& domain() const { return domain_; }
  const std::vector<SpherePatch>& patches() const { return patches_; }

  /// Patches first to last − 1, modulo their number, hold all that `polygon` touches.
  std::pair<int, int> patches_near(const SphericalPolygon& polygon) const;

 private:
  void add_strips();
  void add_faces();
  void add_windows(std::span<const MonitorPlacement> monitors);

  LightDomain domain_;
  std::vector<SpherePatch> patches_;
};

/// A texel's share of a polygon.
struct TexelOverlap {
  int column, row;  ///< of the light map
  double solid_angle;
};

/// Finds which texels of a grid a polygon lies on. Keeps scratch memory: one for each thread.
class OverlapFinder {
 public:
  /// `grid` must outlive the finder.
  explicit OverlapFinder(const SphereGrid& grid) : grid_(grid) {}

  /// Valid until the next call. A texel may come in several pieces. What a polygon has outside of a grid
  /// that does not go all around is left out.
  const std::vector<TexelOverlap>& find(const SphericalPolygon& polygon);

 private:
  void cut_patch(const SpherePatch& patch);
  void cut_column(const SpherePatch& patch, int column, SphericalPolygon& part);

  const SphereGrid& grid_;
  std::vector<TexelOverlap> found_;
  SphericalPolygon rest_, part_, cell_, spare_;
};

}  // namespace refield
