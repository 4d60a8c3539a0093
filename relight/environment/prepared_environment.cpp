// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/prepared_environment.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>
#include <utility>

#include "core/light/cube_map.h"

namespace refield {

namespace {

using Eigen::Vector3d;
using std::numbers::pi;

/// Below, a texel's columns are so wide that two neighbours cannot be identified by the sign of their
/// azimuth.
constexpr int min_columns = 16;
/// Prefix sums are kept for that many texels: for each row of small maps, every 2nd, 4th or 8th of large
/// ones.
constexpr std::size_t max_prefix_texels = std::size_t{1} << 21;
constexpr int max_block_rows = 8;

/// atan2(y, x), by its series where that is good to rounding.
double angle(double y, double x) {
  if (std::abs(y) >= 0.06 * x) return std::atan2(y, x);
  const double r = y / x, r2 = r * r;
  return r * (1.0 - r2 * (1.0 / 3.0 - r2 * (0.2 - r2 * (1.0 / 7.0 - r2 * (1.0 / 9.0)))));
}

/// Where the plane through the poles that lies `at_a` and `at_b` from two directions cuts their great circle.
Vector3d cut(const Vector3d& a, const Vector3d& b, double at_a, double at_b) {
  constexpr double rounding = 1e-14;
  double t = 0.5;
  if (std::abs(at_a) > rounding || std::abs(at_b) > rounding)
    t = std::clamp(at_a / (at_a - at_b), 0.0, 1.0);
  else if (a.x() * b.x() + a.z() * b.z() < 0.0)  // along the meridian and over a pole: there
    t = std::hypot(a.x(), a.z()) / (std::hypot(a.x(), a.z()) + std::hypot(b.x(), b.z()));
  return (a + t * (b - a)).normalized();
}

/// The rows' edges that a great circle crosses, in order.
class RowCrossings {
 public:
  RowCrossings(const std::vector<double>& sines, const Vector3d& a, int row_a, const Vector3d& b, int row_b)
      : sines_(sines), row_(row_a), turn_row_(row_b), last_row_(row_b) {
    const Vector3d normal = a.cross(b).normalized();
    top_ = std::hypot(normal.x(), normal.z());
    if (!(top_ > 0.0)) {  // along the equator, or no length
      last_row_ = turn_row_ = row_;
      return;
    }
    apex_ = (Vector3d::UnitY() - normal.y() * normal) / top_;
    ahead_ = normal.cross(apex_);
    const bool rises_at_a = a.dot(ahead_) < 0.0, rises_at_b = b.dot(ahead_) < 0.0;
    if (rises_at_a && !rises_at_b) {  // over its northernmost point
      turn_row_ = std::min(row_a, row_b);
      while (turn_row_ > 0 && sine(turn_row_) < top_) --turn_row_;
    }
    if (!rises_at_a && rises_at_b) {
      turn_row_ = std::max(row_a, row_b);
      while (turn_row_ + 2 < static_cast<int>(sines.size()) && sine(turn_row_ + 1) > -top_) ++turn_row_;
    }
    rises_ = rises_at_a;
    find();
  }

  bool any() const { return any_; }
  const Vector3d& point() const { return point_; }
  /// To the next one; returns the row that is entered.
  int pass() {
    row_ += rises_ ? -1 : 1;
    const int entered = row_;
    find();
    return entered;
  }
  /// Whether a point of the great circle comes before the crossing.
  bool is_after(const Vector3d& other) const {
    const double x = other.dot(apex_), y = other.dot(ahead_);
    return x * y_ - y * x_ > 0.0;
  }

 private:
  double sine(int row) const { return sines_[static_cast<std::size_t>(row)]; }
  void find() {
    if (row_ == turn_row_) {
      if (turn_row_ == last_row_) {
        any_ = false;
        return;
      }
      turn_row_ = last_row_;
      rises_ = !rises_;
    }
    // Rounding alone makes an edge end against its direction; the last row is set by the caller then.
    any_ = rises_ ? row_ > turn_row_ : row_ < turn_row_;
    if (!any_) return;
    x_ = std::clamp(sine(rises_ ? row_ : row_ + 1) / top_, -1.0, 1.0);
    y_ = std::sqrt(1.0 - x_ * x_);
    if (rises_) y_ = -y_;
    point_ = x_ * apex_ + y_ * ahead_;
  }

  const std::vector<double>& sines_;
  int row_, turn_row_, last_row_;
  double top_ = 0.0, x_ = 0.0, y_ = 0.0;
  Vector3d apex_, ahead_, point_;
  bool rises_ = false, any_ = false;
};

}  // namespace

PreparedEnvironment::PreparedEnvironment(LightMap map, const RunContext& run)
    : PreparedEnvironment(std::make_shared<const LightMap>(std::move(map)), run) {}

PreparedEnvironment::PreparedEnvironment(std::shared_ptr<const LightMap> map, const RunContext& run)
    : map_(std::move(map)) {
  const Image& radiance = map_->radiance;
  if (map_->parameterisation == Parameterisation::monitor || radiance.channels != 3 || radiance.empty())
    throw InputError("the light map of a monitor is not an environment map; give a lat-long or cube map");
  if (map_->parameterisation == Parameterisation::lat_long) {
    prepare_lat_long(run);
    return;
  }
  const int side = radiance.width;
  if (radiance.height != cube_faces * side)
    throw InputError("a cube map has six square faces stacked vertically, not ", shape_text(radiance));
  const std::vector<float> angles = cube_solid_angles(side);
  for (std::size_t i = 0; i < radiance.values.size(); ++i)
    total_[i % 3] += double{angles[i / 3 % angles.size()]} * radiance.values[i];
}

void PreparedEnvironment::prepare_lat_long(const RunContext& run) {
  const Image& radiance = map_->radiance;
  const int width = radiance.width, height = radiance.height;
  for (int row = 0; row <= height; ++row) sines_.push_back(std::cos(pi * row / height));
  if (height % 2 == 0) sines_[static_cast<std::size_t>(height) / 2] = 0.0;
  for (int column = 0; column <= width; ++column) {
    const double azimuth = 2.0 * pi * (column % width) / width;
    edges_.emplace_back(-std::sin(azimuth), -std::cos(azimuth));
  }
  const bool keeps_prefix = width >= min_columns;
  while (block_rows_ < max_block_rows &&
         radiance.pixel_count() > max_prefix_texels * static_cast<std::size_t>(block_rows_))
    block_rows_ *= 2;
  const auto blocks = static_cast<std::size_t>((height + block_rows_ - 1) / block_rows_);
  const auto values = static_cast<std::size_t>(width) * 3;
  if (keeps_prefix) prefix_.resize(blocks * values);
  std::vector<double> sums(values, 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, values, 768), [&](const auto& range) {
    for (int row = 0; row < height; ++row) {
      if (row % 64 == 0) run.throw_if_stopped();
      if (keeps_prefix && row % block_rows_ == 0)
        std::copy(
            sums.begin() + static_cast<std::ptrdiff_t>(range.begin()),
            sums.begin() + static_cast<std::ptrdiff_t>(range.end()),
            prefix_.begin() + static_cast<std::ptrdiff_t>(
                                  static_cast<std::size_t>(row / block_rows_) * values + range.begin()));
      const double ring = sines_[static_cast<std::size_t>(row)] - sines_[static_cast<std::size_t>(row) + 1];
      const float* texels = radiance.row(row).data();
      for (std::size_t i = range.begin(); i < range.end(); ++i) sums[i] += ring * texels[i];
    }
  });
  for (std::size_t i = 0; i < values; ++i) total_[i % 3] += 2.0 * pi / width * sums[i];
}

MapPoint PreparedEnvironment::point(Vector3d direction, const SourceTexel& near) const {
  constexpr double from_pole = 1e-12;
  direction *= 1.0 / direction.norm();
  if (direction.x() * direction.x() + direction.z() * direction.z() < from_pole * from_pole)
    direction.x() = from_pole;
  return {direction, texel_at(direction, near)};
}

SourceTexel PreparedEnvironment::texel_at(const Vector3d& direction, const SourceTexel& near) const {
  constexpr int max_steps = 4;
  const int width = map_->radiance.width, height = map_->radiance.height;
  SourceTexel at = near;
  int steps = 0;
  const auto sine = [&](int row) { return sines_[static_cast<std::size_t>(row)]; };
  for (; at.row > 0 && direction.y() > sine(at.row) && steps < max_steps; ++steps) --at.row;
  for (; at.row + 1 < height && direction.y() < sine(at.row + 1) && steps < max_steps; ++steps) ++at.row;
  if (steps == max_steps) {
    at.row = std::clamp(static_cast<int>(std::acos(std::clamp(direction.y(), -1.0, 1.0)) / pi * height), 0,
                        height - 1);
    if (at.row > 0 && direction.y() > sine(at.row)) --at.row;
    if (at.row + 1 < height && direction.y() < sine(at.row + 1)) ++at.row;
  }
  const auto wrapped = [width](int column) {
    return column < 0 ? column + width : column >= width ? column - width : column;
  };
  for (steps = 0; steps < max_steps; ++steps) {
    if (right_of(at.column, direction) < 0.0)
      at.column = wrapped(at.column - 1);
    else if (right_of(at.column + 1, direction) >= 0.0)
      at.column = wrapped(at.column + 1);
    else
      return at;
  }
  double turn = std::atan2(-direction.x(), -direction.z()) / (2.0 * pi);
  if (turn < 0.0) turn += 1.0;
  at.column = wrapped(static_cast<int>(turn * width));
  if (right_of(at.column, direction) < 0.0)
    at.column = wrapped(at.column - 1);
  else if (right_of(at.column + 1, direction) >= 0.0)
    at.column = wrapped(at.column + 1);
  return at;
}

void PreparedEnvironment::add_piece(const PathPoint& from, const PathPoint& to, int column, int row,
                                    PathSums& sums) const {
  const Vector3d &a = from.direction, &b = to.direction;
  const double azimuth =
      angle(from.level[1] * to.level[0] - from.level[0] * to.level[1], from.level.dot(to.level));
  const double across = a.z() * b.x() - a.x() * b.z(), along = a.x() * b.x() + a.z() * b.z();
  // ∫ (1 − sin(latitude)) dφ: the triangle with the north pole (van Oosterom and Strackee 1983, eq. 8), or
  // what the one with the south pole leaves.
  const double dot = 1.0 + along + a.y() * b.y(), height = a.y() + b.y();
  const double triangle = 2.0 * angle(across, dot + std::abs(height));
  const double above = height >= 0.0 ? triangle : 2.0 * azimuth - triangle;
  add_measured(azimuth, above, row * map_->radiance.width + column, row, sums);
}

void PreparedEnvironment::add_measured(double azimuth, double above, std::int32_t texel, int row,
                                       PathSums& sums) const {
  const std::ptrdiff_t row_values = std::ptrdiff_t{3} * map_->radiance.width;
  const int block = row / block_rows_, rows_below_block = row - block * block_rows_;
  const float* radiance = map_->radiance.values.data() + std::ptrdiff_t{3} * texel;
  const double* north =
      prefix_.data() + std::ptrdiff_t{3} * texel - (row - block) * row_values;  // of the block's first row
  const double down = 1.0 - sines_[static_cast<std::size_t>(row)];
  const double beside = above - down * azimuth;
  for (std::ptrdiff_t c = 0; c < 3; ++c) sums.light[c] += north[c] * azimuth + beside * radiance[c];
  for (int y = row - rows_below_block; y < row; ++y) {
    const float* between = radiance - (row - y) * row_values;
    const double ring =
        (sines_[static_cast<std::size_t>(y)] - sines_[static_cast<std::size_t>(y) + 1]) * azimuth;
    for (std::ptrdiff_t c = 0; c < 3; ++c) sums.light[c] += ring * between[c];
  }
  sums.azimuth += azimuth;
}

template <class Visit>
void PreparedEnvironment::walk(const MapPoint& start, const MapPoint& end, const Visit& visit) const {
  const Vector3d& a = start.direction;
  const SourceTexel& at_a = start.texel;
  const Vector3d& b = end.direction;
  const SourceTexel& at_b = end.texel;
  const int width = map_->radiance.width;
  int columns = at_b.column - at_a.column;  // to cross, to the right
  if (2 * columns >= width) columns -= width;
  if (2 * columns < -width) columns += width;
  const double along = a.x() * b.x() + a.z() * b.z();
  if (8 * std::abs(columns) > width || along <= 0.0) {
    const double expected = std::atan2(a.z() * b.x() - a.x() * b.z(), along) / (2.0 * pi) * width;
    columns += width * static_cast<int>(std::lround((expected - columns) / width));
  }
  const double shrink = std::sqrt(std::max(0.0, 1.0 - 0.25 * (b - a).squaredNorm()));
  const bool same_row =
      at_a.row == at_b.row && stays_inside(at_a, std::min(a.y(), b.y()), std::max(a.y(), b.y()), shrink);
  const auto point = [](const Vector3d& direction) {
    return PathPoint{direction, {direction.x(), direction.z()}};
  };
  PathPoint from = point(a), at_column;
  if (columns == 0 && same_row) {
    visit(from, point(b), at_a.column, at_a.row);
    return;
  }
  std::optional<RowCrossings> rows;
  if (!same_row) rows.emplace(sines_, a, at_a.row, b, at_b.row);
  SourceTexel at = at_a;
  const auto find_column = [&] {
    const int edge = columns > 0 ? at.column + 1 : at.column;
    at_column = {cut(a, b, right_of(edge, a), right_of(edge, b)), edges_[static_cast<std::size_t>(edge)]};
  };
  if (columns != 0) find_column();
  while (true) {
    const bool has_row = rows && rows->any();
    if (columns != 0 && (!has_row || rows->is_after(at_column.direction))) {
      visit(from, at_column, at.column, at.row);
      from = at_column;
      const int step = columns > 0 ? 1 : -1;
      at.column = (at.column + step + width) % width;
      columns -= step;
      if (columns != 0) find_column();
    } else if (has_row) {
      const PathPoint to = point(rows->point());
      visit(from, to, at.column, at.row);
      from = to;
      at.row = rows->pass();
    } else {
      break;
    }
  }
  visit(from, point(b), at_b.column, at_b.row);
}

PathSums PreparedEnvironment::along(const MapPoint& a, const MapPoint& b) const {
  PathSums sums;
  walk(a, b, [&](const PathPoint& from, const PathPoint& to, int column, int row) {
    add_piece(from, to, column, row, sums);
  });
  return sums;
}

Vector3d PreparedEnvironment::enclosed(const PathSums& around) const {
  // Around the south pole Q is that of whole columns, which no edge encloses.
  return around.light + (around.azimuth < -pi ? total_ : Vector3d::Zero());
}

namespace {

/// ∫ cos dsin of latitudes from the equator to one.
double outward_up_to(double sine) {
  return 0.5 * (sine * std::sqrt(std::max(0.0, 1.0 - sine * sine)) + std::asin(sine));
}

/// ∫ e dφ from one azimuth to another: e, (x, z), turned by a quarter.
Eigen::Vector2d turned(const Eigen::Vector2d& level) {
  return {-level[1], level[0]};
}

}  // namespace

void PreparedEnvironment::prepare_vectors(const RunContext& run) const {
  tbb::collaborative_call_once(vectors_->made, [&] { make_vector_table(*vectors_, run); });
}

void PreparedEnvironment::make_vector_table(VectorTable& table, const RunContext& run) const {
  const Image& radiance = map_->radiance;
  table.caps.clear();
  table.poles.clear();
  for (const double sine : sines_) {
    table.caps.push_back({0.5 * (1.0 - sine * sine), outward_up_to(1.0) - outward_up_to(sine)});
    table.poles.emplace_back(std::acos(sine), std::sqrt(1.0 - sine * sine));
  }
  const auto values = static_cast<std::size_t>(radiance.width) * 3;
  table.prefix.resize(prefix_.size());
  std::vector<Cap> sums(values);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, values, 768), [&](const auto& range) {
    for (int row = 0; row < radiance.height; ++row) {
      if (row % 64 == 0) run.throw_if_stopped();
      const auto at = static_cast<std::size_t>(row);
      if (row % block_rows_ == 0)
        std::copy_n(
            sums.data() + range.begin(), range.size(),
            table.prefix.data() + static_cast<std::size_t>(row / block_rows_) * values + range.begin());
      const float* texels = radiance.row(row).data();
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        sums[i].upward += (table.caps[at + 1].upward - table.caps[at].upward) * texels[i];
        sums[i].outward += (table.caps[at + 1].outward - table.caps[at].outward) * texels[i];
      }
    }
  });
  table.total.setZero();
  for (std::size_t i = 0; i < values; ++i) {
    const Eigen::Vector2d across = turned(edges_[i / 3 + 1]) - turned(edges_[i / 3]);
    table.total.col(static_cast<Eigen::Index>(i % 3)) += Vector3d(
        sums[i].outward * across[0], sums[i].upward * 2.0 * pi / radiance.width, sums[i].outward * across[1]);
  }
}

void PreparedEnvironment::add_measured(double azimuth, const Eigen::Vector2d& across, const Vector3d& inside,
                                       std::int32_t texel, int row, VectorPathSums& sums) const {
  const std::ptrdiff_t row_values = std::ptrdiff_t{3} * map_->radiance.width;
  const int block = row / block_rows_, first_row = block * block_rows_;
  const float* radiance = map_->radiance.values.data() + std::ptrdiff_t{3} * texel;
  const Cap* north = vectors_->prefix.data() + std::ptrdiff_t{3} * texel - (row - block) * row_values;
  for (std::ptrdiff_t c = 0; c < 3; ++c) {
    Cap sum = north[c];
    for (int y = first_row; y < row; ++y) {
      const Cap &upper = vectors_->caps[static_cast<std::size_t>(y)],
                &lower = vectors_->caps[static_cast<std::size_t>(y) + 1];
      const double between = radiance[c - (row - y) * row_values];
      sum.upward += (lower.upward - upper.upward) * between;
      sum.outward += (lower.outward - upper.outward) * between;
    }
    sums.light.col(c) += static_cast<double>(radiance[c]) * inside +
                         Vector3d(sum.outward * across[0], sum.upward * azimuth, sum.outward * across[1]);
  }
  sums.azimuth += azimuth;
}

VectorPathSums PreparedEnvironment::vectors_along(const MapPoint& a, const MapPoint& b) const {
  VectorPathSums sums;
  /// End of a piece: the azimuth's direction, its integral, and that times the angle from the pole.
  struct End {
    Eigen::Vector2d level, across, side;
  };
  const auto end_of = [&](const PathPoint& point, int row) -> End {
    const Eigen::Vector2d level = point.level.normalized(), across = turned(level);
    const Eigen::Vector2d& edge = vectors_->poles[static_cast<std::size_t>(row)];
    const double upward = point.direction.y(), outward = std::hypot(point.direction.x(), point.direction.z());
    const double sine = sines_[static_cast<std::size_t>(row)];  // of the edge's latitude
    const double below = angle(outward * sine - upward * edge[1], upward * sine + outward * edge[1]);
    return {level, across, (edge[0] + below) * across};
  };
  std::optional<End> start;
  walk(a, b, [&](const PathPoint& from, const PathPoint& to, int column, int row) {
    if (!start) start = end_of(from, row);
    const End end = end_of(to, row);
    const double azimuth =
        angle(start->level[1] * end.level[0] - start->level[0] * end.level[1], start->level.dot(end.level));
    const Eigen::Vector2d across = end.across - start->across, sides = end.side - start->side;
    start = end;
    // The triangle with the north pole, less what of it is north of the texel.
    const Vector3d normal = from.direction.cross(to.direction);
    const double sine = normal.norm();
    const double stretch = sine > 0.0 ? angle(sine, from.direction.dot(to.direction)) / sine : 1.0;
    const Vector3d triangle = 0.5 * (stretch * normal + Vector3d(sides[0], 0.0, sides[1]));
    const Cap& north = vectors_->caps[static_cast<std::size_t>(row)];
    const Vector3d of_cap(north.outward * across[0], north.upward * azimuth, north.outward * across[1]);
    add_measured(azimuth, across, triangle - of_cap, row * map_->radiance.width + column, row, sums);
  });
  return sums;
}

namespace {

/// Pieces of maps of that many columns and rows are short enough for measure_pieces() and
/// measure_piece_vectors().
constexpr int fine_columns = 256, fine_rows = 128;

/// Whether a path lies so far from the poles, beside which azimuths are large and badly known, that those of
/// its pieces are not larger than columns.
bool misses_poles(const Vector3d& a, const Vector3d& b) {
  constexpr double beside_pole = 1e-3;
  const auto from_pole = [](const Vector3d& end) { return end.x() * end.x() + end.z() * end.z(); };
  return std::min(from_pole(a), from_pole(b)) >
         std::max(4.0 * (b - a).squaredNorm(), beside_pole * beside_pole);
}

}  // namespace

template <class Sums>
PathBatch<Sums>::PathBatch(const PreparedEnvironment& environment)
    : environment_(environment),
      is_fine_(environment.map().radiance.width >= fine_columns &&
               environment.map().radiance.height >= fine_rows) {}

template <class Sums>
void PathBatch<Sums>::add(const MapPoint& a, const MapPoint& b, Sums& sums) {
  sums = {};
  if (add_short(a, b, sums)) return;
  if (is_fine_ && misses_poles(a.direction, b.direction))
    environment_.walk(a, b, [&](const PathPoint& from, const PathPoint& to, int column, int row) {
      add_piece(from, to, column, row, sums);
    });
  else if constexpr (has_vectors)
    sums = environment_.vectors_along(a, b);
  else
    sums = environment_.along(a, b);
}

template <class Sums>
bool PathBatch<Sums>::add_short(const MapPoint& start, const MapPoint& end, Sums& sums) {
  const Vector3d& a = start.direction;
  const SourceTexel& at_a = start.texel;
  const Vector3d& b = end.direction;
  const SourceTexel& at_b = end.texel;
  if (has_vectors && !is_fine_) return false;
  constexpr double max_squared_length = 4e-3;
  constexpr double max_tangent = 0.06;  // of the azimuth of pieces, see measure_pieces()
  const int width = environment_.map_->radiance.width;
  int columns = at_b.column - at_a.column;  // to cross, to the right
  if (2 * columns >= width) columns -= width;
  if (2 * columns < -width) columns += width;
  int rows = at_b.row - at_a.row;
  const Vector3d chord = b - a;
  const double squared = chord.squaredNorm();
  if (squared > max_squared_length) return false;
  if (is_fine_
          ? !misses_poles(a, b)
          : std::abs(a.z() * chord.x() - a.x() * chord.z()) >= max_tangent * (a.x() * b.x() + a.z() * b.z()))
    return false;
  // On the chord's great circle, with t from 0 to 1 and to squared²/128, sin(latitude) is
  // a.y + t chord.y + bend t (1 − t). Where it crosses edges of rows need not be known better: from texel to
  // texel of a column, what is integrated does not jump.
  const double half_squared = 0.5 * squared;
  if (rows != 0) {
    // It is monotonic where the bend is small beside the slope.
    if (std::abs(chord.y()) < 8.0 * half_squared) return false;
  } else if (!environment_.stays_inside(at_a, std::min(a.y(), b.y()), std::max(a.y(), b.y()),
                                        1.0 - 0.126 * squared)) {  // less than √(1 − squared ∕ 4)
    return false;
  }
  SourceTexel at = at_a;
  constexpr double nowhere = 2.0;
  double at_column = nowhere, at_row = nowhere;  // along the chord, of the next edges
  const auto find_column = [&] {
    at_column = nowhere;
    if (columns == 0) return;
    const int edge = columns > 0 ? at.column + 1 : at.column;
    const double of_a = environment_.right_of(edge, a), of_b = environment_.right_of(edge, b);
    at_column = of_a == of_b ? 0.5 : std::clamp(of_a / (of_a - of_b), 0.0, 1.0);
  };
  const auto find_row = [&] {
    at_row = nowhere;
    if (rows == 0) return;
    const double sine = environment_.sines_[static_cast<std::size_t>(rows > 0 ? at.row + 1 : at.row)];
    const double bend = half_squared * sine, slope = chord.y() + bend, below = sine - a.y();
    const double root = std::sqrt(std::max(0.0, slope * slope - 4.0 * bend * below));
    at_row = std::clamp(2.0 * below / (slope + std::copysign(root, slope)), 0.0, 1.0);
  };
  const auto point = [](const Vector3d& direction) {
    return PathPoint{direction, {direction.x(), direction.z()}};
  };
  PathPoint from = point(a);
  find_column();
  find_row();
  while (columns != 0 || rows != 0) {
    const bool column_first = at_column < at_row;
    const double t = column_first ? at_column : at_row;
    const double shorter = squared * t * (1.0 - t);  // of the squared length, than 1
    PathPoint to = point((a + t * chord) * (1.0 + shorter * (0.5 + shorter * (0.375 + 0.3125 * shorter))));
    if (column_first) {
      const int step = columns > 0 ? 1 : -1;
      if (is_fine_)
        to.level = environment_.edges_[static_cast<std::size_t>(step > 0 ? at.column + 1 : at.column)];
      add_piece(from, to, at.column, at.row, sums);
      at.column += step;
      if (at.column < 0 || at.column == width) at.column -= step * width;
      columns -= step;
      find_column();
    } else {
      const int step = rows > 0 ? 1 : -1;
      add_piece(from, to, at.column, at.row, sums);
      at.row += step;
      rows -= step;
      find_row();
    }
    from = to;
  }
  add_piece(from, point(b), at_b.column, at_b.row, sums);
  return true;
}

template <class Sums>
void PathBatch<Sums>::add_piece(const PathPoint& a, const PathPoint& b, int column, int row, Sums& sums) {
  if (count_ == PathPieceEnds::capacity) flush();
  ends_.ax[count_] = a.direction.x();
  ends_.ay[count_] = a.direction.y();
  ends_.az[count_] = a.direction.z();
  ends_.bx[count_] = b.direction.x();
  ends_.by[count_] = b.direction.y();
  ends_.bz[count_] = b.direction.z();
  ends_.a_level_x[count_] = a.level[0];
  ends_.a_level_z[count_] = a.level[1];
  ends_.b_level_x[count_] = b.level[0];
  ends_.b_level_z[count_] = b.level[1];
  if constexpr (has_vectors) {
    const auto edge = static_cast<std::size_t>(row);
    rows_.sine[count_] = environment_.sines_[edge];
    rows_.from_pole[count_] = environment_.vectors_->poles[edge][0];
    rows_.cosine[count_] = environment_.vectors_->poles[edge][1];
    rows_.upward[count_] = environment_.vectors_->caps[edge].upward;
    rows_.outward[count_] = environment_.vectors_->caps[edge].outward;
  }
  places_[count_++] = {row * environment_.map_->radiance.width + column, row, &sums};
}

template <class Sums>
void PathBatch<Sums>::flush() {
  if constexpr (has_vectors)
    measure_piece_vectors(ends_, rows_, count_, measures_);
  else
    measure_pieces(ends_, count_, measures_.azimuth, measures_.above);
  for (std::size_t i = 0; i < count_; ++i) {
    const Place& place = places_[i];
    if constexpr (has_vectors)
      environment_.add_measured(measures_.azimuth[i], {measures_.across_x[i], measures_.across_z[i]},
                                {measures_.x[i], measures_.y[i], measures_.z[i]}, place.texel, place.row,
                                *place.sums);
    else
      environment_.add_measured(measures_.azimuth[i], measures_.above[i], place.texel, place.row,
                                *place.sums);
  }
  count_ = 0;
}

template class PathBatch<PathSums>;
template class PathBatch<VectorPathSums>;

Eigen::Matrix3d PreparedEnvironment::enclosed(const VectorPathSums& around) const {
  return around.azimuth < -pi ? Eigen::Matrix3d(around.light + vectors_->total) : around.light;
}

}  // namespace refield
