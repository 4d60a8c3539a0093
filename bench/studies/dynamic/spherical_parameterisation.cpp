// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/spherical_parameterisation.h"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "cli/run_context.h"
#include "core/base/run_context.h"

namespace refield::dynamic {

namespace {

using Places = std::vector<Eigen::Vector3d>;
using Corners = std::array<std::uint32_t, 3>;

/// Vertices at one position are one point.
struct Joined {
  std::vector<std::uint32_t> point;  // [vertices]
  Places positions;                  // [points]
  std::vector<Corners> triangles;    // of points
};

Joined join(const Mesh& mesh) {
  Joined joined;
  std::map<std::array<float, 3>, std::uint32_t> known;
  for (const auto& position : mesh.positions) {
    const auto [found, is_new] = known.emplace(std::array{position.x(), position.y(), position.z()},
                                               static_cast<std::uint32_t>(joined.positions.size()));
    if (is_new) joined.positions.push_back(position.cast<double>());
    joined.point.push_back(found->second);
  }
  for (const auto& [a, b, c] : mesh.triangles)
    joined.triangles.push_back({joined.point[a], joined.point[b], joined.point[c]});
  return joined;
}

double folded_share_of(const std::vector<Corners>& triangles, const Places& places) {
  const auto folded = std::ranges::count_if(triangles, [&](const Corners& t) {
    return (places[t[1]] - places[t[0]]).cross(places[t[2]] - places[t[0]]).dot(places[t[0]]) <= 0.0;
  });
  return static_cast<double>(folded) / static_cast<double>(std::max<std::size_t>(triangles.size(), 1));
}

Eigen::Vector3d unit_or(const Eigen::Vector3d& vector, const Eigen::Vector3d& otherwise) {
  const double norm = vector.norm();
  return norm > 1e-12 ? Eigen::Vector3d(vector / norm) : otherwise;
}

/// Moves all to the middle of their neighbours, then keeps the whole about the origin: without that, all
/// would end in one point.
void relax(const Joined& joined, Places& places) {
  Places sums(places.size(), Eigen::Vector3d::Zero());
  for (const Corners& t : joined.triangles)
    for (std::size_t corner = 0; corner < 3; ++corner) sums[t[corner]] += places[t[(corner + 1) % 3]];
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (std::size_t p = 0; p < places.size(); ++p) {
    places[p] = unit_or(places[p] + unit_or(sums[p], places[p]), places[p]);  // half way: sweeps do not swing
    middle += places[p] / static_cast<double>(places.size());
  }
  for (auto& place : places) place = unit_or(place - middle, place);
}

struct Unfolded {
  Places places;
  double folded;
};

/// The least folded state met, from sweep `least` on if there is one.
Unfolded relaxed(const Joined& joined, Places places, int least, int sweeps) {
  constexpr int between_checks = 16;
  Progress progress(run_context(), "unfolding a mesh, at most", static_cast<std::uint64_t>(sweeps));
  Unfolded best{places, folded_share_of(joined.triangles, places)};
  for (int sweep = 0; sweep < sweeps && (best.folded > 0.0 || sweep < least); ++sweep) {
    relax(joined, places);
    progress.advance();
    if (sweep % between_checks != 0) continue;
    run_context().throw_if_stopped();
    if (const double folded = folded_share_of(joined.triangles, places); folded <= best.folded)
      best = {places, folded};
  }
  return best;
}

Places directions_from_middle(const Joined& joined) {
  Eigen::AlignedBox3d bounds;
  for (const auto& position : joined.positions) bounds.extend(position);
  Places places;
  for (const auto& position : joined.positions)
    places.push_back(unit_or(position - bounds.center(), Eigen::Vector3d::UnitY()));
  return places;
}

/// Every point but the first triangle's in the middle of its neighbours, [points × 2]; none where parts do
/// not hang together.
std::optional<Eigen::MatrixX2d> plane_drawing(const Joined& joined) {
  const auto points = static_cast<Eigen::Index>(joined.positions.size());
  const auto& frame = joined.triangles.front();
  const auto in_frame = [&](std::uint32_t point) { return std::ranges::find(frame, point) != frame.end(); };
  Eigen::MatrixX2d right = Eigen::MatrixX2d::Zero(points, 2);
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t corner = 0; corner < 3; ++corner) {
    const double angle = 2.0 * std::numbers::pi * static_cast<double>(corner) / 3.0;
    right.row(frame[corner]) << std::cos(angle), std::sin(angle);
    entries.emplace_back(frame[corner], frame[corner], 1.0);
  }
  const Eigen::MatrixX2d corners = right;
  for (const Corners& t : joined.triangles)
    for (std::size_t corner = 0; corner < 3; ++corner)
      for (const std::uint32_t other : {t[(corner + 1) % 3], t[(corner + 2) % 3]}) {
        const std::uint32_t point = t[corner];
        if (in_frame(point)) continue;
        entries.emplace_back(point, point, 1.0);
        if (in_frame(other))
          right.row(point) += corners.row(other);
        else
          entries.emplace_back(point, other, -1.0);
      }
  Eigen::SparseMatrix<double> matrix(points, points);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
  if (solver.info() != Eigen::Success) return std::nullopt;
  const Eigen::MatrixX2d drawing = solver.solve(right);
  if (!drawing.allFinite()) return std::nullopt;
  return drawing;
}

/// The plane around the sphere (stereographic), half of the points on each side of the equator.
Places around_sphere(const Eigen::MatrixX2d& drawing) {
  const Eigen::MatrixX2d centred = drawing.rowwise() - drawing.colwise().mean();
  std::vector<double> radii;
  for (Eigen::Index p = 0; p < centred.rows(); ++p) radii.push_back(centred.row(p).norm());
  const auto middle = radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2);
  std::ranges::nth_element(radii, middle);
  const double scale = *middle > 0.0 ? 1.0 / *middle : 1.0;
  Places places;
  for (Eigen::Index p = 0; p < centred.rows(); ++p) {
    const Eigen::Vector2d at = centred.row(p).transpose() * scale;
    const double squared = at.squaredNorm();
    places.push_back(Eigen::Vector3d(2.0 * at.x(), 2.0 * at.y(), squared - 1.0) / (squared + 1.0));
  }
  return places;
}

}  // namespace

double folded_share(const Mesh& mesh, const Places& places) {
  return folded_share_of(mesh.triangles, places);
}

Places spherical_parameterisation(const Mesh& mesh, int sweeps) {
  const Joined joined = join(mesh);
  Unfolded best = relaxed(joined, directions_from_middle(joined), 0, sweeps);
  constexpr int sweeps_of_drawings = 500;  // they are unfolded, but crowd together
  const auto drawing = best.folded > 0.0 && sweeps > 0 ? plane_drawing(joined) : std::nullopt;
  if (drawing) {
    Places places = around_sphere(*drawing);
    if (folded_share_of(joined.triangles, places) > 0.5)
      for (auto& place : places) place.x() = -place.x();
    Unfolded drawn = relaxed(joined, places, sweeps_of_drawings, sweeps);
    if (drawn.folded < best.folded) best = std::move(drawn);
  }
  Places all;
  for (const std::uint32_t point : joined.point) all.push_back(best.places[point]);
  return all;
}

}  // namespace refield::dynamic
