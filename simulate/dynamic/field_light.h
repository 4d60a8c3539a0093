// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/direct_light.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

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

}  // namespace refield::dynamic
