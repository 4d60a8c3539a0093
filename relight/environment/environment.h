// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/light_basis.h"
#include "core/field/transfer_tiles.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
#include "refield/relight.h"
#include "relight/environment/prepared_environment.h"
#include "relight/environment/sphere_grid.h"

namespace refield {

/// Which kind of map of the whole environment has such proportions; nothing: none has.
std::optional<Parameterisation> environment_kind(int width, int height);
/// Throws InputError where none has, naming the map `name`.
Parameterisation require_environment_kind(int width, int height, const std::string& name);

/// Reads a map of the whole environment: twice as wide as high is lat-long, six times as high as wide a
/// cube. Throws InputError for other proportions, and what read_light_map() does.
LightMap read_environment(const std::filesystem::path& path, const RunContext& run = {});

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
  EnvironmentLight project_exactly(const LightMap& environment, const EulerAngles& turn,
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
  std::optional<LightMap> as_it_stands(const LightMap& environment, const EulerAngles& turn) const;

  SphereGrid grid_;
  std::vector<float>
      solid_angles_;   // of a window's or a face's texels; of one texel per row of lat-long maps
  double seen_ = 0.0;  // solid angle of the target, what windows share counted once
  std::vector<float> window_shares_;        // [texels], 1 ∕ windows that see one; empty where none overlap
  std::vector<SharedTexel> shared_texels_;  // row by row
};

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
