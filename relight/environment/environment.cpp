// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/environment.h"

#include <tbb/parallel_for.h>

#include <iterator>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/image/image_io.h"
#include "core/light/cube_map.h"
#include "relight/tiles/box_sums.h"

namespace refield {

namespace {

using std::numbers::pi;

/// Sums over one texel of the light map.
struct TexelSums {
  double energy[3] = {};     ///< radiance times solid angle
  double solid_angle = 0.0;  ///< of the texel

  void add(const std::vector<TexelOverlap>& overlaps, int windows, const Image& radiance) {
    for (const TexelOverlap& overlap : overlaps) {
      const double share = overlap.solid_angle / windows;
      solid_angle += overlap.solid_angle;
      for (int c = 0; c < 3; ++c) energy[c] += share * radiance.at(overlap.column, overlap.row, c);
    }
  }
};

/// Divides parts by whether they lie in the window of `patch` too.
std::vector<SeenPart> divided(std::vector<SeenPart> parts, const SpherePatch& patch) {
  const Eigen::Vector3d normals[] = {patch.column_normal(0), -patch.column_normal(patch.columns()),
                                     patch.row_normal(0), -patch.row_normal(patch.rows())};
  std::vector<SeenPart> result;
  for (SeenPart& part : parts) {
    SeenPart outside{{}, part.windows};
    SphericalPolygon inside;
    for (const Eigen::Vector3d& normal : normals) {
      split(part.outline, patch.axes.transpose() * normal, inside, outside.outline);
      if (outside.outline.size() >= 3) result.push_back(outside);
      part.outline.swap(inside);
    }
    ++part.windows;
    if (part.outline.size() >= 3) result.push_back(std::move(part));
  }
  return result;
}

}  // namespace

std::optional<Parameterisation> environment_kind(int width, int height) {
  if (width == 2 * height) return Parameterisation::lat_long;
  if (height == 6 * width) return Parameterisation::cube;
  return std::nullopt;
}

Parameterisation require_environment_kind(int width, int height, const std::string& name) {
  if (const auto kind = environment_kind(width, height)) return *kind;
  throw InputError(name, " is ", width, "×", height,
                   ", which is not an environment map: give a lat-long map (twice as wide as high) or a cube "
                   "map (six square faces stacked vertically, +X −X +Y −Y +Z −Z)");
}

LightMap read_environment(const fs::path& path, const RunContext& run) {
  const ImageHeader header = read_image_header(path);
  const Parameterisation kind = require_environment_kind(header.width, header.height, path.string() + ":");
  return read_light_map(path, kind, run, Primaries::rec709);
}

std::vector<SeenPart> EnvironmentProjector::parts_of(const SphericalPolygon& texel,
                                                     const SpherePatch& window) const {
  std::vector<SeenPart> parts{{texel, 1}};
  if (grid_.domain().parameterisation == Parameterisation::monitor)
    for (const SpherePatch& other : grid_.patches())
      if (&other != &window) parts = divided(std::move(parts), other);
  return parts;
}

std::optional<LightMap> EnvironmentProjector::as_it_stands(const LightMap& environment,
                                                           const EulerAngles& turn) const {
  if (environment.parameterisation == Parameterisation::monitor)
    throw InputError("the light map of a monitor is not an environment map; give a lat-long or cube map");
  rotation_of(turn);  // throws for angles that are none
  if (environment.domain() != target()) return std::nullopt;
  if (turn.is_none()) return environment;
  if (target().parameterisation == Parameterisation::lat_long &&
      EulerAngles{0.0, turn.pitch, turn.roll}.is_none())
    return rotated(environment, turn.yaw / 360.0);
  return std::nullopt;
}

void EnvironmentProjector::find_shared_texels(const RunContext& run) {
  const LightDomain& domain = target();
  const auto count = static_cast<std::size_t>(domain.width) * static_cast<std::size_t>(domain.height);
  std::vector<float> shares(count, 1.0f);
  std::vector<std::vector<SharedTexel>> of_row(static_cast<std::size_t>(domain.height));
  std::vector<double> seen(static_cast<std::size_t>(domain.height), 0.0);
  const bool overlap = std::ranges::any_of(grid_.patches(), [&](const SpherePatch& patch) {
    return std::ranges::any_of(parts_of(patch.outline(), patch),
                               [](const SeenPart& part) { return part.windows > 1; });
  });
  if (!overlap) return;
  for (const SpherePatch& patch : grid_.patches())
    tbb::parallel_for(patch.first_row, patch.first_row + patch.rows(), [&](int y) {
      run.throw_if_stopped();
      for (int x = 0; x < domain.width; ++x) {
        const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(domain.width) +
                        static_cast<std::size_t>(x);
        std::vector<SeenPart> parts = parts_of(patch.texel(x, y - patch.first_row), patch);
        double texel_share = 0.0;
        for (const SeenPart& part : parts) texel_share += solid_angle(part.outline) / part.windows;
        seen[static_cast<std::size_t>(y)] += texel_share;
        if (parts.size() == 1)
          shares[at] = 1.0f / static_cast<float>(parts.front().windows);
        else
          of_row[static_cast<std::size_t>(y)].push_back({x, y, std::move(parts)});
      }
    });
  seen_ = std::accumulate(seen.begin(), seen.end(), 0.0);
  window_shares_ = std::move(shares);
  for (auto& row : of_row) std::ranges::move(row, std::back_inserter(shared_texels_));
}

const float* EnvironmentProjector::solid_angles_of(int y) const {
  if (target().parameterisation == Parameterisation::lat_long) return solid_angles_.data() + y;
  const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(target().width);
  return solid_angles_.data() + at % solid_angles_.size();  // a cube's faces are alike
}

namespace {

/// The integral over a polygon that goes around clockwise, as texels do.
Eigen::Vector3d integral(const PreparedEnvironment& environment,
                         const Eigen::Matrix3d& environment_from_scene, const SphericalPolygon& polygon) {
  std::vector<MapPoint> corners;
  for (const Eigen::Vector3d& corner : polygon)
    corners.push_back(environment.point(environment_from_scene * corner,
                                        corners.empty() ? SourceTexel{} : corners.back().texel));
  PathSums around;
  for (std::size_t i = 0; i < corners.size(); ++i)
    around -= environment.along(corners[i], corners[(i + 1) % corners.size()]);
  return environment.enclosed(around);
}

/// The corners of a light map's texels: of a plane patch, or of a whole lat-long map.
class CornerGrid {
 public:
  CornerGrid(const SphereGrid& grid, const SpherePatch& patch, const Eigen::Matrix3d& environment_from_scene)
      : patch_(patch), domain_(grid.domain()), axes_(environment_from_scene) {
    if (is_lat_long()) {
      edges_per_texel_ = lat_long_edges(domain_.width);
      set_chord(std::max(pi / domain_.height, 2.0 * pi / (edges_per_texel_ * domain_.width)));
    } else {
      axes_ *= patch.axes.transpose();
      const auto& columns = *patch.column_edges;
      const auto& rows = *patch.row_edges;
      set_chord(std::max(columns[1][0] - columns[0][0], rows[0][0] - rows[1][0]));
    }
    for (auto& across : across_) across.resize(corners() + DirectionLine::max_lanes);
    for (std::size_t i = 0; i < corners(); ++i) {
      Eigen::Vector3d direction;
      if (is_lat_long())
        direction = axes_ * lat_long_direction(static_cast<double>(i) / edges_per_texel_,
                                               0.5 * domain_.height, domain_.width, domain_.height);
      else
        direction = (*patch_.column_edges)[i][0] * axes_.col(0);
      for (int axis = 0; axis < 3; ++axis) across_[axis][i] = direction[axis];
    }
  }

  /// Great circles that stand for a parallel of latitude along one texel: that many edges.
  static int lat_long_edges(int width) { return (min_lat_long_edges + width - 1) / width; }

  int edges_per_texel() const { return edges_per_texel_; }
  /// See PreparedEnvironment::bounds_of().
  double shrink() const { return shrink_; }
  bool is_lat_long() const { return domain_.parameterisation == Parameterisation::lat_long; }
  int columns() const { return is_lat_long() ? domain_.width : patch_.columns(); }
  int rows() const { return is_lat_long() ? domain_.height : patch_.rows(); }

  /// Number of corners along a row's upper edge.
  std::size_t corners() const { return static_cast<std::size_t>(columns() * edges_per_texel_) + 1; }

  /// The directions of these corners.
  DirectionLine line(int row) const {
    double scale = 1.0;
    Eigen::Vector3d offset;
    if (is_lat_long()) {
      const double from_pole = pi * row / domain_.height;
      scale = std::sin(from_pole);
      offset = std::cos(from_pole) * axes_.col(1);
    } else {
      offset = (*patch_.row_edges)[row][0] * axes_.col(1) + axes_.col(2);
    }
    return {
        across_[0].data(), across_[1].data(), across_[2].data(), scale, {offset[0], offset[1], offset[2]}};
  }

 private:
  /// Solid angles are off by Δφ²/8 of themselves, Δφ an edge's azimuth: 1e-6.
  static constexpr int min_lat_long_edges = 2048;

  void set_chord(double longest) { shrink_ = std::sqrt(std::max(0.0, 1.0 - 0.25 * longest * longest)); }

  const SpherePatch& patch_;
  LightDomain domain_;
  Eigen::Matrix3d axes_;
  std::array<std::vector<double>, 3> across_;
  int edges_per_texel_ = 1;
  double shrink_ = 0.0;
};

/// Solid angle of a texel of a plane patch, in closed form.
double rectangle_angle(const SpherePatch& patch, int column, int row) {
  const auto up_to = [&](int x, int y) {
    const double u = (*patch.column_edges)[x][0], v = (*patch.row_edges)[y][0];
    return std::atan2(u * v, std::sqrt(u * u + v * v + 1.0));
  };
  return up_to(column + 1, row) - up_to(column, row) - up_to(column + 1, row + 1) + up_to(column, row + 1);
}

/// The corners along one edge of a row of texels. Which texel of the environment they lie in is found for
/// all; the rest, where it is needed.
class CornerLine {
 public:
  CornerLine(const PreparedEnvironment& environment, const CornerGrid& grid)
      : environment_(environment),
        grid_(grid),
        count_(grid.corners()),
        inside_(count_ + DirectionLine::max_lanes),
        points_(count_),
        sums_(count_),
        has_point_(count_),
        has_sums_(count_) {}

  void set(int row) {
    line_ = grid_.line(row);
    std::ranges::fill(has_point_, std::uint8_t{0});
    std::ranges::fill(has_sums_, std::uint8_t{0});
    SourceTexel texel = first_;
    TexelBounds bounds = environment_.bounds_of(texel, grid_.shrink());
    std::size_t i = count_inside(line_, 0, count_, bounds, inside_.data());
    while (i < count_) {
      points_[i] = environment_.point(direction(i), texel);
      has_point_[i] = 1;
      texel = points_[i].texel;
      if (i == 0) first_ = texel;
      bounds = environment_.bounds_of(texel, grid_.shrink());
      const std::size_t inside = count_inside(line_, i, count_, bounds, inside_.data());
      if (inside == 0) inside_[i] = ~bounds.number;  // beside the edge it lies on, by rounding
      i += std::max(inside, std::size_t{1});
    }
  }

  /// Number of the environment's texel that holds a corner and the great circles to its neighbours in the
  /// same texel; −1 for none.
  std::int32_t inside(std::size_t i) const { return inside_[i]; }
  const std::vector<std::int32_t>& inside() const { return inside_; }

  const MapPoint& point(std::size_t i) {
    if (has_point_[i] == 0) {
      has_point_[i] = 1;
      const int number = inside_[i] < 0 ? ~inside_[i] : inside_[i], width = environment_.map().radiance.width;
      points_[i] = environment_.point(direction(i), {number % width, number / width});
    }
    return points_[i];
  }

  /// Asks for the sums from corner `i` to the next.
  void add_edge(std::size_t i, PathBatch<PathSums>& batch) {
    if (has_sums_[i] != 0) return;
    has_sums_[i] = 1;
    batch.add(point(i), point(i + 1), sums_[i]);
  }
  /// The sums that add_edge() requested; valid once the batch is flushed.
  const PathSums& edge(std::size_t i) const { return sums_[i]; }

 private:
  Eigen::Vector3d direction(std::size_t i) const {
    return {line_.scale * line_.across_x[i] + line_.offset[0],
            line_.scale * line_.across_y[i] + line_.offset[1],
            line_.scale * line_.across_z[i] + line_.offset[2]};
  }

  const PreparedEnvironment& environment_;
  const CornerGrid& grid_;
  std::size_t count_;
  DirectionLine line_{};
  SourceTexel first_;  // of the first corner
  std::vector<std::int32_t> inside_;
  std::vector<MapPoint> points_;
  std::vector<PathSums> sums_;
  std::vector<std::uint8_t> has_point_, has_sums_;
};

/// Integrates an environment over the texels of successive rows.
class TexelRows {
 public:
  TexelRows(const PreparedEnvironment& environment, const CornerGrid& grid, int first_row)
      : environment_(environment),
        row_(first_row),
        edges_(static_cast<std::size_t>(grid.edges_per_texel())),
        above_(std::make_unique<CornerLine>(environment, grid)),
        below_(std::make_unique<CornerLine>(environment, grid)),
        batch_(environment),
        mixed_(static_cast<std::size_t>(grid.columns())),
        sides_(mixed_.size() + 1) {
    below_->set(first_row);
  }

  /// On to the next row, the first one to begin with.
  void advance() {
    std::swap(above_, below_);
    below_->set(++row_);
    find_mixed();
    bool has_left = false;
    for (std::size_t x = 0; x < mixed_.size(); ++x) {
      if (mixed_[x] == 0) {
        has_left = false;
        continue;
      }
      if (!has_left) add_side(x);
      add_side(x + 1);
      has_left = true;
      for (std::size_t i = x * edges_; i < (x + 1) * edges_; ++i) {
        above_->add_edge(i, batch_);
        below_->add_edge(i, batch_);
      }
    }
    batch_.flush();
  }

  /// Whether texel `x` has the same radiance all over it, and so has the one before; then both have the same.
  bool continues(int x) const {
    return x > 0 && mixed_[static_cast<std::size_t>(x)] == 0 && mixed_[static_cast<std::size_t>(x) - 1] == 0;
  }
  /// Radiance of the row's texel `x` where it is constant; else nullptr, and the integral over the texel in
  /// `light`.
  const float* texel(int x, Eigen::Vector3d& light) const {
    const auto at = static_cast<std::size_t>(x);
    if (mixed_[at] == 0)
      return environment_.map().radiance.values.data() + std::ptrdiff_t{3} * above_->inside(at * edges_);
    PathSums around = sides_[at];
    around -= sides_[at + 1];
    for (std::size_t i = at * edges_; i < (at + 1) * edges_; ++i) {
      around += below_->edge(i);
      around -= above_->edge(i);
    }
    light = environment_.enclosed(around);
    return nullptr;
  }

 private:
  /// Which texels of the row do not lie inside one of the environment.
  void find_mixed() {
    const std::int32_t *above = above_->inside().data(), *below = below_->inside().data();
    const std::size_t count = mixed_.size(), edges = edges_;
    std::int32_t* mixed = mixed_.data();
    if (edges == 1) {  // in vectors
      for (std::size_t x = 0; x < count; ++x)
        mixed[x] = ((above[x] ^ above[x + 1]) | (above[x] ^ below[x]) | (above[x] ^ below[x + 1])) |
                   (above[x] & std::numeric_limits<std::int32_t>::min());
      return;
    }
    for (std::size_t x = 0; x < count; ++x) {
      const std::int32_t source = above[x * edges];
      mixed[x] = source & std::numeric_limits<std::int32_t>::min();
      for (std::size_t i = x * edges; i <= (x + 1) * edges; ++i)
        mixed[x] |= (above[i] ^ source) | (below[i] ^ source);
    }
  }

  /// Asks for the sums down the left edge of texel `x`.
  void add_side(std::size_t x) {
    batch_.add(above_->point(x * edges_), below_->point(x * edges_), sides_[x]);
  }

  const PreparedEnvironment& environment_;
  int row_;
  std::size_t edges_;
  std::unique_ptr<CornerLine> above_, below_;
  PathBatch<PathSums> batch_;
  std::vector<std::int32_t> mixed_;  // 0: no
  std::vector<PathSums> sides_;      // down the edges beside mixed texels
};

}  // namespace

EnvironmentProjector::EnvironmentProjector(const LightDomain& target,
                                           std::span<const MonitorPlacement> monitors, const RunContext& run)
    : grid_(target, monitors) {
  if (target.parameterisation == Parameterisation::lat_long) {
    const int edges = CornerGrid::lat_long_edges(target.width);
    for (int y = 0; y < target.height; ++y) {
      SphericalPolygon part;
      for (const auto& [column, row] : {std::pair{0, y}, {1, y}, {1, y + 1}, {0, y + 1}})
        part.push_back(lat_long_direction(column, row, edges * target.width, target.height));
      solid_angles_.push_back(static_cast<float>(edges * solid_angle(part)));
    }
    return;
  }
  const bool has_windows = target.parameterisation == Parameterisation::monitor;  // else a cube's first face
  const auto first = grid_.patches().begin(), last = has_windows ? grid_.patches().end() : first + 1;
  for (auto patch = first; patch != last; ++patch) {
    const std::size_t start = solid_angles_.size();
    const auto columns = static_cast<std::size_t>(patch->columns());
    solid_angles_.resize(start + columns * static_cast<std::size_t>(patch->rows()));
    tbb::parallel_for(0, patch->rows(), [&](int y) {
      for (int x = 0; x < patch->columns(); ++x)
        solid_angles_[start + columns * static_cast<std::size_t>(y) + static_cast<std::size_t>(x)] =
            static_cast<float>(rectangle_angle(*patch, x, y));
    });
    seen_ += solid_angle(patch->outline());
  }
  if (grid_.patches().size() > 1 && has_windows) find_shared_texels(run);
}

EnvironmentLight EnvironmentProjector::project(const LightMap& environment, const EulerAngles& turn,
                                               const RunContext& run) const {
  if (auto light = as_it_stands(environment, turn)) return {std::move(*light), {}};
  return project(PreparedEnvironment(environment, run), turn, run);
}

EnvironmentLight EnvironmentProjector::project(const PreparedEnvironment& environment,
                                               const EulerAngles& turn, const RunContext& run) const {
  if (!environment.has_path_sums()) return project_exactly(environment, turn, run);
  if (auto light = as_it_stands(environment.map(), turn)) return {std::move(*light), {}};
  const LightDomain& domain = target();
  const Eigen::Matrix3d environment_from_scene = rotation_of(turn).transpose();
  EnvironmentLight result{{Image(domain.width, domain.height, 3), domain.parameterisation}, {}};
  std::vector<double> energy(static_cast<std::size_t>(domain.height), 0.0);
  const bool is_lat_long = domain.parameterisation == Parameterisation::lat_long;
  const auto project_rows = [&](const CornerGrid& grid, int first_row, int begin, int end) {
    run.throw_if_stopped();
    TexelRows rows(environment, grid, begin);
    auto shared = std::ranges::lower_bound(shared_texels_, first_row + begin, {}, &SharedTexel::y);
    for (int y = begin; y < end; ++y) {
      rows.advance();
      float* out = result.light.radiance.row(first_row + y).data();
      Eigen::Vector3d of_row = Eigen::Vector3d::Zero();
      const float* angles = solid_angles_of(first_row + y);
      for (int x = 0; x < domain.width; ++x, out += 3) {
        Eigen::Vector3d light = Eigen::Vector3d::Zero();
        double angle = is_lat_long ? angles[0] : angles[x];
        const float* constant = rows.texel(x, light);
        if (constant && window_shares_.empty()) {
          std::copy_n(constant, 3, out);
          for (; x + 1 < domain.width && rows.continues(x + 1); ++x) {
            out += 3;
            std::copy_n(constant, 3, out);
            angle += is_lat_long ? angles[0] : angles[x + 1];
          }
          for (int c = 0; c < 3; ++c) of_row[c] += angle * constant[c];
          continue;
        }
        if (constant)
          for (int c = 0; c < 3; ++c) light[c] = angle * constant[c];
        if (!window_shares_.empty()) {
          const float share = window_shares_[static_cast<std::size_t>(first_row + y) *
                                                 static_cast<std::size_t>(domain.width) +
                                             static_cast<std::size_t>(x)];
          light *= share;
          if (shared != shared_texels_.end() && shared->y == first_row + y && shared->x == x) {
            light.setZero();
            for (const SeenPart& part : shared->parts)
              light += integral(environment, environment_from_scene, part.outline) / part.windows;
            ++shared;
          }
        }
        const double reciprocal = 1.0 / angle;
        for (int c = 0; c < 3; ++c) {
          out[c] = static_cast<float>(light[c] * reciprocal);
          of_row[c] += light[c];
        }
      }
      energy[static_cast<std::size_t>(first_row) + y] = of_row[0] + of_row[1] + of_row[2];
    }
  };
  for (const SpherePatch& patch : grid_.patches()) {
    const CornerGrid grid(grid_, patch, environment_from_scene);
    constexpr std::size_t rows_per_task = 16;
    tbb::parallel_for(tbb::blocked_range<int>(0, grid.rows(), rows_per_task), [&](const auto& range) {
      project_rows(grid, is_lat_long ? 0 : patch.first_row, range.begin(), range.end());
    });
    if (is_lat_long) break;
  }
  result.share = share_of(energy, environment);
  return result;
}

EnvironmentShare EnvironmentProjector::share_of(const std::vector<double>& energy,
                                                const PreparedEnvironment& environment) const {
  if (target().parameterisation != Parameterisation::monitor) return {};
  const double all = std::accumulate(energy.begin(), energy.end(), 0.0);
  return {seen_ / (4.0 * pi), environment.energy() > 0.0 ? all / environment.energy() : 1.0};
}

bool box_sums_suffice(const LightBasis& basis) {
  return basis.measure == Measure::solid_angle && basis.first_vector_box() == 0 && basis.size() > 0 &&
         basis.domain.parameterisation == Parameterisation::cube && basis.domain.height <= small_box_limit;
}

BoxProjector::Edges::Edges(int resolution, std::span<const SmallBox> boxes) : resolution_(resolution) {
  // Ends of edges on each grid line of each face, then the lines' stops one after another.
  const auto lines_per_face = 2 * (static_cast<std::size_t>(resolution) + 1);
  std::vector<std::vector<std::int16_t>> ends(lines_per_face * cube_faces);
  const auto line_number = [&](int face, bool is_column, int edge) {
    return static_cast<std::size_t>(face) * lines_per_face +
           (is_column ? static_cast<std::size_t>(resolution) + 1 : 0) + static_cast<std::size_t>(edge);
  };
  const auto for_pieces = [&](const auto& use) {
    for (std::size_t k = 0; k < boxes.size(); ++k)
      for (int face = boxes[k].y0 / resolution; face * resolution < boxes[k].y1; ++face)
        use(k, face, std::max(boxes[k].y0 - face * resolution, 0),
            std::min(boxes[k].y1 - face * resolution, resolution));
  };
  for_pieces([&](std::size_t k, int face, int y0, int y1) {
    const auto add = [&](bool is_column, int edge, int from, int to) {
      auto& stops = ends[line_number(face, is_column, edge)];
      stops.push_back(static_cast<std::int16_t>(from));
      stops.push_back(static_cast<std::int16_t>(to));
    };
    add(false, y0, boxes[k].x0, boxes[k].x1);
    add(false, y1, boxes[k].x0, boxes[k].x1);
    add(true, boxes[k].x0, y0, y1);
    add(true, boxes[k].x1, y0, y1);
  });
  std::vector<std::size_t> first_stop(ends.size(), 0);
  for (std::size_t number = 0; number < ends.size(); ++number) {
    auto& stops = ends[number];
    std::ranges::sort(stops);
    stops.erase(std::unique(stops.begin(), stops.end()), stops.end());
    first_stop[number] = stops_.size();
    if (stops.empty()) continue;
    const std::size_t in_face = number % lines_per_face, columns_from = lines_per_face / 2;
    const bool is_column = in_face >= columns_from;
    lines_.push_back({static_cast<int>(number / lines_per_face),
                      static_cast<int>(is_column ? in_face - columns_from : in_face), is_column,
                      stops_.size(), stops_.size() + stops.size()});
    stops_.insert(stops_.end(), stops.begin(), stops.end());
  }
  for_pieces([&](std::size_t k, int face, int y0, int y1) {
    const auto ends_of = [&](bool is_column, int edge, int from, int to) {
      const std::size_t number = line_number(face, is_column, edge);
      const auto place = [&](int at) {
        const auto& stops = ends[number];
        return static_cast<std::uint32_t>(
            first_stop[number] +
            static_cast<std::size_t>(std::ranges::lower_bound(stops, at) - stops.begin()));
      };
      return std::array{place(from), place(to)};
    };
    while (first_piece_.size() <= k) first_piece_.push_back(pieces_.size());
    pieces_.push_back({ends_of(false, y0, boxes[k].x0, boxes[k].x1),
                       ends_of(false, y1, boxes[k].x0, boxes[k].x1), ends_of(true, boxes[k].x0, y0, y1),
                       ends_of(true, boxes[k].x1, y0, y1)});
  });
  while (first_piece_.size() <= boxes.size()) first_piece_.push_back(pieces_.size());
}

template <class Sums, class MakeBatch, class Visit>
void BoxProjector::Edges::sum_around(const PreparedEnvironment& environment,
                                     const Eigen::Matrix3d& environment_from_scene, const RunContext& run,
                                     const MakeBatch& make_batch, const Visit& visit) const {
  std::vector<Sums> up_to(stops_.size());  // along each line, from its first stop
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, lines_.size(), 8), [&](const auto& range) {
    run.throw_if_stopped();
    auto batch = make_batch();
    for (std::size_t number = range.begin(); number != range.end(); ++number) {
      const Line& line = lines_[number];
      const Eigen::Matrix3d axes = environment_from_scene * cube_face_axes(line.face).transpose();
      const auto point = [&](std::size_t stop, const SourceTexel& near) {
        const double edge = 2.0 * line.edge / resolution_ - 1.0, at = 2.0 * stops_[stop] / resolution_ - 1.0;
        return environment.point(
            axes * (line.is_column ? Eigen::Vector3d(edge, -at, 1.0) : Eigen::Vector3d(at, -edge, 1.0)),
            near);
      };
      MapPoint before = point(line.first, {});
      for (std::size_t stop = line.first + 1; stop < line.last; ++stop) {
        const MapPoint next = point(stop, before.texel);
        batch.add(before, next, up_to[stop]);
        before = next;
      }
    }
    batch.flush();
    for (std::size_t number = range.begin(); number != range.end(); ++number)
      for (std::size_t stop = lines_[number].first + 1; stop < lines_[number].last; ++stop)
        up_to[stop] += up_to[stop - 1];
  });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes(), 1024), [&](const auto& range) {
    const auto edge = [&](const std::array<std::uint32_t, 2>& ends) {
      Sums sum = up_to[ends[1]];
      sum -= up_to[ends[0]];
      return sum;
    };
    for (std::size_t box = range.begin(); box < range.end(); ++box)
      for (std::size_t at = first_piece_[box]; at < first_piece_[box + 1]; ++at) {
        const Piece& piece = pieces_[at];
        Sums around = edge(piece.bottom);
        around -= edge(piece.right);
        around -= edge(piece.top);
        around += edge(piece.left);
        visit(box, around);
      }
  });
}

namespace {

std::vector<SmallBox> distinct_boxes(std::span<const VectorBox> kernels) {
  std::vector<SmallBox> boxes;
  for (const std::size_t first : firsts_of_boxes(kernels))
    if (first < kernels.size()) boxes.push_back(small_box(kernels[first].box));
  return boxes;
}

}  // namespace

BoxProjector::BoxProjector(int resolution, std::span<const VectorBox> vector_boxes,
                           std::span<const SmallBox> boxes)
    : vector_boxes_(vector_boxes.begin(), vector_boxes.end()),
      first_of_box_(firsts_of_boxes(vector_boxes)),
      vector_edges_(resolution, distinct_boxes(vector_boxes)),
      edges_(resolution, boxes) {}

std::vector<float> BoxProjector::project(const PreparedEnvironment& environment, const EulerAngles& turn,
                                         const RunContext& run) const {
  if (!environment.has_path_sums())
    throw InputError("this environment is integrated over texels alone; give a lat-long map of 16 columns");
  const Eigen::Matrix3d scene_from_environment = rotation_of(turn),
                        environment_from_scene = scene_from_environment.transpose();
  std::vector<float> sums((vector_boxes_.size() + edges_.boxes()) * 3, 0.0f);
  if (!vector_boxes_.empty()) {
    environment.prepare_vectors(run);
    vector_edges_.sum_around<VectorPathSums>(
        environment, environment_from_scene, run, [&] { return PathBatch<VectorPathSums>(environment); },
        [&](std::size_t box, const VectorPathSums& around) {
          const Eigen::Matrix3d light = scene_from_environment * environment.enclosed(around);
          for (std::size_t k = first_of_box_[box]; k < first_of_box_[box + 1]; ++k) {
            Eigen::Map<Eigen::RowVector3f> of_kernel(&sums[3 * k]);
            of_kernel = (vector_boxes_[k].vector.cast<double>().transpose() * light).cast<float>();
          }
        });
  }
  std::vector<Eigen::Vector3d> of_boxes(edges_.boxes(), Eigen::Vector3d::Zero());
  edges_.sum_around<PathSums>(
      environment, environment_from_scene, run, [&] { return PathBatch<PathSums>(environment); },
      [&](std::size_t box, const PathSums& around) { of_boxes[box] += environment.enclosed(around); });
  for (std::size_t i = 0; i < 3 * of_boxes.size(); ++i)
    sums[3 * vector_boxes_.size() + i] =
        static_cast<float>(of_boxes[i / 3][static_cast<Eigen::Index>(i % 3)]);
  return sums;
}

EnvironmentLight EnvironmentProjector::project_exactly(const PreparedEnvironment& environment,
                                                       const EulerAngles& turn, const RunContext& run) const {
  const LightMap& map = environment.map();
  if (auto light = as_it_stands(map, turn)) return {std::move(*light), {}};
  const LightDomain& domain = grid_.domain();
  const SphereGrid source(map.domain());
  const Eigen::Matrix3d environment_from_scene = rotation_of(turn).transpose();
  EnvironmentLight result{{Image(domain.width, domain.height, 3), domain.parameterisation}, {}};
  std::vector<double> energy(static_cast<std::size_t>(domain.height), 0.0);
  Progress progress(run, "resampling the map", static_cast<std::uint64_t>(domain.height));
  tbb::parallel_for(0, domain.height, [&](int y) {
    run.throw_if_stopped();
    OverlapFinder finder(source);
    std::vector<TexelSums> row(domain.width);
    for (const SpherePatch& patch : grid_.patches()) {
      if (y < patch.first_row || y >= patch.first_row + patch.rows()) continue;
      for (int x = 0; x < patch.columns(); ++x) {
        for (SeenPart& part : parts_of(patch.texel(x, y - patch.first_row), patch)) {
          for (Eigen::Vector3d& corner : part.outline) corner = environment_from_scene * corner;
          row[patch.first_column + x].add(finder.find(part.outline), part.windows, map.radiance);
        }
      }
    }
    for (int x = 0; x < domain.width; ++x)
      for (int c = 0; c < 3; ++c) {
        result.light.radiance.at(x, y, c) = static_cast<float>(row[x].energy[c] / row[x].solid_angle);
        energy[y] += row[x].energy[c];
      }
    progress.advance();
  });
  result.share = share_of(energy, environment);
  return result;
}

}  // namespace refield
