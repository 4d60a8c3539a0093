// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/glossy_sums.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

/// A point that stands for a piece of an area light. Both its sides shine.
struct AreaPoint {
  Eigen::Vector3f position, normal;
  Eigen::Array3f power;  ///< radiance × area of the piece
  float area;
};

/// `count` points, each the middle of a piece of an area light (colours: radiance); pieces have equal area
/// times brightness, are about as wide as long, and stay the same wherever an area light goes. None where
/// nothing shines.
std::vector<AreaPoint> area_points(const Mesh& area_lights, int count);

/// L_k of an object's vertices (Iwasaki et al., eq. 4), row v·K + k, RGB.
using TermLight = Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// What area lights bring to an object's vertices.
struct DirectLight {
  TermLight terms;
  std::vector<Eigen::Array3f>
      to_eye;  ///< [vertices], radiance by the material itself, not its factors; colours not in it
};

/// Light that comes straight from area lights, ∫ L V h_k cosθ dω as a sum over their points, each seen or not
/// by a ray: shadows of all objects, wherever they are. Nearer than a point's piece is wide, light stays
/// finite. `eye` in the scene's axes. Runs on all cores.
DirectLight direct_light(const MovingObject& object, const Pose& pose, const BrdfFactors& factors,
                         const SceneRays& rays, std::span<const AreaPoint> area_lights,
                         const Eigen::Vector3f& eye);

inline constexpr int max_harmonics = harmonics_of(8);
/// n² harmonics, as many as TransportOptions::order allows, without a heap.
using Harmonics = Eigen::Matrix<float, Eigen::Dynamic, 1, 0, max_harmonics, 1>;

/// An object where it stands.
struct PlacedObject {
  const ObjectTransport* transport;
  Pose pose;
};

/// Another object as one, the target, sees it; all in the target's axes.
struct SeenObject {
  const ObjectTransport* transport;
  Pose from_target;
  Eigen::Vector3f middle;
  Eigen::MatrixXf turn, turn_back;  ///< harmonics from the object's axes, and to them
};
SeenObject seen_object(const PlacedObject& object, const Pose& target);

/// Share of each direction that an object covers (its occlusion field, Zhou et al. 2005), in the target's
/// axes; `corners`, of the object's grid, say where.
Harmonics covered_by(const SeenObject& object, const ShellGrid::Corners& corners);

/// A function of the angle from an axis, by samples spread evenly over its cosine in [−1, 1]; linear between.
class ZonalTable {
 public:
  ZonalTable() = default;
  /// At least two samples.
  explicit ZonalTable(std::vector<float> samples) : samples_(std::move(samples)) {}
  float operator()(float cosine) const;

 private:
  std::vector<float> samples_;
};

/// Weight of a material's first term for light at an angle from the normal, h_0 cosθ: itself, and as
/// harmonics below an order tell it. That term does not depend on the azimuth and never changes its sign, as
/// the largest of a distribution that is nowhere negative; here it is never negative.
struct FirstTerm {
  ZonalTable exact, by_harmonics;
  float sign = 1.0f;   ///< of h_0
  float least = 0.0f;  ///< a small share of its most
};
FirstTerm first_term(const BrdfFactors& factors, int order);

/// Products of two functions represented by harmonics of one order, projected onto the same order:
/// c_i = Σ_jk Γ_ijk a_j b_k, Γ_ijk = ∫ y_i y_j y_k dω (Zhou et al. 2005, section 4). Most Γ are zero.
class HarmonicProduct {
 public:
  explicit HarmonicProduct(int order);
  /// The matrix [order² × order²] that multiplies by `b` [order²].
  Eigen::MatrixXf matrix(std::span<const float> b) const;
  std::size_t coefficients() const { return value_.size(); }

 private:
  struct Pair {
    std::uint8_t j, k;
  };
  std::vector<std::uint32_t> first_;  // [order² + 1], in the next two
  std::vector<Pair> pair_;
  std::vector<float> value_;
};

/// Direct light without rays, from what is computed once for each object (Zhou et al. 2005, "Precomputed
/// Shadow Fields for Dynamic Scenes"; Iwasaki et al., section 3). Other objects' shadows come of their
/// occlusion fields, n² harmonics of what an object covers: the light of all area light points behind it is
/// multiplied by what is left (blurred twice, so what is small hides hardly anything). An object's own shadow
/// comes of ObjectTransport::receiving. An object hides a point of an area light only if the line to it meets
/// the object's bounding box, so that nothing hides what stands before it.
///
/// Blurred to n² harmonics light would be far too even. So they tell shares alone: L_k are scaled so that the
/// first is right where nothing hides. All is finite wherever objects and area lights stand.
class FieldLight {
 public:
  /// Both must outlive it.
  FieldLight(const DynamicScene& scene, std::span<const ObjectTransport> transport);

  /// L_k as of direct_light(), for the vertices of objects[target]. `objects`: all of the scene. Runs on all
  /// cores.
  TermLight direct(std::span<const PlacedObject> objects, std::size_t target,
                   std::span<const AreaPoint> area_lights, const HarmonicProduct& product) const;

 private:
  const DynamicScene& scene_;
  std::vector<Eigen::Array3f> half_size_;  // [objects], of the bounding boxes
  std::vector<FirstTerm> first_;           // [objects]
};

/// How one object, the source, lights another, the target, as they stand in a frame: the same for all
/// bounces.
struct PairTransport {
  std::vector<ShellGrid::Corners> corners;  ///< [vertices of the target], of the source's grid
  /// [n² × vertices · K]: ObjectTransport::receiving of the target in the source's axes, what hides the
  /// source taken off.
  Eigen::MatrixXf receiving;

  /// Adds what a vertex gets; `radiance` [3 n² × points of the source's grid], colours one after another,
  /// `light` the K rows of the vertex.
  void add(std::size_t vertex, const Eigen::MatrixXf& radiance, Eigen::Ref<TermLight> light) const;
};

/// How all other objects light one, [objects]; its own place there stays as it is. `positions`: the target's
/// vertices, in its own axes. An object that stands before a source takes off what it covers, by products of
/// harmonics (Zhou et al. 2005, section 4). Runs on all cores.
void place_pairs(std::span<const PlacedObject> objects, std::size_t target,
                 std::span<const Eigen::Vector3f> positions, const HarmonicProduct& product,
                 std::span<PairTransport> pairs);

/// Corners of which the grid's points hold no light, because they lie inside of the object, give their share
/// to the others.
void leave_out_inside(const std::vector<bool>& outside, ShellGrid::Corners& corners);

/// Whether an object stands before another as seen from around: it does if the other's sphere encloses its
/// middle, since walls and floors are behind what stands in a room; else if it is nearer.
bool stands_before(const Eigen::Vector3f& from, const Eigen::Vector3f& middle, float radius,
                   const Eigen::Vector3f& other_middle, float other_radius);

struct FrameOptions {
  int light_samples = 32;  ///< that stand for all area lights together
  int rays = 16;           ///< from each vertex, for indirect light where objects have no fields
  int bounces = 3;         ///< at most, between objects and within them
  /// As in the paper: shadows from area lights by objects' occlusion fields instead of rays (FieldLight), and
  /// that light goes to the eye by the K terms of a material instead of the material itself.
  bool direct_by_fields = false;

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// Indirect light by rays from every vertex: what it sees is found once a frame, and all bounces use it.
/// Nothing depends on distances between objects, so light is right where they touch. A vertex has few rays;
/// those of its neighbours, up to two edges away and facing the same side, stand in for more (interleaved
/// sampling: Keller and Heidrich 2001). Diffuse vertices take the mean of what their neighbours receive,
/// weighted down where objects are near (Ward et al. 1988). Glossy ones evaluate the rays of their neighbours
/// for their own normals, combined by the balance heuristic (Veach and Guibas 1995). An object sends the
/// light of the vertex nearest to the hit. Limit: Embree's rays, three quarters of the time.
class GatheredLight {
 public:
  /// `scene` and `transport` must outlive it; `rays` and `transport` [objects].
  GatheredLight(const DynamicScene& scene, std::span<const prt::MeshRays> rays,
                std::span<const ObjectTransport> transport);

  /// Finds what vertices see in `count` directions each, where `rays` was moved to `poses`. Runs on all
  /// cores.
  void trace(const SceneRays& rays, std::span<const Pose> poses, int count);
  /// L_k [objects] of the next bounce. Runs on all cores.
  std::vector<TermLight> bounce(std::span<const TermLight> light);

 private:
  /// What stays as it is when an object moves.
  struct Surface {
    std::vector<Eigen::Vector3f> start;      // [vertices], of rays
    std::vector<std::uint8_t> pattern;       // [vertices]
    std::vector<std::uint32_t> near, first;  // itself and neighbours; [vertices + 1] into near
    std::vector<float> h;                    // glossy: [places of the table × padded K]
    /// Glossy: [near × rays]; weights are cosine ∕ sum of the cosines of all vertices that may have cast it.
    std::vector<RayShare> shares;
  };
  /// A hit on a glossy object: what it sends depends on the direction.
  struct GlossyHit {
    std::uint32_t object, vertex;
  };
  /// Those of some vertices' rays.
  struct GlossyHits {
    std::vector<GlossyHit> hits;
    std::vector<float> g;     // colour · g_k, RGB
    std::uint32_t first = 0;  // in sent_
  };
  struct Batch {
    std::uint32_t object, first, end;  // vertices
  };

  void set_directions(int count);
  void set_shares(std::size_t object);
  void trace(const Batch& batch, const SceneRays& rays, std::span<const Pose> poses, GlossyHits& glossy);
  void send(std::span<const TermLight> light);
  void receive_diffuse(std::size_t object, TermLight& light) const;
  void receive_glossy(std::size_t object, TermLight& light) const;
  std::span<const std::uint32_t> near(const Surface& surface, std::size_t v) const {
    return std::span(surface.near).subspan(surface.first[v], surface.first[v + 1] - surface.first[v]);
  }

  const DynamicScene& scene_;
  std::span<const ObjectTransport> transport_;
  std::vector<Surface> surfaces_;            // [objects]
  std::vector<std::uint32_t> first_vertex_;  // [objects + 1], of all
  std::vector<Batch> batches_;
  std::size_t count_ = 0;                    // rays of a vertex
  std::vector<Eigen::Vector3f> directions_;  // [patterns × count], local
  std::vector<std::uint32_t> seen_;          // [all vertices × count], where in sent_
  std::vector<float> nearness_;              // [all vertices], mean of 1 ∕ distance of what they see
  std::vector<GlossyHits> glossy_;           // [batches]
  /// Radiance that leaves diffuse vertices; nothing; then what glossy hits send.
  std::vector<Eigen::Vector4f> sent_;
};

/// Light in a scene whose objects and area lights move: direct light from area lights, then bounce after
/// bounce, by rays from vertices (GatheredLight), or, where objects have fields, each as an area light for
/// all others and for itself (Iwasaki et al., sections 3 and 4).
class DynamicLight {
 public:
  /// All must outlive it; `rays` and `transport` [objects].
  DynamicLight(const DynamicScene& scene, std::span<const prt::MeshRays> rays,
               std::span<const ObjectTransport> transport);

  /// Seconds of a frame's parts.
  struct Times {
    double direct = 0.0;  ///< from the area lights
    double place = 0.0;   ///< where objects are to one another, who hides whom
    double bounces = 0.0;
    double shade = 0.0;  ///< radiance to the eye
  };

  /// `area lights`: a mesh whose colours are radiance.
  void solve(std::span<const Pose> poses, const Mesh& area_lights, const Eigen::Vector3f& eye,
             const FrameOptions& options);

  /// Bounces that the last solve() made.
  int bounces() const { return static_cast<int>(light_.size()) - 1; }
  /// Radiance of all vertices, object after object, towards the eye, of bounces [first, last]; 0 is what
  /// area lights light. Never negative.
  std::vector<Eigen::Array3f> radiance(int first, int last);
  const Times& times() const { return times_; }

 private:
  void light_directly(const Mesh& area_lights);
  void place();
  void find_used_points(std::size_t source);
  std::vector<TermLight> bounce(std::span<const TermLight> light);

  const DynamicScene& scene_;
  std::span<const ObjectTransport> transport_;
  SceneRays rays_;
  HarmonicProduct product_;
  FieldLight fields_;
  std::optional<GatheredLight> gathered_;  // where objects have no fields
  FrameOptions options_;
  Eigen::Vector3f eye_ = Eigen::Vector3f::Zero();
  std::vector<std::vector<Eigen::Array3f>> direct_to_eye_;  // [objects]
  std::vector<Pose> poses_;
  std::vector<PlacedObject> placed_;
  std::vector<PairTransport> pairs_;              // [targets × sources]
  std::vector<std::vector<TermLight>> light_;     // [bounces + 1][objects]
  std::vector<Eigen::MatrixXf> radiance_;         // [objects], [3 n² × points of the grid], those in use
  std::vector<std::vector<std::uint32_t>> used_;  // [objects], points of the grid
  Times times_;
};

}  // namespace refield::dynamic
