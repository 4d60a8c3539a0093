// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/point_lights.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>

#include "core/base/run_context.h"
#include "simulate/dynamic/brdf.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic {

namespace {

/// Area lights are known by that many samples of equal power, and by as many for each point.
constexpr std::size_t least_samples = 2048, least_samples_a_point = 32;

struct AreaLightSample {
  AreaPoint at;
  std::uint32_t area_light;
};

/// Which area light a vertex belongs to, named by one of its vertices: triangles that share one are of one
/// area light.
std::vector<std::uint32_t> area_lights_of_vertices(const Mesh& area_lights) {
  std::vector<std::uint32_t> parent(area_lights.positions.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& triangle : area_lights.triangles)
    for (const std::uint32_t v : triangle) parent[root(v)] = root(triangle[0]);
  for (std::uint32_t v = 0; v < parent.size(); ++v) parent[v] = root(v);
  return parent;
}

/// Samples of equal power in the order of the triangles, each standing for `power` of area times brightness.
std::vector<AreaLightSample> draw_samples(const Mesh& area_lights,
                                          const std::vector<std::uint32_t>& area_light_of,
                                          std::size_t count) {
  struct Piece {
    Eigen::Vector3f doubled;  // normal times twice the area
    double power;             // area × mean radiance of all channels
  };
  std::vector<Piece> pieces;
  double all = 0.0;
  for (const auto& [a, b, c] : area_lights.triangles) {
    const Eigen::Vector3f side = area_lights.positions[b] - area_lights.positions[a];
    const Eigen::Vector3f doubled = side.cross(area_lights.positions[c] - area_lights.positions[a]);
    const Eigen::Array3f radiance =
        (area_lights.colours[a] + area_lights.colours[b] + area_lights.colours[c]) / 3.0f;
    pieces.push_back({doubled, 0.5 * doubled.norm() * radiance.mean()});
    all += pieces.back().power;
  }
  std::vector<AreaLightSample> samples;
  if (!(all > 0.0)) return samples;
  double before = 0.0;
  std::uint32_t in_triangle = 0;
  std::size_t t = 0;
  for (std::size_t j = 0; j < count; ++j) {
    const double at = (static_cast<double>(j) + 0.5) / static_cast<double>(count) * all;
    while (t + 1 < pieces.size() && before + pieces[t].power < at) {
      before += pieces[t++].power;
      in_triangle = 0;
    }
    // Evenly along one side, by reversed digits along the other: few samples still cover a triangle.
    const double u = std::sqrt(std::clamp((at - before) / pieces[t].power, 0.0, 1.0));
    const double v = prt::radical_inverse(++in_triangle);
    const auto share_b = static_cast<float>(u * (1.0 - v)), share_c = static_cast<float>(u * v);
    const auto [a, b, c] = area_lights.triangles[t];
    const float share_a = 1.0f - share_b - share_c;
    const Eigen::Array3f radiance = share_a * area_lights.colours[a] + share_b * area_lights.colours[b] +
                                    share_c * area_lights.colours[c];
    const Piece& piece = pieces[t];
    const auto area =
        static_cast<float>(0.5 * piece.doubled.norm() / piece.power * all / static_cast<double>(count));
    samples.push_back({{share_a * area_lights.positions[a] + share_b * area_lights.positions[b] +
                            share_c * area_lights.positions[c],
                        piece.doubled.normalized(), radiance * area, area},
                       area_light_of[a]});
  }
  return samples;
}

/// Axes that go with an area light however it moves: along its first side, across in the plane, and up from
/// it.
Eigen::Matrix3f axes_of(const Mesh& area_lights, std::uint32_t area_light,
                        const std::vector<std::uint32_t>& area_light_of) {
  for (const auto& [a, b, c] : area_lights.triangles) {
    if (area_light_of[a] != area_light) continue;
    const Eigen::Vector3f side = area_lights.positions[b] - area_lights.positions[a];
    const Eigen::Vector3f normal = side.cross(area_lights.positions[c] - area_lights.positions[a]);
    if (!(normal.norm() > 0.0f)) continue;
    Eigen::Matrix3f axes;
    axes << side.normalized().transpose(), normal.cross(side).normalized().transpose(),
        normal.normalized().transpose();
    return axes;
  }
  return Eigen::Matrix3f::Identity();
}

/// The middle of some samples, with all of their power.
AreaPoint middle_of(std::span<const AreaLightSample> samples) {
  AreaPoint middle{Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Array3f::Zero(), 0.0f};
  for (const AreaLightSample& sample : samples) {
    middle.position += sample.at.position / static_cast<float>(samples.size());
    middle.normal += sample.at.normal;
    middle.power += sample.at.power;
    middle.area += sample.at.area;
  }
  // The sum of a closed surface's normals says nothing.
  const float length = middle.normal.norm();
  middle.normal = length > 0.1f * static_cast<float>(samples.size()) ? Eigen::Vector3f(middle.normal / length)
                                                                     : samples.front().at.normal;
  return middle;
}

/// Halves the samples across where they reach farthest until each part is one point's.
void part_into_points(std::span<AreaLightSample> samples, std::size_t count, const Eigen::Matrix3f& axes,
                      std::vector<AreaPoint>& points) {
  if (count == 1) return points.push_back(middle_of(samples));
  Eigen::AlignedBox3f box;
  for (const AreaLightSample& sample : samples) box.extend(Eigen::Vector3f(axes * sample.at.position));
  const Eigen::Vector3f reach = box.sizes();
  constexpr float clearly = 1.01f;  // else rounding would choose between equal sides, and points would jump
  int longest = 0;
  for (int axis = 1; axis < 3; ++axis)
    if (reach[axis] > clearly * reach[longest]) longest = axis;
  const std::size_t first = count / 2;
  const auto cut = samples.begin() + static_cast<std::ptrdiff_t>(samples.size() * first / count);
  std::nth_element(samples.begin(), cut, samples.end(),
                   [&](const AreaLightSample& a, const AreaLightSample& b) {
                     return axes.row(longest).dot(a.at.position) < axes.row(longest).dot(b.at.position);
                   });
  part_into_points({samples.begin(), cut}, first, axes, points);
  part_into_points({cut, samples.end()}, count - first, axes, points);
}

}  // namespace

std::vector<AreaPoint> area_points(const Mesh& area_lights, int count) {
  const std::vector<std::uint32_t> area_light_of = area_lights_of_vertices(area_lights);
  const std::size_t samples_a_point =
      std::max(least_samples_a_point, least_samples / static_cast<std::size_t>(count));
  std::vector<AreaLightSample> samples =
      draw_samples(area_lights, area_light_of, static_cast<std::size_t>(count) * samples_a_point);
  std::vector<AreaPoint> points;
  for (std::size_t begin = 0, end = 0; begin < samples.size(); begin = end) {
    while (end < samples.size() && samples[end].area_light == samples[begin].area_light) ++end;
    // Whole points alone: what one area light loses by rounding another one gains.
    const auto whole = [=](std::size_t sample) { return (sample + samples_a_point / 2) / samples_a_point; };
    const std::size_t points_here = whole(end) - whole(begin);
    if (points_here == 0) continue;
    const std::size_t before = points.size();
    part_into_points(std::span(samples).subspan(begin, end - begin), points_here,
                     axes_of(area_lights, samples[begin].area_light, area_light_of), points);
    const float share = static_cast<float>(points_here * samples_a_point) / static_cast<float>(end - begin);
    for (std::size_t p = before; p < points.size(); ++p) {
      points[p].power *= share;
      points[p].area *= share;
    }
  }
  return points;
}

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
