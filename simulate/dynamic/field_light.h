// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "simulate/dynamic/area_points.h"
#include "simulate/dynamic/direct_light.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/harmonic_product.h"
#include "simulate/dynamic/placed_object.h"
#include "simulate/dynamic/zonal.h"

namespace refield::dynamic {

/// What an occlusion field, n² harmonics of what an object covers, says of a lamp behind the object.
///  - product: the light of all lamp points behind it times what is left, by products of harmonics (Zhou et
///    al. 2005, section 4): blurred twice, and what is small hides hardly anything
///  - edge: each point of a lamp is a small disc, and as much of it is hidden as lies within the edge that
///    CapEdges finds
enum class FieldShadow { product, edge };

/// Direct light without rays, from what is computed once for each object (Zhou et al. 2005, "Precomputed
/// Shadow Fields for Dynamic Scenes"; Iwasaki et al., section 3). Other objects' shadows come of their
/// occlusion fields, an object's own of ObjectTransport::receiving. An object hides a point of a lamp only if
/// the line to it meets the object's bounding box, so that nothing hides what stands before it.
///
/// Blurred to n² harmonics light would be far too even. So they tell shares alone: L_k are scaled so that the
/// first is right where nothing hides, and radiance to the eye is that of the material itself times the share
/// that is left of the first term. Nothing is negative, and all is finite wherever objects and lamps stand.
class FieldLight {
 public:
  /// Both must outlive it.
  FieldLight(const DynamicScene& scene, std::span<const ObjectTransport> transport);

  /// As direct_light(), for the vertices of objects[target]. `objects`: all of the scene. Runs on all cores.
  DirectLight direct(std::span<const PlacedObject> objects, std::size_t target,
                     std::span<const AreaPoint> lamps, const Eigen::Vector3f& eye, FieldShadow shadow,
                     const HarmonicProduct& product) const;

 private:
  const DynamicScene& scene_;
  std::vector<Eigen::Array3f> half_size_;  // [objects], of the bounding boxes
  std::vector<FirstTerm> first_;           // [objects]
  CapEdges edges_;
};

}  // namespace refield::dynamic
