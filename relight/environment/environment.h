// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/light_basis.h"
#include "core/field/transfer_tiles.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
#include "refield/relight.h"
#include "relight/environment/prepared_environment.h"

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

/// Which kind of map of the whole environment has such proportions; nothing: none has.
std::optional<Parameterisation> environment_kind(int width, int height);
/// Throws InputError where none has, naming the map `name`.
Parameterisation require_environment_kind(int width, int height, const std::string& name);

/// Reads a map of the whole environment: twice as wide as high is lat-long, six times as high as wide a
/// cube. Throws InputError for other proportions, and what read_light_map() does.
LightMap read_environment(const fs::path& path, const RunContext& run = {});

struct EnvironmentLight {
  LightMap light;
  EnvironmentShare share;
};

/// A convex part of a texel, and the number of windows that see it.
struct SeenPart {
  SphericalPolygon outline;
  int windows = 1;
};

/// Puts environments onto the light map of a field: a monitor's window as seen from the middle of the scene,
/// several monitors' windows, a lat-long map or a cube. Every texel gets the mean radiance of the environment
/// over its solid angle, by the exact overlaps of texels on the sphere: light is neither lost nor made,
/// whatever the two resolutions, and nothing aliases. Directions that several windows see are shared
/// evenly between them, so that they count once.
class EnvironmentProjector {
 public:
  /// `monitors`: placements where `target` is a monitor map, see check_placements(). Throws InputError where
  /// they are missing.
  EnvironmentProjector(const LightDomain& target, std::span<const MonitorPlacement> monitors,
                       const RunContext& run = {});

  const LightDomain& target() const { return grid_.domain(); }

  /// The light that `environment` gives when it is turned by `turn`: what it shows ahead (+Z) lies at
  /// rotation_of(turn) · (0, 0, 1) then. An environment of the target's own size and parameterisation that is
  /// not turned is not touched. Sums along the edges of texels, see PreparedEnvironment; cubes and maps of
  /// fewer than 16 columns go the way of project_exactly(). Runs on all cores; from several threads at a
  /// time. Throws Interrupted.
  EnvironmentLight project(const PreparedEnvironment& environment, const EulerAngles& turn,
                           const RunContext& run = {}) const;
  /// Projects a map that is needed once. Throws InputError for one that is neither lat-long nor cube.
  EnvironmentLight project(const LightMap& environment, const EulerAngles& turn,
                           const RunContext& run = {}) const;

  /// Projects by clipping each texel of the target against the texels of the environment. Slow: the
  /// reference.
  EnvironmentLight project_exactly(const PreparedEnvironment& environment, const EulerAngles& turn,
                                   const RunContext& run = {}) const;

 private:
  /// A texel that other windows see a part of.
  struct SharedTexel {
    int x = 0, y = 0;  ///< of the light map
    std::vector<SeenPart> parts;
  };

  std::vector<SeenPart> parts_of(const SphericalPolygon& texel, const SpherePatch& window) const;
  void find_shared_texels(const RunContext& run);
  const float* solid_angles_of(
      int y) const;  ///< of a row's texels; the first is all texels' on lat-long maps
  /// `energy`: what reaches some parts of the light map.
  EnvironmentShare share_of(const std::vector<double>& energy, const PreparedEnvironment& environment) const;
  std::optional<LightMap> as_it_stands(const LightMap& environment, const EulerAngles& turn) const;

  SphereGrid grid_;
  std::vector<float>
      solid_angles_;   // of a window's or a face's texels; of one texel per row of lat-long maps
  double seen_ = 0.0;  // solid angle of the target, what windows share counted once
  std::vector<float> window_shares_;        // [texels], 1 ∕ windows that see one; empty where none overlap
  std::vector<SharedTexel> shared_texels_;  // row by row
};

/// Where the sun stands when the share `done` (0 to 1) of an equinox day from sunrise to sunset is over.
/// South is ahead (+Z): it rises at the left edge of the view (−X), stands over its middle at noon, and sets
/// at the right.
Eigen::Vector3d sun_direction(double done, const SkyOptions& options);

/// The lat-long map of a clear sky, radiance 1 standing for 1000 cd/m², with the sun `towards_sun` (unit, not
/// below the horizon) as a disc of 0.53° whose energy does not depend on the map's size, and a grey ground
/// of albedo 0.2. Sky: Preetham, Shirley and Smits 1999, appendix A.2; sun: extinction by air
/// and haze as in their appendix A.1, without ozone, water vapour and mixed gases.
LightMap clear_sky(const Eigen::Vector3d& towards_sun, const SkyOptions& options);

/// Whether a field's coefficients are the light's integrals over boxes and vector boxes of a cube map and
/// nothing else, so that BoxProjector gives them: clustered environment lights.
bool box_sums_suffice(const LightBasis& basis);

/// Integrates environments over boxes of a cube map, without the map. Boxes share their edges, and each is
/// summed along once.
class BoxProjector {
 public:
  /// `vector_boxes` and `boxes` of a cube map of `resolution`² texels per face.
  BoxProjector(int resolution, std::span<const VectorBox> vector_boxes, std::span<const SmallBox> boxes);

  /// Coefficients under radiance times solid angle, of vector boxes, then of boxes: [kernels × 3]. Throws
  /// InputError for an environment without PreparedEnvironment::has_path_sums(), Interrupted. Runs on all
  /// cores.
  std::vector<float> project(const PreparedEnvironment& environment, const EulerAngles& turn,
                             const RunContext& run = {}) const;

 private:
  /// The edges of boxes, each once.
  class Edges {
   public:
    Edges(int resolution, std::span<const SmallBox> boxes);

    std::size_t boxes() const { return first_piece_.size() - 1; }
    /// Calls visit(box, sums around what of it lies on one face), for different boxes by several threads.
    /// `Batch`: as PathBatch, of `make_batch()`.
    template <class Sums, class MakeBatch, class Visit>
    void sum_around(const PreparedEnvironment& environment, const Eigen::Matrix3d& environment_from_scene,
                    const RunContext& run, const MakeBatch& make_batch, const Visit& visit) const;

   private:
    /// Part of one of a face's grid lines.
    struct Line {
      int face = 0, edge = 0;
      bool is_column = false;
      std::size_t first = 0, last = 0;  ///< of stops_
    };
    /// The part of a box on one face: places in stops_ of the ends of its edges.
    struct Piece {
      std::array<std::uint32_t, 2> top, bottom, left, right;
    };

    int resolution_;
    std::vector<Line> lines_;
    std::vector<std::int16_t> stops_;  // along lines, in texels of the face
    std::vector<Piece> pieces_;
    std::vector<std::size_t> first_piece_;  // [boxes + 1]
  };

  std::vector<VectorBox> vector_boxes_;
  std::vector<std::size_t> first_of_box_;  // vector boxes with the same box are successive; at the end, all
  Edges vector_edges_, edges_;
};

}  // namespace refield
