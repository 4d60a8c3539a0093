// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/mesh_raster.h"

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
    const Eigen::Matrix3d axes = camera.axes().cast<double>();
    const double half = std::tan(camera.vertical_field_of_view_degrees * std::numbers::pi / 360.0);
    // A point at depth z stands at column w/2 + h/2 · X/(half z), row h/2 − h/2 · Y/(half z).
    const double scale = 0.5 * camera.height / half;
    rows_.row(0) = scale * axes.row(0) + 0.5 * camera.width * axes.row(2);
    rows_.row(1) = -scale * axes.row(1) + 0.5 * camera.height * axes.row(2);
    rows_.row(2) = axes.row(2);
  }

  /// (column · depth, row · depth, depth)
  Vector3d operator()(const Eigen::Vector3f& point) const {
    return rows_ * (point.cast<double>() - position_);
  }

 private:
  Vector3d position_;
  Eigen::Matrix3d rows_;
};

/// Pixels, half-open.
struct PixelBox {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

/// Those that may look at a triangle.
class BoxOfTriangle {
 public:
  BoxOfTriangle(const PinholeCamera& camera, int samples) : width_(camera.width), height_(camera.height) {
    const auto points = sight_points(samples);
    low_ = high_ = points[0].cast<double>();
    for (const Eigen::Vector2f& point : points) {
      low_ = low_.cwiseMin(point.cast<double>());
      high_ = high_.cwiseMax(point.cast<double>());
    }
    low_.array() -= slack;
    high_.array() += slack;
  }

  PixelBox operator()(const Vector3d& a, const Vector3d& b, const Vector3d& c) const {
    if (a.z() <= 0.0 && b.z() <= 0.0 && c.z() <= 0.0) return {};
    // One that reaches behind the camera may be seen anywhere.
    if (a.z() <= 0.0 || b.z() <= 0.0 || c.z() <= 0.0) return {0, 0, width_, height_};
    const Eigen::Vector2d pa = a.head<2>() / a.z(), pb = b.head<2>() / b.z(), pc = c.head<2>() / c.z();
    const Eigen::Vector2d first = pa.cwiseMin(pb).cwiseMin(pc) - high_,
                          last = pa.cwiseMax(pb).cwiseMax(pc) - low_;
    return {limited(std::ceil(first.x()), width_), limited(std::ceil(first.y()), height_),
            limited(std::floor(last.x()) + 1.0, width_), limited(std::floor(last.y()) + 1.0, height_)};
  }

 private:
  static constexpr double slack = 1e-6;  // pixels, for rounding
  static int limited(double value, int max_value) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(max_value)));
  }
  int width_, height_;
  Eigen::Vector2d low_, high_;  // of the points in a pixel
};

/// A triangle made ready: edge functions e_i · (x, y, 1) share the sign of `volume` inside, and are in
/// proportion to the shares of its vertices.
struct Facet {
  std::array<Vector3d, 3> edge;
  double volume = 0.0;
};

/// a × b, exactly the opposite of b × a whatever the compiler makes of it: so that points on an edge lie on
/// one side of it for both triangles, or on it for both.
Vector3d edge_between(std::uint32_t vertex_a, const Vector3d& a, std::uint32_t vertex_b, const Vector3d& b) {
  if (vertex_a < vertex_b) return a.cross(b);
  return -b.cross(a);
}

Facet facet_of(const std::array<std::uint32_t, 3>& triangle, const std::vector<Vector3d>& projected) {
  Facet facet;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::uint32_t j = triangle[(i + 1) % 3], k = triangle[(i + 2) % 3];
    facet.edge[i] = edge_between(j, projected[j], k, projected[k]);
  }
  facet.volume = projected[triangle[0]].dot(facet.edge[0]);
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

  void draw(std::uint32_t number, const Facet& facet, const PixelBox& box) {
    if (facet.volume == 0.0) return;
    const double sign = facet.volume < 0.0 ? -1.0 : 1.0, nearness_scale = 1.0 / std::abs(facet.volume);
    for (int y = std::max(box.y0, first_); y < std::min(box.y1, first_ + rows_); ++y)
      for (std::size_t s = 0; s < points_.size(); ++s) {
        // The part of the edge functions that is constant along the row. Both triangles of an edge compute
        // the same, but for the sign.
        std::array<double, 3> slope{}, of_row{};
        for (std::size_t i = 0; i < 3; ++i) {
          slope[i] = sign * facet.edge[i].x();
          of_row[i] =
              sign * (facet.edge[i].y() * (y + static_cast<double>(points_[s].y())) + facet.edge[i].z());
        }
        std::size_t place = (static_cast<std::size_t>(y - first_) * width_ + box.x0) * points_.size() + s;
        for (int x = box.x0; x < box.x1; ++x, place += points_.size()) {
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
  std::vector<PixelBox> boxes(mesh.triangles.size());
  const BoxOfTriangle box_of(camera, samples);
  tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t t) {
    const auto& [a, b, c] = mesh.triangles[t];
    boxes[t] = box_of(projected[a], projected[b], projected[c]);
  });

  const int bands = (camera.height + band_rows - 1) / band_rows;
  std::vector<std::vector<std::uint32_t>> triangles_of_band(static_cast<std::size_t>(bands));
  for (std::uint32_t t = 0; t < boxes.size(); ++t)
    if (boxes[t].x0 < boxes[t].x1)
      for (int y = boxes[t].y0; y < boxes[t].y1; y = (y / band_rows + 1) * band_rows)
        triangles_of_band[static_cast<std::size_t>(y / band_rows)].push_back(t);

  const std::size_t of_row = static_cast<std::size_t>(camera.width) * sight_points(samples).size();
  std::vector<SeenPoint> seen(of_row * camera.height);
  tbb::parallel_for(0, bands, [&](int b) {
    const int first = b * band_rows, rows = std::min(band_rows, camera.height - first);
    Band band(first, rows, camera, samples, std::span(seen).subspan(of_row * first, of_row * rows));
    for (const std::uint32_t t : triangles_of_band[static_cast<std::size_t>(b)])
      band.draw(t, facet_of(mesh.triangles[t], projected), boxes[t]);
  });
  return seen;
}

}  // namespace refield
