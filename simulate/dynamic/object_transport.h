// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "core/light/harmonics.h"
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/geometry/mesh_rays.h"

namespace refield::dynamic {

/// The direction that all of a mesh faces; none where it is not flat.
std::optional<Eigen::Vector3f> facing_of(const Mesh& mesh);

/// Where light may come from: `count` points for each of `distances` (> 1), in radii of the bounding_ball(),
/// spread over spheres; for a flat mesh evenly over a square of twice
/// its radius, on the side that it faces, (distance − 1) radii above (Iwasaki et al., figure 2, have one
/// distance).
std::vector<Eigen::Vector3f> point_lights(const Mesh& mesh, int count, std::span<const float> distances);

/// L_k(x) = V h_k(ω) cosθ/r² of all vertices and of each of the BRDF's K terms under point lights of
/// intensity one, shadows of the mesh on itself included: [vertices · K × lights], row v·K + k. Runs on all
/// cores; throws Interrupted.
Eigen::MatrixXf light_terms(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                            std::span<const Eigen::Vector3f> lights, const RunContext& run = {});

/// Functions Ψ over a mesh' vertices, by which light on the surface is told: L ≈ functions · w,
/// w = to_weights · L.
struct SurfaceBasis {
  Eigen::MatrixXf functions;   ///< [vertices × N], unitless
  Eigen::MatrixXf to_weights;  ///< [N × vertices]
};

/// An orthonormal basis of what functions [vertices × N] span over vertices of given areas; functions of
/// which the ones before leave no more than a thousandth are dropped. Weights are integrals, never larger
/// than L. Deviation from the paper, which inverts ΨᵀΨ (Iwasaki et al., eqs. 6 and 7;
/// docs/method/dynamic-bases.md). One area for each vertex.
SurfaceBasis surface_basis(const Eigen::MatrixXf& functions, const Eigen::VectorXf& areas);

struct PrincipalOptions {
  int lights = 128;  ///< point lights at each distance, at least 1
  /// In radii of the bounding sphere, > 1 (point_lights()). The paper has them on the sphere itself, one
  /// distance; several serve light from near and far.
  std::vector<float> distances = {1.4f, 2.0f, 4.0f};
};

/// Principal components of the light that point lights around a mesh bring to its vertices (section 5.2): the
/// `functions` first left singular vectors of L_k, a column for each light and each of the BRDF's terms,
/// vertices weighted by area, lights by what they bring. The mean is not taken off: it would be one more
/// function. Fewer where the lights span less. Randomised (Halko, Martinsson and Tropp 2011), from a fixed
/// seed. Holds vertices × lights × terms × 8 bytes. Throws InputError where no light comes back, Interrupted.
SurfaceBasis principal_basis(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                             int functions, const PrincipalOptions& options = {}, const RunContext& run = {});

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
  /// Number of a corner with |x| + |y| + |z| = rings.
  std::uint32_t number(int x, int y, int z) const;

  int rings_ = 0;
  std::vector<float> radii_;
  float log_smallest_ = 0.0f, log_step_ = 1.0f;
};

/// [rank × 3]: what the modes of a LowRank are multiplied with, RGB.
using ModeWeights = Eigen::Matrix<float, Eigen::Dynamic, 3>;

/// A large matrix [blocks · width × columns] in few modes: U · mix, U [blocks · width × rank] as whole
/// numbers of 16 bits with one scale a block, since what stands near an object is so much brighter than what
/// stands far.
struct LowRank {
  std::size_t blocks = 0;
  int width = 0, rank = 0;
  std::vector<std::int16_t> values;  ///< [blocks × rank × width]
  std::vector<float> scale;          ///< [blocks]
  Eigen::MatrixXf mix;               ///< [rank × columns]

  /// z of weights [columns / 3 × 3], one colour for each third of the columns.
  ModeWeights modes_of(const ModeWeights& weights) const;
  /// out [width × 3] of a block for the modes' coefficients `z` [rank × 3].
  void expand(std::size_t block, const ModeWeights& z, float* out) const;
  std::size_t bytes() const;
};

/// All modes of a matrix that float can tell from zero: they leave 3e-4 of it out (relative, Frobenius'
/// norm). `rows` [columns × blocks · width]: one column of it for each row of the matrix.
LowRank low_rank(const Eigen::MatrixXf& rows, int width);

/// Patterns of light over an object, by which it shines on others. What a vertex v reflects of the light that
/// it gets is represented by L_k(v), one number for each of the K terms of its material (Iwasaki et al., eq.
/// 4); row v·K + k of the matrices is that number.
struct SurfaceModes {
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Rows functions;              ///< [vertices · K × modes]; empty once an object's transport is computed
  Eigen::MatrixXf to_weights;  ///< [modes × vertices · K]
  Eigen::Index count() const { return to_weights.rows(); }
};

/// The paper's (eq. 5): each term's L_k by the same N functions, with weights of its own: N · K modes.
SurfaceModes separate_modes(const SurfaceBasis& basis, int terms);

struct TransportOptions {
  /// All that follows but `factors` is for indirect light by fields (Iwasaki et al., section 4), with N · K
  /// modes, and for shadows by fields; by rays from vertices (GatheredLight) light needs nothing else.
  bool fields = false;
  int order = 4;       ///< n: light that arrives at a point is represented by n² spherical harmonics
  int functions = 32;  ///< N: patterns an object shines in
  FactorOptions factors{.largest = 0, .error = 0.2};  ///< K; for indirect light
  int rings = 8, shells = 14;                         ///< ShellGrid
  float smallest_radius = 0.06f, largest_radius = 4;  ///< of the shells, in radii of the object
  int directions = 1024;                              ///< rays per point

  bool operator==(const TransportOptions&) const = default;
};

/// What an object does to light, computed once, in its own axes: the same wherever it goes. Angular functions
/// are represented by n² harmonics, of radiance by the direction that it comes from.
struct ObjectTransport {
  BrdfFactors factors;
  SurfaceModes modes;
  ShellGrid grid;
  /// Source radiance field (Iwasaki et al., section 4.2): what the object sends to each point of the grid, a
  /// block of n² harmonics each. Columns: colour · modes + mode.
  LowRank leaving;
  /// What it sends to its own vertices after one reflection: L_k, a block of K each. Nothing stands between.
  LowRank returning;
  /// Share of each direction that the object covers, [n² × points of the grid] (its occlusion field, Zhou et
  /// al. 2005).
  Eigen::MatrixXf coverage;
  std::vector<bool> outside;  ///< [points of the grid]: not within the object or behind a sheet
  /// L_k of a vertex from what arrives: ∫ V h_k cosθ y dω with its own object's shadow, [n² × vertices · K].
  Eigen::MatrixXf receiving;
  int order = 0;        ///< n
  float radius = 0.0f;  ///< of the sphere around it

  int terms() const { return factors.terms(); }
  bool has_fields() const { return receiving.size() > 0; }
  std::size_t bytes() const;
};

/// The grid around an object whose sphere has that radius.
ShellGrid shell_grid_of(const TransportOptions& options, float radius);

/// Runs on all cores, with progress. Throws InputError, Interrupted.
ObjectTransport object_transport(const MovingObject& object, const prt::MeshRays& rays,
                                 const TransportOptions& options, const RunContext& run = {});

}  // namespace refield::dynamic
