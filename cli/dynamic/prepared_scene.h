// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "simulate/dynamic/dynamic_light.h"

namespace refield::cli {

/// A moving scene with its precomputed transport.
class PreparedScene {
 public:
  /// Throws Interrupted.
  PreparedScene(dynamic::DynamicScene scene, const dynamic::TransportOptions& options,
                const RunContext& run = {});

  const dynamic::DynamicScene& scene() const { return scene_; }
  const std::vector<prt::MeshRays>& rays() const { return rays_; }
  const std::vector<dynamic::ObjectTransport>& transport() const { return transport_; }
  dynamic::DynamicLight& light() { return *light_; }
  std::size_t bytes() const;

  void solve(double time, const PinholeCamera& camera, const dynamic::FrameOptions& options);
  /// The same with all in other places; `area lights`: colours are radiance.
  void solve(std::vector<dynamic::Pose> poses, Mesh area_lights, const PinholeCamera& camera,
             const dynamic::FrameOptions& options);
  /// All objects and, after them, area lights as the last solve() had them; triangles of area lights have two
  /// fronts.
  Mesh mesh() const;
  /// Of its vertices towards the camera of the last solve().
  std::vector<Eigen::Array3f> radiance(int first_bounce, int last_bounce);
  /// What the camera of the last solve() sees; area lights shine.
  Image picture(int first_bounce, int last_bounce);
  /// The same with all bounces and black area lights: what an automatic exposure is chosen for.
  Image reflected_picture();

 private:
  dynamic::DynamicScene scene_;
  std::vector<prt::MeshRays> rays_;
  std::vector<dynamic::ObjectTransport> transport_;
  std::unique_ptr<dynamic::DynamicLight> light_;
  std::vector<dynamic::Pose> poses_;
  Mesh area_lights_;
  PinholeCamera camera_;
};

/// The scene's camera, or one that sees all of it from in front.
PinholeCamera camera_of(const dynamic::DynamicScene& scene);

}  // namespace refield::cli
