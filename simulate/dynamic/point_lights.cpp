// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/point_lights.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/run_context.h"
#include "simulate/dynamic/tangent_frame.h"
#include "simulate/prt/hammersley.h"

namespace refield::dynamic {

namespace {

constexpr float flat_cosine = 0.9999f, flat_share = 1e-4f;

/// Evenly over a square of 2×2 about the origin, [count].
std::vector<Eigen::Vector2f> square_points(int count) {
  const int side = std::max(1, static_cast<int>(std::lround(std::sqrt(count))));
  std::vector<Eigen::Vector2f> points;
  for (int j = 0; j < side; ++j)
    for (int i = 0; i < side; ++i)
      points.push_back(
          Eigen::Vector2f(static_cast<float>(2 * i + 1 - side), static_cast<float>(2 * j + 1 - side)) /
          static_cast<float>(side));
  return points;
}

/// Vertices that face a light, up to a packet of them, on their way to be asked for.
class Facing {
 public:
  Facing(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
         const Eigen::Vector3f& light, float* terms)
      : mesh_(mesh),
        rays_(rays),
        factors_(factors),
        light_(light),
        terms_(terms),
        h_(static_cast<std::size_t>(factors.terms())) {}

  void add(std::size_t vertex) {
    const Eigen::Vector3f way = light_ - mesh_.positions[vertex];
    if (way.dot(mesh_.normals[vertex]) <= 0.0f) return;
    from_[count_] = rays_.off_surface(mesh_.positions[vertex], mesh_.normals[vertex]);
    distance_[count_] = way.norm();
    towards_[count_] = way / distance_[count_];
    vertex_[count_++] = vertex;
    if (count_ == prt::MeshRays::packet) flush();
  }

  void flush() {
    const std::uint32_t seen =
        rays_.unoccluded(std::span(from_).first(count_), std::span(towards_).first(count_),
                         std::span(distance_).first(count_));
    for (std::size_t i = 0; i < count_; ++i) {
      if ((seen >> i & 1u) == 0) continue;
      const Eigen::Vector3f local = tangent_frame(mesh_.normals[vertex_[i]]) * towards_[i];
      factors_.incoming(local, h_);
      const float irradiance = local.z() / (distance_[i] * distance_[i]);
      for (std::size_t k = 0; k < h_.size(); ++k) terms_[vertex_[i] * h_.size() + k] = h_[k] * irradiance;
    }
    count_ = 0;
  }

 private:
  const Mesh& mesh_;
  const prt::MeshRays& rays_;
  const BrdfFactors& factors_;
  const Eigen::Vector3f light_;
  float* terms_;
  std::vector<float> h_;
  std::array<Eigen::Vector3f, prt::MeshRays::packet> from_, towards_;
  std::array<float, prt::MeshRays::packet> distance_{};
  std::array<std::size_t, prt::MeshRays::packet> vertex_{};
  std::size_t count_ = 0;
};

}  // namespace

BoundingBall bounding_ball(const Mesh& mesh) {
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  BoundingBall ball{bounds.center(), 0.0f};
  for (const auto& position : mesh.positions)
    ball.radius = std::max(ball.radius, (position - ball.middle).norm());
  return ball;
}

Eigen::VectorXf vertex_areas(const Mesh& mesh) {
  Eigen::VectorXf areas = Eigen::VectorXf::Zero(static_cast<Eigen::Index>(mesh.positions.size()));
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3f a = mesh.positions[triangle[1]] - mesh.positions[triangle[0]];
    const Eigen::Vector3f b = mesh.positions[triangle[2]] - mesh.positions[triangle[0]];
    for (const std::uint32_t vertex : triangle) areas[vertex] += a.cross(b).norm() / 6.0f;
  }
  return areas;
}

std::optional<Eigen::Vector3f> facing_of(const Mesh& mesh) {
  if (mesh.empty()) return std::nullopt;
  const Eigen::Vector3f facing = mesh.normals.front();
  const BoundingBall ball = bounding_ball(mesh);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    if (mesh.normals[v].dot(facing) < flat_cosine ||
        std::abs((mesh.positions[v] - ball.middle).dot(facing)) > flat_share * ball.radius)
      return std::nullopt;
  return facing;
}

std::vector<Eigen::Vector3f> point_lights(const Mesh& mesh, int count, std::span<const float> distances) {
  const BoundingBall ball = bounding_ball(mesh);
  const auto facing = facing_of(mesh);
  std::vector<Eigen::Vector3f> lights;
  for (const float distance : distances) {
    if (facing) {
      const Eigen::Matrix3f frame = tangent_frame(*facing);
      for (const Eigen::Vector2f& point : square_points(count))
        lights.push_back(ball.middle +
                         ball.radius *
                             (frame.transpose() * Eigen::Vector3f(point.x(), point.y(), distance - 1.0f)));
    } else {
      for (const auto& direction : prt::hammersley_sphere(count))
        lights.push_back(ball.middle + distance * ball.radius * direction.cast<float>());
    }
  }
  return lights;
}

Eigen::MatrixXf light_terms(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                            std::span<const Eigen::Vector3f> lights, const RunContext& run) {
  const std::size_t rows = mesh.positions.size() * static_cast<std::size_t>(factors.terms());
  Eigen::MatrixXf terms =
      Eigen::MatrixXf::Zero(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(lights.size()));
  Progress progress(run, "light on a surface", lights.size());
  tbb::parallel_for(std::size_t{0}, lights.size(), [&](std::size_t l) {
    run.throw_if_stopped();
    Facing facing(mesh, rays, factors, lights[l], terms.col(static_cast<Eigen::Index>(l)).data());
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) facing.add(v);
    facing.flush();
    progress.advance();
  });
  return terms;
}

}  // namespace refield::dynamic
