// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/collaborative_call_once.h>

#include <cmath>
#include <memory>
#include <type_traits>

#include "core/base/run_context.h"
#include "core/light/light_map.h"
#include "relight/environment/path_vectors.h"

namespace refield {

/// Texel of an environment map.
struct SourceTexel {
  int column = 0, row = 0;
  bool operator==(const SourceTexel&) const = default;
};

/// A point on the sphere of an environment map: a unit direction, and the texel it lies in.
struct MapPoint {
  Eigen::Vector3d direction;
  SourceTexel texel;
};

template <class Light>
struct SumsAlong {
  Light light = Light::Zero();
  double azimuth = 0.0;  ///< ∫ dφ, with φ the azimuth that grows with the columns of lat-long maps

  SumsAlong& operator+=(const SumsAlong& other) {
    light += other.light;
    azimuth += other.azimuth;
    return *this;
  }
  SumsAlong& operator-=(const SumsAlong& other) {
    light -= other.light;
    azimuth -= other.azimuth;
    return *this;
  }
};
/// Sums along a path on the sphere: ∫ Q dφ of each channel, Q(φ, y) the integral of the radiance over
/// sin(latitude) from y to the north pole.
using PathSums = SumsAlong<Eigen::Vector3d>;
/// The same of the light vector, ∫ L ω dω: [x, y, z][channels].
using VectorPathSums = SumsAlong<Eigen::Matrix3d>;

/// An environment map with what its projection needs, to be made once per map and used for any number of
/// rotations and targets, from several threads at a time.
///
/// A map's radiance is constant on each texel, so its integral over a spherical polygon is, by Green's
/// theorem, the integral of Q dφ along the polygon's edges. On the part of a great circle that lies in one
/// texel Q is linear in sin(latitude), and ∫ sin(latitude) dφ is a difference of spherical triangles: the
/// integral is exact, and its cost grows with the texels that edges cross instead of those that polygons
/// hold.
class PreparedEnvironment {
 public:
  /// Takes 24 bytes per texel besides the map, a fraction of that for maps of more than 2 million texels.
  /// Throws InputError for a monitor map, Interrupted.
  explicit PreparedEnvironment(LightMap map, const RunContext& run = {});
  explicit PreparedEnvironment(std::shared_ptr<const LightMap> map, const RunContext& run = {});

  const LightMap& map() const { return *map_; }
  /// Radiance times solid angle over the whole map, all channels together.
  double energy() const { return total_[0] + total_[1] + total_[2]; }

  /// Whether the functions below may be called: for lat-long maps of at least 16 columns.
  bool has_path_sums() const { return !prefix_.empty(); }

  /// The point in a direction of any length; `near` only tells where to look first. A direction to a pole,
  /// where it has no azimuth, is moved by 1e-12.
  MapPoint point(Eigen::Vector3d direction, const SourceTexel& near) const;

  /// Along the great circle from a to b, less than 180° apart.
  PathSums along(const MapPoint& a, const MapPoint& b) const;

  /// The integral of the radiance over a polygon, from the sums along its edges; they go around it
  /// anticlockwise as an observer at the origin sees it.
  Eigen::Vector3d enclosed(const PathSums& around) const;

  /// Path sums of the light vector, ∫ L ω dω: where radiance is constant, it is an integral of ω along the
  /// edges, too (the light vector of a polygon), so that these sums are as exact. The first call makes a
  /// table of 48 bytes per texel, on all cores; throws Interrupted.
  void prepare_vectors(const RunContext& run) const;
  /// After prepare_vectors().
  VectorPathSums vectors_along(const MapPoint& a, const MapPoint& b) const;
  Eigen::Matrix3d enclosed(const VectorPathSums& around) const;

  /// See TexelBounds. `shrink`: √(1 − d²/4) with the longest chord d of the great circles; 0 for any length.
  TexelBounds bounds_of(const SourceTexel& texel, double shrink) const {
    const auto row = static_cast<std::size_t>(texel.row), column = static_cast<std::size_t>(texel.column);
    const double north = sines_[row], south = sines_[row + 1], squared = shrink * shrink;
    TexelBounds bounds;
    bounds.number = texel.row * map_->radiance.width + texel.column;
    bounds.north = north * std::abs(north);
    bounds.south = south * std::abs(south);
    bounds.left_x = edges_[column].x();
    bounds.left_z = edges_[column].y();
    bounds.right_x = edges_[column + 1].x();
    bounds.right_z = edges_[column + 1].y();
    bounds.safe_north = north > 0.0 ? squared * bounds.north : bounds.north;
    bounds.safe_south = south < 0.0 ? squared * bounds.south : bounds.south;
    return bounds;
  }

 private:
  template <class Sums>
  friend class PathBatch;

  SourceTexel texel_at(const Eigen::Vector3d& direction, const SourceTexel& near) const;
  /// Whether great circles between points of a texel whose sines of latitude lie between `least` and `most`
  /// stay in the texel; `shrink` as for bounds_of().
  bool stays_inside(const SourceTexel& texel, double lowest, double highest, double shrink) const {
    const double north = sines_[static_cast<std::size_t>(texel.row)],
                 south = sines_[static_cast<std::size_t>(texel.row) + 1];
    return (north <= 0.0 || highest <= north * shrink) && (south >= 0.0 || lowest >= south * shrink);
  }
  void prepare_lat_long(const RunContext& run);
  /// `level`: (x, z) of what tells the azimuth, for which points near a pole are not good enough: the edge of
  /// a column where the point lies on one.
  struct PathPoint {
    Eigen::Vector3d direction;
    Eigen::Vector2d level;
  };
  void add_piece(const PathPoint& from, const PathPoint& to, int column, int row, PathSums& sums) const;
  /// Calls visit(from, to, column, row) for the pieces of the path of along(), each in one texel.
  template <class Visit>
  void walk(const MapPoint& a, const MapPoint& b, const Visit& visit) const;
  /// Adds the sums along a piece in one texel: its azimuth and ∫ (1 − sin(latitude)) dφ.
  void add_measured(double azimuth, double above, std::int32_t texel, int row, PathSums& sums) const;
  /// Adds a piece to sums of light vectors: see PieceVectors.
  void add_measured(double azimuth, const Eigen::Vector2d& across, const Eigen::Vector3d& inside,
                    std::int32_t texel, int row, VectorPathSums& sums) const;
  /// Sine of the azimuth from the left edge of `column` to a direction, times the cosine of its latitude.
  double right_of(int column, const Eigen::Vector3d& direction) const {
    const Eigen::Vector2d& edge = edges_[static_cast<std::size_t>(column)];
    return edge[1] * direction.x() - edge[0] * direction.z();
  }

  std::shared_ptr<const LightMap> map_;
  Eigen::Vector3d total_ = Eigen::Vector3d::Zero();  // radiance times solid angle
  std::vector<double> sines_;           // [height + 1], of the latitudes of rows' edges, 1 to −1
  std::vector<Eigen::Vector2d> edges_;  // [width + 1], (x, z) of directions on the left edges of columns
  int block_rows_ = 1;                  // rows that share an entry of prefix_
  std::vector<double> prefix_;  // [blocks × width × 3], radiance over sin(latitude) north of a block

  /// What vectors_along() needs. Over the latitudes from an edge of a row to the north pole: ∫ sin dsin and
  /// ∫ cos dsin.
  struct Cap {
    double upward = 0.0, outward = 0.0;
  };
  struct VectorTable {
    tbb::collaborative_once_flag made;
    std::vector<Cap> caps;               // [height + 1], of rows' edges
    std::vector<Eigen::Vector2d> poles;  // [height], angle from the pole of a row's upper edge, and its sine
    std::vector<Cap> prefix;             // [blocks × width × 3], these times radiance, north of a block
    Eigen::Matrix3d total = Eigen::Matrix3d::Zero();
  };
  void make_vector_table(VectorTable& table, const RunContext& run) const;
  std::shared_ptr<VectorTable> vectors_ = std::make_shared<VectorTable>();
};

/// PreparedEnvironment::along(), or with VectorPathSums vectors_along(), for many paths at a time. Pieces of
/// paths are measured in vectors, other than those of coarse maps. Sums do not depend on the batch's other
/// paths. One for each thread.
template <class Sums>
class PathBatch {
 public:
  /// `environment` must outlive the batch; for VectorPathSums, after its prepare_vectors().
  explicit PathBatch(const PreparedEnvironment& environment);

  /// As along(). `sums` is set when the next flush() returns, and must stay where it is until then.
  void add(const MapPoint& a, const MapPoint& b, Sums& sums);
  void flush();

 private:
  using PathPoint = PreparedEnvironment::PathPoint;
  static constexpr bool has_vectors = std::is_same_v<Sums, VectorPathSums>;

  bool add_short(const MapPoint& a, const MapPoint& b, Sums& sums);
  void add_piece(const PathPoint& a, const PathPoint& b, int column, int row, Sums& sums);

  struct Place {
    std::int32_t texel, row;
    Sums* sums;
  };
  struct Measures {  // of PathSums
    alignas(64) double azimuth[PathPieceEnds::capacity];
    alignas(64) double above[PathPieceEnds::capacity];
  };
  struct None {};
  const PreparedEnvironment& environment_;
  bool is_fine_;  // so that all pieces are measured in vectors
  std::size_t count_ = 0;
  PathPieceEnds ends_;
  std::conditional_t<has_vectors, PieceRows, None> rows_;
  std::conditional_t<has_vectors, PieceVectors, Measures> measures_;
  Place places_[PathPieceEnds::capacity];
};

extern template class PathBatch<PathSums>;
extern template class PathBatch<VectorPathSums>;

}  // namespace refield
