// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/area_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>

#include "simulate/prt/hammersley.h"

namespace refield::dynamic {

namespace {

/// Lamps are known by so many samples of equal power, and by as many for each point.
constexpr std::size_t least_samples = 2048, least_samples_a_point = 32;

struct LampSample {
  AreaPoint at;
  std::uint32_t lamp;
};

/// Which lamp a vertex belongs to, named by one of its vertices: triangles that share one are of one lamp.
std::vector<std::uint32_t> lamps_of_vertices(const Mesh& lamps) {
  std::vector<std::uint32_t> parent(lamps.positions.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& triangle : lamps.triangles)
    for (const std::uint32_t v : triangle) parent[root(v)] = root(triangle[0]);
  for (std::uint32_t v = 0; v < parent.size(); ++v) parent[v] = root(v);
  return parent;
}

/// Samples of equal power in the order of the triangles, each standing for `power` of area times brightness.
std::vector<LampSample> draw_samples(const Mesh& lamps, const std::vector<std::uint32_t>& lamp_of,
                                     std::size_t count) {
  struct Piece {
    Eigen::Vector3f doubled;  // normal times twice the area
    double power;             // area × mean radiance of all channels
  };
  std::vector<Piece> pieces;
  double all = 0.0;
  for (const auto& [a, b, c] : lamps.triangles) {
    const Eigen::Vector3f side = lamps.positions[b] - lamps.positions[a];
    const Eigen::Vector3f doubled = side.cross(lamps.positions[c] - lamps.positions[a]);
    const Eigen::Array3f radiance = (lamps.colours[a] + lamps.colours[b] + lamps.colours[c]) / 3.0f;
    pieces.push_back({doubled, 0.5 * doubled.norm() * radiance.mean()});
    all += pieces.back().power;
  }
  std::vector<LampSample> samples;
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
    const auto [a, b, c] = lamps.triangles[t];
    const float share_a = 1.0f - share_b - share_c;
    const Eigen::Array3f radiance =
        share_a * lamps.colours[a] + share_b * lamps.colours[b] + share_c * lamps.colours[c];
    const Piece& piece = pieces[t];
    const auto area =
        static_cast<float>(0.5 * piece.doubled.norm() / piece.power * all / static_cast<double>(count));
    samples.push_back(
        {{share_a * lamps.positions[a] + share_b * lamps.positions[b] + share_c * lamps.positions[c],
          piece.doubled.normalized(), radiance * area, area},
         lamp_of[a]});
  }
  return samples;
}

/// Axes that go with a lamp however it moves: along its first side, across in the plane, and up from it.
Eigen::Matrix3f axes_of(const Mesh& lamps, std::uint32_t lamp, const std::vector<std::uint32_t>& lamp_of) {
  for (const auto& [a, b, c] : lamps.triangles) {
    if (lamp_of[a] != lamp) continue;
    const Eigen::Vector3f side = lamps.positions[b] - lamps.positions[a];
    const Eigen::Vector3f normal = side.cross(lamps.positions[c] - lamps.positions[a]);
    if (!(normal.norm() > 0.0f)) continue;
    Eigen::Matrix3f axes;
    axes << side.normalized().transpose(), normal.cross(side).normalized().transpose(),
        normal.normalized().transpose();
    return axes;
  }
  return Eigen::Matrix3f::Identity();
}

/// The middle of some samples, with all of their power.
AreaPoint middle_of(std::span<const LampSample> samples) {
  AreaPoint middle{Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Array3f::Zero(), 0.0f};
  for (const LampSample& sample : samples) {
    middle.position += sample.at.position / static_cast<float>(samples.size());
    middle.normal += sample.at.normal;
    middle.power += sample.at.power;
    middle.area += sample.at.area;
  }
  // Of a closed surface the normals' sum tells nothing.
  const float length = middle.normal.norm();
  middle.normal = length > 0.1f * static_cast<float>(samples.size()) ? Eigen::Vector3f(middle.normal / length)
                                                                     : samples.front().at.normal;
  return middle;
}

/// Halves the samples across where they reach farthest until each part is one point's.
void part_into_points(std::span<LampSample> samples, std::size_t count, const Eigen::Matrix3f& axes,
                      std::vector<AreaPoint>& points) {
  if (count == 1) return points.push_back(middle_of(samples));
  Eigen::AlignedBox3f box;
  for (const LampSample& sample : samples) box.extend(Eigen::Vector3f(axes * sample.at.position));
  const Eigen::Vector3f reach = box.sizes();
  constexpr float clearly = 1.01f;  // else rounding would choose between equal sides, and points would jump
  int longest = 0;
  for (int axis = 1; axis < 3; ++axis)
    if (reach[axis] > clearly * reach[longest]) longest = axis;
  const std::size_t first = count / 2;
  const auto cut = samples.begin() + static_cast<std::ptrdiff_t>(samples.size() * first / count);
  std::nth_element(samples.begin(), cut, samples.end(), [&](const LampSample& a, const LampSample& b) {
    return axes.row(longest).dot(a.at.position) < axes.row(longest).dot(b.at.position);
  });
  part_into_points({samples.begin(), cut}, first, axes, points);
  part_into_points({cut, samples.end()}, count - first, axes, points);
}

}  // namespace

std::vector<AreaPoint> area_points(const Mesh& lamps, int count) {
  const std::vector<std::uint32_t> lamp_of = lamps_of_vertices(lamps);
  const std::size_t samples_a_point =
      std::max(least_samples_a_point, least_samples / static_cast<std::size_t>(count));
  std::vector<LampSample> samples =
      draw_samples(lamps, lamp_of, static_cast<std::size_t>(count) * samples_a_point);
  std::vector<AreaPoint> points;
  for (std::size_t begin = 0, end = 0; begin < samples.size(); begin = end) {
    while (end < samples.size() && samples[end].lamp == samples[begin].lamp) ++end;
    // Whole points alone: what one lamp loses by rounding another one gains.
    const auto whole = [=](std::size_t sample) { return (sample + samples_a_point / 2) / samples_a_point; };
    const std::size_t own = whole(end) - whole(begin);
    if (own == 0) continue;
    const std::size_t before = points.size();
    part_into_points(std::span(samples).subspan(begin, end - begin), own,
                     axes_of(lamps, samples[begin].lamp, lamp_of), points);
    const float share = static_cast<float>(own * samples_a_point) / static_cast<float>(end - begin);
    for (std::size_t p = before; p < points.size(); ++p) {
      points[p].power *= share;
      points[p].area *= share;
    }
  }
  return points;
}

}  // namespace refield::dynamic
