// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "simulate/dynamic/direct_light.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/field_light.h"
#include "simulate/dynamic/gathered_light.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

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
