// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/area_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "simulate/prt/hammersley.h"

namespace refield::dynamic {

std::vector<AreaPoint> area_points(const Mesh& lamps, int count) {
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
  std::vector<AreaPoint> points;
  if (!(all > 0.0)) return points;
  double before = 0.0;
  std::uint32_t in_triangle = 0;
  std::size_t t = 0;
  for (int j = 0; j < count; ++j) {
    const double at = (j + 0.5) / count * all;
    while (t + 1 < pieces.size() && before + pieces[t].power < at) {
      before += pieces[t++].power;
      in_triangle = 0;
    }
    // Evenly along one side, by reversed digits along the other: few points still cover a triangle.
    const double u = std::sqrt(std::clamp((at - before) / pieces[t].power, 0.0, 1.0));
    const double v = prt::radical_inverse(++in_triangle);
    const auto share_b = static_cast<float>(u * (1.0 - v)), share_c = static_cast<float>(u * v);
    const auto [a, b, c] = lamps.triangles[t];
    const float share_a = 1.0f - share_b - share_c;
    const Eigen::Array3f radiance =
        share_a * lamps.colours[a] + share_b * lamps.colours[b] + share_c * lamps.colours[c];
    const Piece& piece = pieces[t];
    const auto area = static_cast<float>(0.5 * piece.doubled.norm() / piece.power * all / count);
    points.push_back(
        {share_a * lamps.positions[a] + share_b * lamps.positions[b] + share_c * lamps.positions[c],
         piece.doubled.normalized(), radiance * area, area});
  }
  return points;
}

}  // namespace refield::dynamic
