// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/bounce_reference.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "core/base/rng.h"
#include "core/base/run_context.h"
#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

constexpr float pi = std::numbers::pi_v<float>;
/// Rays start and end off surfaces by so much, in lengths of the ray to an area light, or of the scene's
/// unit.
constexpr float off_area_light = 1e-3f, off_surface = 1e-4f;

/// A point that light leaves towards a viewer.
struct PathPoint {
  Eigen::Vector3f position, normal;
  Eigen::Matrix3f frame;
  Eigen::Array3f colour;
  const Brdf* brdf;
  Eigen::Vector3f to_viewer;  // local

  Eigen::Array3f reflectance(const Eigen::Vector3f& local_in) const {
    return colour * (*brdf)(local_in, to_viewer);
  }
};

PathPoint point_on(const MovingObject& object, const Pose& pose, const Eigen::Vector3f& position,
                   const Eigen::Vector3f& normal, const Eigen::Array3f& colour,
                   const Eigen::Vector3f& towards) {
  PathPoint point{pose * position, pose.linear() * normal, {}, colour, &object.brdf, {}};
  point.frame = tangent_frame(point.normal);
  point.to_viewer = point.frame * towards;
  return point;
}

PathPoint point_of(const MovingObject& object, const Pose& pose, const prt::MeshHit& hit,
                   const Eigen::Vector3f& towards) {
  Eigen::Vector3f position = Eigen::Vector3f::Zero(), normal = Eigen::Vector3f::Zero();
  Eigen::Array3f colour = Eigen::Array3f::Zero();
  for (std::size_t c = 0; c < 3; ++c) {
    const std::uint32_t corner = object.mesh.triangles[hit.triangle][c];
    position += hit.share[c] * object.mesh.positions[corner];
    normal += hit.share[c] * object.mesh.normals[corner];
    colour += hit.share[c] * object.mesh.colours[corner];
  }
  return point_on(object, pose, position, normal.normalized(), colour, towards);
}

/// A unit direction whose cosine with `axis` is drawn in proportion to its power `exponent`.
Eigen::Vector3f draw_around(const Eigen::Vector3f& axis, float exponent, Rng& rng) {
  const auto cosine = static_cast<float>(std::pow(rng.uniform(), 1.0 / (exponent + 1.0)));
  const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine));
  const auto phi = static_cast<float>(rng.uniform(0.0, 2.0 * std::numbers::pi));
  const Eigen::Vector3f side = axis.unitOrthogonal();
  return sine * std::cos(phi) * side + sine * std::sin(phi) * axis.cross(side) + cosine * axis;
}

/// Directions in proportion to the cosine and, of what shines, to a power about the mirror direction.
class Directions {
 public:
  explicit Directions(const PathPoint& point)
      : mirrored_(-point.to_viewer.x(), -point.to_viewer.y(), point.to_viewer.z()) {
    const Brdf& brdf = *point.brdf;
    if (brdf.lobe == Lobe::none) return;
    glossy_ = 0.5f;
    if (brdf.lobe == Lobe::phong) exponent_ = brdf.exponent;
    // The half vector's spread, α, is half the mirror direction's.
    if (brdf.lobe == Lobe::ggx) exponent_ = std::max(0.5f / (brdf.roughness * brdf.roughness), 1.0f);
  }
  /// Local, and its density.
  std::pair<Eigen::Vector3f, float> draw(Rng& rng) const {
    const Eigen::Vector3f direction = rng.uniform() < glossy_
                                          ? draw_around(mirrored_, exponent_, rng)
                                          : draw_around(Eigen::Vector3f::UnitZ(), 1.0f, rng);
    const float power = std::pow(std::max(mirrored_.dot(direction), 0.0f), exponent_);
    return {direction, (1.0f - glossy_) * std::max(direction.z(), 0.0f) / pi +
                           glossy_ * (exponent_ + 1.0f) / (2.0f * pi) * power};
  }

 private:
  Eigen::Vector3f mirrored_;
  float glossy_ = 0.0f, exponent_ = 1.0f;
};

Eigen::Array3f from_area_lights(const PathPoint& point, const SceneRays& rays, const AreaPoint& area_light,
                                std::size_t area_lights) {
  const Eigen::Vector3f way = area_light.position - point.position, local = point.frame * way;
  if (local.z() <= 0.0f) return Eigen::Array3f::Zero();
  const std::array from{Eigen::Vector3f(point.position + off_area_light * way)};
  const std::array end{1.0f - 2.0f * off_area_light};
  if (rays.unoccluded(from, std::span(&way, 1), end) == 0) return Eigen::Array3f::Zero();
  const float squared = way.squaredNorm(), distance = std::sqrt(squared);
  const float cosines = std::abs(area_light.normal.dot(way)) * local.z() / squared;
  return point.reflectance(local / distance) * area_light.power *
         (static_cast<float>(area_lights) * cosines / std::max(squared, area_light.area));
}

/// One of the area lights' points from the path's own part of them: all paths of a vertex together see them
/// evenly.
std::size_t own_part(int path, int paths, std::size_t area_lights, Rng& rng) {
  const std::size_t all = static_cast<std::size_t>(paths), i = static_cast<std::size_t>(path);
  const std::size_t first = i * area_lights / all, end = (i + 1) * area_lights / all;
  return first + (end > first ? static_cast<std::size_t>(rng.below(end - first)) : 0);
}

/// All paths of one start, by number of bounces.
class PathTracer {
 public:
  PathTracer(const DynamicScene& scene, const SceneRays& rays, std::span<const Pose> poses,
             const PathLight& light, const ReferenceOptions& options)
      : scene_(scene), rays_(rays), poses_(poses), light_(light), options_(options) {
    for (const MovingObject& object : scene.objects) starts_.push_back(ray_starts(object.mesh));
  }

  std::vector<Eigen::Array3d> sum(const PathStart& start, std::size_t number) const {
    const MovingObject& object = scene_.objects[start.object];
    const Mesh& mesh = object.mesh;
    const PathPoint first = point_on(object, poses_[start.object], starts_[start.object][start.vertex],
                                     mesh.normals[start.vertex], mesh.colours[start.vertex], start.to_viewer);
    std::vector<Eigen::Array3d> sum(static_cast<std::size_t>(options_.bounces) + 1, Eigen::Array3d::Zero());
    for (int path = 0; path < options_.paths; ++path) {
      Rng rng(options_.seed, number, path);
      follow(first, path, rng, sum);
    }
    return sum;
  }

 private:
  void follow(PathPoint point, int path, Rng& rng, std::vector<Eigen::Array3d>& sum) const {
    const std::size_t lights = light_.area_lights.size();
    Eigen::Array3f throughput = Eigen::Array3f::Ones();
    for (std::size_t depth = 0; depth < sum.size(); ++depth) {
      if (lights > 0) {
        const std::size_t drawn = depth == 0 ? own_part(path, options_.paths, lights, rng)
                                             : static_cast<std::size_t>(rng.below(lights));
        sum[depth] +=
            (throughput * from_area_lights(point, rays_, light_.area_lights[drawn], lights)).cast<double>();
      }
      if (depth + 1 == sum.size() && !light_.environment) break;
      const auto [local, density] = Directions(point).draw(rng);
      if (local.z() <= 0.0f || density <= 0.0f) break;
      throughput *= point.reflectance(local) * (local.z() / density);
      const Eigen::Vector3f direction = (point.frame.transpose() * local).normalized();
      const Eigen::Vector3f start = point.position + off_surface * point.normal;
      std::optional<SceneHit> hit;
      rays_.intersect({&start, 1}, {&direction, 1}, {&hit, 1});
      if (!hit && light_.environment)
        sum[depth] += (throughput * light_.environment(point.position, direction)).cast<double>();
      if (!hit || !hit->on.front) break;
      point = point_of(scene_.objects[hit->object], poses_[hit->object], hit->on, -direction);
    }
  }

  const DynamicScene& scene_;
  const SceneRays& rays_;
  std::span<const Pose> poses_;
  const PathLight& light_;
  const ReferenceOptions& options_;
  std::vector<std::vector<Eigen::Vector3f>> starts_;  // [objects][vertices]
};

}  // namespace

PathStart path_start(const DynamicScene& scene, std::span<const Pose> poses, std::uint32_t object,
                     std::uint32_t vertex, const Eigen::Vector3f& eye) {
  return {object, vertex, (eye - poses[object] * scene.objects[object].mesh.positions[vertex]).normalized()};
}

std::vector<std::vector<Eigen::Array3f>> trace_bounces(const DynamicScene& scene, const SceneRays& rays,
                                                       std::span<const Pose> poses, const PathLight& light,
                                                       std::span<const PathStart> starts,
                                                       const ReferenceOptions& options,
                                                       const RunContext& run) {
  std::vector<std::vector<Eigen::Array3f>> radiance(
      static_cast<std::size_t>(options.bounces) + 1,
      std::vector<Eigen::Array3f>(starts.size(), Eigen::Array3f::Zero()));
  if (light.area_lights.empty() && !light.environment) return radiance;
  const PathTracer tracer(scene, rays, poses, light, options);
  Progress progress(run, "paths of the reference", starts.size());
  tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
    run.throw_if_stopped();
    const std::vector<Eigen::Array3d> sum = tracer.sum(starts[i], i);
    for (std::size_t depth = 0; depth < radiance.size(); ++depth)
      radiance[depth][i] = (sum[depth] / options.paths).cast<float>();
    progress.advance();
  });
  return radiance;
}

}  // namespace refield::dynamic
