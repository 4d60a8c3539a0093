// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/environment.h"

#include <Eigen/Geometry>

#include <algorithm>

#include "core/base/units.h"

namespace refield {

void split(const SphericalPolygon& polygon, const Eigen::Vector3d& normal, SphericalPolygon& inside,
           SphericalPolygon& outside) {
  inside.clear();
  outside.clear();
  if (polygon.empty()) return;
  const Eigen::Vector3d* before = &polygon.back();
  double height_before = normal.dot(*before);
  for (const Eigen::Vector3d& corner : polygon) {
    const double height = normal.dot(corner);
    if ((height >= 0.0) != (height_before >= 0.0)) {
      const double share = height_before / (height_before - height);
      const Eigen::Vector3d cut = *before + share * (corner - *before);
      inside.push_back(cut);
      outside.push_back(cut);
    }
    (height >= 0.0 ? inside : outside).push_back(corner);
    before = &corner;
    height_before = height;
  }
}

double solid_angle(const SphericalPolygon& polygon) {
  if (polygon.size() < 3) return 0.0;
  const Eigen::Vector3d a = polygon[0].normalized();
  Eigen::Vector3d b = polygon[1].normalized();
  double sum = 0.0;
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    const Eigen::Vector3d c = polygon[i].normalized();
    // Edges instead of corners: the determinant of three nearly equal vectors would cancel.
    const double volume = a.dot((b - a).cross(c - a));
    sum += 2.0 * std::atan2(volume, 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
    b = c;
  }
  return std::abs(sum);
}

namespace {

using std::numbers::pi;

// The solid angle of a strip's texel is off by Δφ²/8 of itself at most, Δφ the strip's width: 3e-7.
constexpr int min_strips = 4096;

SpherePatch::Edges shared(std::vector<Eigen::Vector2d> edges) {
  return std::make_shared<const std::vector<Eigen::Vector2d>>(std::move(edges));
}

SpherePatch::Edges even_edges(double first, double last, int count) {
  std::vector<Eigen::Vector2d> edges;
  for (int i = 0; i <= count; ++i) edges.emplace_back(first + (last - first) * i / count, 1.0);
  return shared(std::move(edges));
}

}  // namespace

SphericalPolygon SpherePatch::rectangle(int left, int top, int right, int bottom) const {
  SphericalPolygon corners;
  for (const auto& [x, y] : {std::pair{left, top}, {right, top}, {right, bottom}, {left, bottom}}) {
    const Eigen::Vector2d& u = (*column_edges)[x];
    const Eigen::Vector2d& v = (*row_edges)[y];
    corners.push_back(axes.transpose() * Eigen::Vector3d(u[0] * v[1], v[0] * u[1], u[1] * v[1]));
  }
  return corners;
}

SphereGrid::SphereGrid(const LightDomain& domain, std::span<const MonitorPlacement> monitors)
    : domain_(domain) {
  if (domain.parameterisation == Parameterisation::lat_long) add_strips();
  if (domain.parameterisation == Parameterisation::cube) add_faces();
  if (domain.parameterisation == Parameterisation::monitor) add_windows(monitors);
}

void SphereGrid::add_strips() {
  const int each = (min_strips + domain_.width - 1) / domain_.width;
  const int count = each * domain_.width;
  const double half = pi / count;
  // Poles are set rather than computed, so that nothing of the sphere is lost to rounding.
  std::vector<Eigen::Vector2d> rows{{1.0, 0.0}};
  for (int row = 1; row < domain_.height; ++row) {
    const double elevation = pi * (0.5 - static_cast<double>(row) / domain_.height);
    rows.emplace_back(std::sin(elevation), std::cos(elevation) * std::cos(half));
  }
  rows.emplace_back(-1.0, 0.0);
  SpherePatch strip;
  strip.column_edges = shared({{-std::sin(half), std::cos(half)}, {std::sin(half), std::cos(half)}});
  strip.row_edges = shared(std::move(rows));
  for (int i = 0; i < count; ++i) {
    strip.axes = rotation_of(EulerAngles{.yaw = 360.0 * (i + 0.5) / count - 180.0}).transpose();
    strip.first_column = i / each;
    patches_.push_back(strip);
  }
}

void SphereGrid::add_faces() {
  if (domain_.height != 6 * domain_.width)
    throw InputError("a cube map has six square faces stacked vertically, not ", domain_.width, "×",
                     domain_.height, " texels");
  for (int face = 0; face < 6; ++face)
    patches_.push_back({cube_face_axes(face), even_edges(-1.0, 1.0, domain_.width),
                        even_edges(1.0, -1.0, domain_.width), 0, face * domain_.width});
}

void SphereGrid::add_windows(std::span<const MonitorPlacement> monitors) {
  if (monitors.empty()) throw InputError("the monitor's placement is not known; give one, as in 520x320@600");
  check_placements(monitors, domain_, "light map");
  const int rows = domain_.height / static_cast<int>(monitors.size());
  for (const MonitorPlacement& monitor : monitors)
    patches_.push_back(
        {rotation_of(monitor.turn).transpose(), even_edges(monitor.left(), monitor.right(), domain_.width),
         even_edges(monitor.top(), monitor.bottom(), rows), 0, rows * static_cast<int>(patches_.size())});
}

std::pair<int, int> SphereGrid::patches_near(const SphericalPolygon& polygon) const {
  const auto count = static_cast<int>(patches_.size());
  if (domain_.parameterisation != Parameterisation::lat_long) return {0, count};
  // Along a great circle that misses the poles the azimuth rises or falls all the way, so corners bound it.
  // Edges to a pole follow meridians: a polar corner has no azimuth and needs none.
  constexpr double polar = 1e-9;
  std::vector<double> azimuths;  // in order, the polar corner, if there is one, between last and first
  std::size_t pole = polygon.size();
  for (std::size_t i = 0; i < polygon.size(); ++i)
    if (std::hypot(polygon[i].x(), polygon[i].z()) < polar * std::abs(polygon[i].y())) pole = i;
  const bool has_pole = pole < polygon.size();
  for (std::size_t i = 1; i <= polygon.size(); ++i) {
    const Eigen::Vector3d& corner = polygon[(pole + i) % polygon.size()];
    if (std::hypot(corner.x(), corner.z()) >= polar * std::abs(corner.y()))
      azimuths.push_back(std::atan2(-corner.x(), -corner.z()));
  }
  if (azimuths.empty()) return {0, count};
  if (!has_pole) azimuths.push_back(azimuths.front());
  // Where the corners go around a pole, or an edge passes by it so closely that its side is not sure, all
  // strips count.
  constexpr double sure = pi - 1e-6;
  double azimuth = azimuths.front(), low = azimuth, high = azimuth;
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    const double step = std::remainder(azimuths[i] - azimuths[i - 1], 2.0 * pi);
    if (std::abs(step) > sure) return {0, count};
    azimuth += step;
    low = std::min(low, azimuth);
    high = std::max(high, azimuth);
  }
  if (!has_pole && std::abs(azimuth - azimuths.front()) > 1.0) return {0, count};
  const auto strip = [&](double angle) { return static_cast<int>(std::floor(angle / (2.0 * pi) * count)); };
  constexpr double rounding = 1e-12;
  const int from = strip(low - rounding), to = strip(high + rounding) + 1;
  if (to - from >= count) return {0, count};
  return {(from % count + count) % count, (from % count + count) % count + to - from};
}

const std::vector<TexelOverlap>& OverlapFinder::find(const SphericalPolygon& polygon) {
  found_.clear();
  if (polygon.size() < 3) return found_;
  const auto [first, last] = grid_.patches_near(polygon);
  const auto count = static_cast<int>(grid_.patches().size());
  for (int i = first; i < last; ++i) {
    const SpherePatch& patch = grid_.patches()[i % count];
    rest_.clear();
    for (const Eigen::Vector3d& corner : polygon) rest_.push_back(patch.axes * corner);
    cut_patch(patch);
  }
  return found_;
}

namespace {

/// Keeps of `polygon` what lies on the positive side.
void keep(SphericalPolygon& polygon, const Eigen::Vector3d& normal, SphericalPolygon& kept,
          SphericalPolygon& lost) {
  split(polygon, normal, kept, lost);
  polygon.swap(kept);
}

/// The columns (axis 0, sign 1) or rows (axis 1, sign −1) first to last that a polygon touches: the numbers
/// of edges that its corners have behind them.
std::pair<int, int> range(const SphericalPolygon& polygon, const std::vector<Eigen::Vector2d>& edges,
                          int axis, double sign) {
  const int count = static_cast<int>(edges.size()) - 1;
  int first = count - 1, last = 0;
  for (const Eigen::Vector3d& corner : polygon) {
    int low = 0, high = count - 1;  // edges 0 and count are the rim, where nothing is left to cut
    while (low < high) {
      const int middle = (low + high + 1) / 2;
      if (sign * (corner[axis] * edges[middle][1] - corner.z() * edges[middle][0]) >= 0.0)
        low = middle;
      else
        high = middle - 1;
    }
    first = std::min(first, low);
    last = std::max(last, low);
  }
  return {first, last};
}

}  // namespace

void OverlapFinder::cut_patch(const SpherePatch& patch) {
  keep(rest_, patch.column_normal(0), part_, spare_);
  keep(rest_, -patch.column_normal(patch.columns()), part_, spare_);
  keep(rest_, patch.row_normal(0), part_, spare_);
  keep(rest_, -patch.row_normal(patch.rows()), part_, spare_);
  if (rest_.size() < 3) return;
  const auto [first, last] = range(rest_, *patch.column_edges, 0, 1.0);
  for (int column = first; column < last; ++column) {
    split(rest_, patch.column_normal(column + 1), spare_, part_);
    rest_.swap(spare_);
    cut_column(patch, column, part_);
  }
  cut_column(patch, last, rest_);
}

void OverlapFinder::cut_column(const SpherePatch& patch, int column, SphericalPolygon& part) {
  if (part.size() < 3) return;
  const auto [first, last] = range(part, *patch.row_edges, 1, -1.0);
  for (int row = first; row <= last; ++row) {
    const bool is_last = row == last;
    if (!is_last) {
      split(part, patch.row_normal(row + 1), spare_, cell_);
      part.swap(spare_);
    }
    const double angle = solid_angle(is_last ? part : cell_);
    if (angle > 0.0) found_.push_back({patch.first_column + column, patch.first_row + row, angle});
  }
}

}  // namespace refield
