// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh_raster.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace refield {

namespace {

using Eigen::Vector3d;

constexpr int band_rows = 16;

/// The camera's own axes, scaled so that (x, y, 1) is the direction through the point (x, y) of the image, in
/// pixels.
class Projection {
 public:
  explicit Projection(const PinholeCamera& camera) : position_(camera.position.cast<double>()) {
    const Vector3d ahead = (camera.target - camera.position).cast<double>().normalized();
    const Vector3d right = camera.up.cast<double>().cross(ahead).normalized();
    const Vector3d above = ahead.cross(right);
    const double half = std::tan(camera.vertical_field_of_view_degrees * std::numbers::pi / 360.0);
    // A point at depth z stands at column w/2 + h/2 · X/(half z), row h/2 − h/2 · Y/(half z).
    const double scale = 0.5 * camera.height / half;
    rows_.row(0) = scale * right + 0.5 * camera.width * ahead;
    rows_.row(1) = -scale * above + 0.5 * camera.height * ahead;
    rows_.row(2) = ahead;
  }

  /// (column · depth, row · depth, depth)
  Vector3d operator()(const Eigen::Vector3f& point) const {
    return rows_ * (point.cast<double>() - position_);
  }

 private:
  Vector3d position_;
  Eigen::Matrix3d rows_;
};

/// A triangle made ready: edge functions e_i · (x, y, 1) share the sign of `volume` inside, and are in
/// proportion to the shares of its vertices.
struct Facet {
  std::array<Vector3d, 3> edge;
  double volume = 0.0;
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // pixels that it may cover, half-open
};

/// a × b, exactly the opposite of b × a whatever the compiler makes of it: so that points on an edge lie on
/// one side of it for both triangles, or on it for both.
Vector3d edge_between(std::uint32_t vertex_a, const Vector3d& a, std::uint32_t vertex_b, const Vector3d& b) {
  if (vertex_a < vertex_b) return a.cross(b);
  return -b.cross(a);
}

void limit_to_image(const std::array<Vector3d, 3>& corner, const PinholeCamera& camera, Facet& facet) {
  double left = camera.width, right = 0.0, top = camera.height, bottom = 0.0;
  for (const Vector3d& c : corner) {
    if (c.z() <= 0.0) {  // it reaches behind the camera, and so anywhere
      facet.x1 = camera.width, facet.y1 = camera.height;
      return;
    }
    left = std::min(left, c.x() / c.z()), right = std::max(right, c.x() / c.z());
    top = std::min(top, c.y() / c.z()), bottom = std::max(bottom, c.y() / c.z());
  }
  facet.x0 = static_cast<int>(std::max(0.0, left)), facet.y0 = static_cast<int>(std::max(0.0, top));
  facet.x1 = static_cast<int>(std::min<double>(camera.width, right + 1.0));
  facet.y1 = static_cast<int>(std::min<double>(camera.height, bottom + 1.0));
}

Facet facet_of(const std::array<std::uint32_t, 3>& triangle, const std::vector<Vector3d>& projected,
               const PinholeCamera& camera) {
  Facet facet;
  const std::array corner{projected[triangle[0]], projected[triangle[1]], projected[triangle[2]]};
  if (std::ranges::all_of(corner, [](const Vector3d& c) { return c.z() <= 0.0; })) return facet;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    facet.edge[i] = edge_between(triangle[j], corner[j], triangle[k], corner[k]);
  }
  facet.volume = corner[0].dot(facet.edge[0]);
  if (facet.volume != 0.0) limit_to_image(corner, camera, facet);
  return facet;
}

/// Some rows of the image.
class Band {
 public:
  Band(int first_row, int rows, const PinholeCamera& camera, int samples, std::span<SeenPoint> seen)
      : first_(first_row),
        rows_(rows),
        width_(camera.width),
        points_(sight_points(samples)),
        seen_(seen),
        nearness_(seen.size(), 0.0f) {}

  void draw(std::uint32_t number, const Facet& facet) {
    const double sign = facet.volume < 0.0 ? -1.0 : 1.0, nearness_scale = 1.0 / std::abs(facet.volume);
    for (int y = std::max(facet.y0, first_); y < std::min(facet.y1, first_ + rows_); ++y)
      for (std::size_t s = 0; s < points_.size(); ++s) {
        // Of the edge functions what is the same all along the row. Both triangles of an edge compute the
        // same, but for the sign.
        std::array<double, 3> slope{}, of_row{};
        for (std::size_t i = 0; i < 3; ++i) {
          slope[i] = sign * facet.edge[i].x();
          of_row[i] =
              sign * (facet.edge[i].y() * (y + static_cast<double>(points_[s].y())) + facet.edge[i].z());
        }
        std::size_t place = (static_cast<std::size_t>(y - first_) * width_ + facet.x0) * points_.size() + s;
        for (int x = facet.x0; x < facet.x1; ++x, place += points_.size()) {
          const double column = x + static_cast<double>(points_[s].x());
          const double e0 = slope[0] * column + of_row[0], e1 = slope[1] * column + of_row[1],
                       e2 = slope[2] * column + of_row[2];
          if (!(std::min(std::min(e0, e1), e2) >= 0.0)) continue;
          const double sum = e0 + e1 + e2;
          const auto nearness = static_cast<float>(sum * nearness_scale);  // one over the point's depth
          if (!(nearness > nearness_[place])) continue;
          nearness_[place] = nearness;
          seen_[place] = {
              number,
              facet.volume > 0.0,
              {static_cast<float>(e0 / sum), static_cast<float>(e1 / sum), static_cast<float>(e2 / sum)}};
        }
      }
  }

 private:
  int first_, rows_, width_;
  std::span<const Eigen::Vector2f> points_;
  std::span<SeenPoint> seen_;
  std::vector<float> nearness_;
};

}  // namespace

std::span<const Eigen::Vector2f> sight_points(int samples) {
  static const std::array<Eigen::Vector2f, 1> middle = {{{0.5f, 0.5f}}};
  static const std::array<Eigen::Vector2f, 4> turned = {
      {{0.375f, 0.125f}, {0.875f, 0.375f}, {0.125f, 0.625f}, {0.625f, 0.875f}}};
  if (samples == 1) return middle;
  return turned;
}

std::vector<SeenPoint> rasterise(const Mesh& mesh, const PinholeCamera& camera, int samples) {
  camera.check();
  const Projection project(camera);
  std::vector<Vector3d> projected(mesh.positions.size());
  tbb::parallel_for(std::size_t{0}, projected.size(),
                    [&](std::size_t v) { projected[v] = project(mesh.positions[v]); });
  std::vector<Facet> facets(mesh.triangles.size());
  tbb::parallel_for(std::size_t{0}, facets.size(),
                    [&](std::size_t t) { facets[t] = facet_of(mesh.triangles[t], projected, camera); });

  const int bands = (camera.height + band_rows - 1) / band_rows;
  std::vector<std::vector<std::uint32_t>> facets_of_band(static_cast<std::size_t>(bands));
  for (std::uint32_t t = 0; t < facets.size(); ++t)
    if (facets[t].x0 < facets[t].x1)
      for (int y = facets[t].y0; y < facets[t].y1; y = (y / band_rows + 1) * band_rows)
        facets_of_band[static_cast<std::size_t>(y / band_rows)].push_back(t);

  const std::size_t of_row = static_cast<std::size_t>(camera.width) * sight_points(samples).size();
  std::vector<SeenPoint> seen(of_row * camera.height);
  tbb::parallel_for(0, bands, [&](int b) {
    const int first = b * band_rows, rows = std::min(band_rows, camera.height - first);
    Band band(first, rows, camera, samples, std::span(seen).subspan(of_row * first, of_row * rows));
    for (const std::uint32_t t : facets_of_band[static_cast<std::size_t>(b)]) band.draw(t, facets[t]);
  });
  return seen;
}

}  // namespace refield
