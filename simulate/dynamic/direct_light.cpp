// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <tbb/parallel_for.h>

#include <numeric>

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

constexpr std::size_t packet = prt::ray_packet;
/// Rays start off their surface and end before the area light by so much of their length.
constexpr float ray_start = 1e-3f, ray_end = 1.0f - 1e-3f;

/// Up to 16 vertices of which rays go to one area light at a time.
class Batch {
 public:
  Batch(const MovingObject& object, const Pose& pose, const Eigen::Vector3f& eye, std::size_t first)
      : brdf_(object.brdf), first_(first), count_(std::min(packet, object.mesh.positions.size() - first)) {
    for (std::size_t i = 0; i < count_; ++i) {
      at_[i] = pose * object.mesh.positions[first + i];
      frame_[i] = tangent_frame(object.mesh.normals[first + i]) * pose.linear().transpose();
      to_eye_[i] = frame_[i] * (eye - at_[i]).normalized();
    }
  }

  void add(const AreaPoint& area_light, const BrdfFactors& factors, const SceneRays& rays, std::span<float> h,
           DirectLight& light) const {
    std::array<Eigen::Vector3f, packet> from, way, local;
    std::array<float, packet> end;
    std::array<std::size_t, packet> of;
    std::size_t count = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      way[count] = area_light.position - at_[i];
      local[count] = frame_[i] * way[count];
      if (local[count].z() <= 0.0f) continue;
      from[count] = at_[i] + ray_start * way[count];
      end[count] = ray_end - ray_start;
      of[count++] = i;
    }
    if (count == 0) return;
    const std::uint32_t free = rays.unoccluded(std::span(from).first(count), way, end);
    for (std::size_t i = 0; i < count; ++i) {
      if (!((free >> i) & 1u)) continue;
      const float squared = way[i].squaredNorm(), distance = std::sqrt(squared);
      const Eigen::Vector3f towards = local[i] / distance;
      factors.incoming(towards, h);
      const float cosine = std::abs(area_light.normal.dot(way[i])) / distance * towards.z();
      const Eigen::Array3f arriving = area_light.power * (cosine / std::max(squared, area_light.area));
      for (std::size_t k = 0; k < h.size(); ++k)
        light.terms.row(static_cast<Eigen::Index>((first_ + of[i]) * h.size() + k)) +=
            h[k] * arriving.matrix().transpose();
      light.to_eye[first_ + of[i]] += brdf_(towards, to_eye_[of[i]]) * arriving;
    }
  }

 private:
  const Brdf& brdf_;
  std::size_t first_, count_;
  std::array<Eigen::Vector3f, packet> at_, to_eye_;
  std::array<Eigen::Matrix3f, packet> frame_;
};

}  // namespace

DirectLight direct_light(const MovingObject& object, const Pose& pose, const BrdfFactors& factors,
                         const SceneRays& rays, std::span<const AreaPoint> area_lights,
                         const Eigen::Vector3f& eye) {
  const auto terms = static_cast<std::size_t>(factors.terms());
  const std::size_t vertices = object.mesh.positions.size();
  DirectLight light{TermLight::Zero(static_cast<Eigen::Index>(vertices * terms), 3),
                    std::vector<Eigen::Array3f>(vertices, Eigen::Array3f::Zero())};
  tbb::parallel_for(std::size_t{0}, (vertices + packet - 1) / packet, [&](std::size_t b) {
    std::vector<float> h(terms);
    const Batch batch(object, pose, eye, b * packet);
    for (const AreaPoint& area_light : area_lights) batch.add(area_light, factors, rays, h, light);
  });
  return light;
}

}  // namespace refield::dynamic
