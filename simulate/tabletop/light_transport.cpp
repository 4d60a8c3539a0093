// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/light_transport.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "core/base/rng.h"
#include "simulate/tabletop/surface.h"

namespace refield {

namespace {
constexpr int coarsest_share_of_width = 16;
}

LightHierarchy::LightHierarchy(const LightDomain& domain) : domain_(domain) {
  for (int level = 0; level == 0 || (1 << level) * coarsest_share_of_width <= domain.width; ++level) {
    const int side = 1 << level;
    levels_.push_back({size_, (domain.width + side - 1) / side, (domain.height + side - 1) / side});
    size_ += static_cast<std::uint32_t>(levels_.back().columns) * levels_.back().rows;
  }
}

Box LightHierarchy::box(int level, int column, int row) const {
  return {column << level, row << level, std::min((column + 1) << level, domain_.width),
          std::min((row + 1) << level, domain_.height)};
}

Box LightHierarchy::box(std::uint32_t node) const {
  int level = coarsest_level();
  while (levels_[level].first > node) --level;
  const auto within = static_cast<int>(node - levels_[level].first);
  return box(level, within % levels_[level].columns, within / levels_[level].columns);
}

namespace {
constexpr double negligible_share = 1e-5;
}

TransportRow::TransportRow(const LightHierarchy& hierarchy)
    : hierarchy_(&hierarchy), sum_(hierarchy.size(), Rgb::Zero()), is_touched_(hierarchy.size(), 0) {}

std::vector<TransportEntry> TransportRow::take() {
  std::ranges::sort(touched_);
  const auto light_of = [&](std::uint32_t node) {  // under a white light
    return (sum_[node] * static_cast<float>(hierarchy_->box(node).area())).cast<double>().eval();
  };
  Eigen::Array3d total = Eigen::Array3d::Zero(), kept = Eigen::Array3d::Zero();
  for (std::uint32_t node : touched_) total += light_of(node);
  const double negligible = negligible_share * total.sum();
  const auto matters = [&](std::uint32_t node) { return light_of(node).sum() > negligible; };
  for (std::uint32_t node : touched_)
    if (matters(node)) kept += light_of(node);
  const Rgb scale = (kept > 0.0).select(total / kept, 1.0).cast<float>();

  std::vector<TransportEntry> entries;
  for (std::uint32_t node : touched_) {
    if (matters(node)) {
      const Rgb weight = sum_[node] * scale;
      entries.push_back({node, {weight[0], weight[1], weight[2]}});
    }
    sum_[node] = Rgb::Zero();
    is_touched_[node] = 0;
  }
  touched_.clear();
  return entries;
}

namespace {

/// A footprint is made of boxes of the level on which it spans at most this many a side.
constexpr float max_boxes_a_side = 8.0f;

/// The part of [low, high) that lies in [begin, end).
float overlap(float low, float high, int begin, int end) {
  return std::max(0.0f, std::min(high, static_cast<float>(end)) - std::max(low, static_cast<float>(begin)));
}

}  // namespace

Eigen::Vector2f SpecularFootprints::extent(const Sample& sample) const {
  // Mean step to the neighbours in each direction of the grid; together they span the sample's parallelogram.
  Eigen::Vector2f sum = Eigen::Vector2f::Zero();
  for (const bool across : {true, false}) {
    Eigen::Vector2f steps = Eigen::Vector2f::Zero();
    int count = 0;
    for (const Sample& other : samples_) {
      const int di = std::abs(other.i - sample.i), dj = std::abs(other.j - sample.j);
      if (other.path != sample.path || di != (across ? 1 : 0) || dj != (across ? 0 : 1)) continue;
      steps += (other.position - sample.position).cwiseAbs();
      ++count;
    }
    if (count > 0) sum += steps / static_cast<float>(count);
  }
  return sum;
}

void SpecularFootprints::deposit(const LightHierarchy& hierarchy, TransportRow& row) const {
  const LightDomain& domain = hierarchy.domain();
  const auto clipped = [](float centre, float extent, int size) {
    const auto length = static_cast<float>(size);
    const float half = std::max(0.5f * extent, 1e-3f);
    return std::pair{std::clamp(centre - half, 0.0f, length - 1e-3f),
                     std::clamp(centre + half, 1e-3f, length)};
  };
  for (const Sample& sample : samples_) {
    const Eigen::Vector2f size = extent(sample);
    int level = 0;
    while (level < hierarchy.coarsest_level() && std::ldexp(max_boxes_a_side, level) < size.maxCoeff())
      ++level;
    const auto [left, right] = clipped(sample.position.x(), size.x(), domain.width);
    const auto [top, bottom] = clipped(sample.position.y(), size.y(), domain.height);
    const float area = (right - left) * (bottom - top);
    for (int j = static_cast<int>(top) >> level; j < hierarchy.rows(level); ++j) {
      if (static_cast<float>(j << level) >= bottom) break;
      for (int i = static_cast<int>(left) >> level; i < hierarchy.columns(level); ++i) {
        if (static_cast<float>(i << level) >= right) break;
        const Box box = hierarchy.box(level, i, j);
        const float share =
            overlap(left, right, box.x0, box.x1) * overlap(top, bottom, box.y0, box.y1) / area;
        if (share > 0.0f) row.add_mean(hierarchy.node(level, i, j), sample.throughput * share);
      }
    }
  }
}

namespace {

using Eigen::Vector3f;
using MaterialKind = MaterialDescription::Kind;

// Mirrors and glass surfaces in a row; what is lost behind is below a hundredth of a per cent for glass.
constexpr int longest_specular_chain = 16;
// GGX α of surfaces that light meets on its way to what the camera sees.
constexpr float smallest_alpha_further_on = 0.7f;
// Light on such a surface is sampled once in every group of that many coarsest boxes in width and height.
constexpr int group_side = 4;
// Light wanders about inside translucent things: paths from them are this many times as many.
constexpr int translucent_factor = 3;

// Evenly spread points in the unit square: the R2 sequence (Roberts 2018) with a random shift. All samples of
// a pixel take from one sequence, so that they complete one another.
class SpreadPoints {
 public:
  explicit SpreadPoints(Rng& rng) : u_(rng.uniform()), v_(rng.uniform()) {}
  std::pair<float, float> next() {
    u_ += 0.7548776662466927;
    v_ += 0.5698402909980532;
    u_ -= std::floor(u_);
    v_ -= std::floor(v_);
    constexpr float below_one = 0x1.fffffep-1f;
    return {std::min(static_cast<float>(u_), below_one), std::min(static_cast<float>(v_), below_one)};
  }

 private:
  double u_, v_;
};

}  // namespace

TraceScratch::TraceScratch(const LightHierarchy& hierarchy)
    : lattice((2 * static_cast<std::size_t>(hierarchy.domain().width) + 1) *
              (2 * static_cast<std::size_t>(hierarchy.domain().height) + 1)),
      row(hierarchy) {}

TraceOptions TraceOptions::of_quality(int level, std::uint64_t seed) {
  TraceOptions options;
  options.seed = seed;
  switch (level) {
    case 1:
      options.pixel_grid = 1;
      options.specular_grid = 3;
      options.secondary_rays = 4;
      options.caustic_rays = 4;
      options.tolerance = 0.5;
      options.energy = 6e-4;
      options.centre_samples = false;
      options.depth = 2;
      return options;
    case 2:
      return options;
    case 3:
      options.specular_grid = 6;
      options.secondary_rays = 32;
      options.caustic_rays = 96;
      options.tolerance = 0.2;
      options.energy = 2e-4;
      options.same_paths = true;
      return options;
    default:
      throw InputError("quality ", level, ": give 1 (quick), 2 or 3 (least noise)");
  }
}

namespace {

/// Light that falls straight from the monitor on a surface, into the boxes of a pixel's row.
class MonitorLight {
 public:
  MonitorLight(const TabletopScene& scene, const LightHierarchy& hierarchy, const TraceOptions& options,
               TraceScratch& memory)
      : scene_(scene), monitor_(scene.monitor()), hierarchy_(hierarchy), options_(options), memory_(memory) {}

  /// By all boxes, divided where the integrand varies. `share`: how much of the pixel the surface makes up.
  void integrate(const Surface& surface, const Rgb& throughput, double share, Rng& rng) {
    ++memory_.stamp;
    shift_x_ = static_cast<float>(rng.uniform(-0.5, 0.5));
    shift_y_ = static_cast<float>(rng.uniform(-0.5, 0.5));
    const int top = hierarchy_.coarsest_level();
    double total = 0.0;
    for (int row = 0; row < hierarchy_.rows(top); ++row)
      for (int column = 0; column < hierarchy_.columns(top); ++column) {
        const Box box = hierarchy_.box(top, column, row);
        total += estimate(surface, box).mean.sum() * static_cast<double>(box.area());
      }
    if (!(total > 0.0 && share > 0.0)) return;
    const auto spread_limit = static_cast<float>(options_.energy * total / share);
    for (int row = 0; row < hierarchy_.rows(top); ++row)
      for (int column = 0; column < hierarchy_.columns(top); ++column)
        divide(surface, throughput, top, column, row, spread_limit);
  }

  /// By one random point in one random box of each group of the coarsest boxes.
  void sample(const Surface& surface, const Rgb& weight, Rng& rng) {
    const int top = hierarchy_.coarsest_level();
    const int columns = hierarchy_.columns(top), rows = hierarchy_.rows(top);
    for (int row = 0; row < rows; row += group_side)
      for (int column = 0; column < columns; column += group_side) {
        const int across = std::min(group_side, columns - column), down = std::min(group_side, rows - row);
        const auto chosen = static_cast<int>(rng.below(static_cast<std::uint64_t>(across) * down));
        const int i = column + chosen % across, j = row + chosen / across;
        const Box box = hierarchy_.box(top, i, j);
        const auto x = static_cast<float>(rng.uniform(box.x0, box.x1));
        const auto y = static_cast<float>(rng.uniform(box.y0, box.y1));
        const Rgb found = integrand(surface, x, y);
        if (found.maxCoeff() > 0.0f)
          memory_.row.add(hierarchy_.node(top, i, j),
                          weight * found * (monitor_.texel_area() * static_cast<float>(across * down)));
      }
  }

 private:
  // The monitor's radiance at a point (column, row) of it, times the result and a texel's area, is what the
  // surface scatters from there to the viewer: f cos θ · cos θ' / r² · visibility.
  Rgb integrand(const Surface& surface, float column, float row) {
    const Vector3f target = monitor_.point(column, row);
    Vector3f direction = target - surface.position();
    const float distance2 = direction.squaredNorm();
    direction /= std::sqrt(distance2);
    const float emission_cosine = -direction.dot(monitor_.normal());
    if (emission_cosine <= 0.0f) return Rgb::Zero();
    const Rgb scattered = surface.scattering(direction);
    if (!(scattered.maxCoeff() > 0.0f)) return Rgb::Zero();
    ++memory_.rays;
    if (scene_.occluded(surface.off_surface(direction), target)) return Rgb::Zero();
    return scattered * (emission_cosine / distance2);
  }

  // The integrand at a lattice point, in half texels. All points of a sample are shifted together by a random
  // part of a half texel: so their mean over samples has no grid.
  const Rgb& lattice_value(const Surface& surface, int column, int row) {
    const LightDomain& domain = hierarchy_.domain();
    TraceScratch::LatticeValue& known =
        memory_.lattice[static_cast<std::size_t>(row) * (2 * domain.width + 1) + column];
    if (known.stamp != memory_.stamp) {
      known.stamp = memory_.stamp;
      const auto position = [](int half_texels, float shift, int count) {
        return std::clamp(0.5f * (static_cast<float>(half_texels) + shift), 0.0f, static_cast<float>(count));
      };
      known.value = integrand(surface, position(column, shift_x_, domain.width),
                              position(row, shift_y_, domain.height));
    }
    return known.value;
  }

  // Mean of the integrand over a box, and its spread.
  struct BoxEstimate {
    Rgb mean;
    float spread, largest;  // of the sum of channels
  };
  BoxEstimate estimate(const Surface& surface, const Box& box) {
    const std::array<Rgb, 4> corners{
        lattice_value(surface, 2 * box.x0, 2 * box.y0), lattice_value(surface, 2 * box.x1, 2 * box.y0),
        lattice_value(surface, 2 * box.x0, 2 * box.y1), lattice_value(surface, 2 * box.x1, 2 * box.y1)};
    float low = corners[0].sum(), high = low;
    Rgb sum = corners[0];
    for (int i = 1; i < 4; ++i) {
      sum += corners[i];
      low = std::min(low, corners[i].sum());
      high = std::max(high, corners[i].sum());
    }
    if (!options_.centre_samples) return {0.25f * sum, high - low, high};
    const Rgb& centre = lattice_value(surface, box.x0 + box.x1, box.y0 + box.y1);
    low = std::min(low, centre.sum());
    high = std::max(high, centre.sum());
    // Simpson's weights in the plane: exact for cubic integrands.
    return {(2.0f / 3.0f) * centre + (1.0f / 12.0f) * sum, high - low, high};
  }

  void divide(const Surface& surface, const Rgb& weight, int level, int column, int row, float spread_limit) {
    const Box box = hierarchy_.box(level, column, row);
    const BoxEstimate found = estimate(surface, box);
    if (found.largest <= 0.0f) return;
    if (level > 0 && found.spread > options_.tolerance * found.largest &&
        found.spread * static_cast<float>(box.area()) > spread_limit) {
      for (int j = 2 * row; j < std::min(2 * row + 2, hierarchy_.rows(level - 1)); ++j)
        for (int i = 2 * column; i < std::min(2 * column + 2, hierarchy_.columns(level - 1)); ++i)
          divide(surface, weight, level - 1, i, j, spread_limit);
      return;
    }
    memory_.row.add(hierarchy_.node(level, column, row), weight * found.mean * monitor_.texel_area());
  }

  const TabletopScene& scene_;
  const MonitorSurface& monitor_;
  const LightHierarchy& hierarchy_;
  const TraceOptions& options_;
  TraceScratch& memory_;
  float shift_x_ = 0.0f, shift_y_ = 0.0f;
};

/// The two rays that leave a mirror or glass surface for one that arrives.
struct SpecularRays {
  Ray mirrored, transmitted;
  float reflectance;  // of the mirrored ray: 1 of mirrors and beyond the critical angle
  bool can_transmit;
};

SpecularRays specular_rays(const MaterialDescription& material, const Hit& hit, const Ray& ray) {
  const bool outside = hit.geometric_normal.dot(ray.direction) < 0.0f;
  const Vector3f facing = outside ? hit.geometric_normal : (-hit.geometric_normal).eval();
  Vector3f normal = outside ? hit.shading_normal : (-hit.shading_normal).eval();
  if (normal.dot(ray.direction) >= 0.0f) normal = facing;
  const Ray mirrored{moved_off(hit.position, facing), reflected(ray.direction, normal)};
  if (material.kind == MaterialKind::mirror) return {mirrored, ray, 1.0f, false};
  // Radiance changes by the squared ratio of indices on entering and back on leaving: the factors cancel.
  const auto index = static_cast<float>(material.index_of_refraction);
  const float ratio = outside ? 1.0f / index : index;
  const auto direction = refracted(ray.direction, normal, ratio);
  const float reflectance = direction ? dielectric_reflectance(-ray.direction.dot(normal), ratio) : 1.0f;
  return {mirrored,
          {moved_off(hit.position, -facing), direction.value_or(ray.direction)},
          reflectance,
          direction.has_value()};
}

/// One pixel's paths: samples of the pixel, chains of mirrors and glass, and light by way of further
/// surfaces.
class PixelTracer {
 public:
  PixelTracer(const TabletopScene& scene, const LightHierarchy& hierarchy, const TraceOptions& options, int x,
              int y, TraceScratch& memory)
      : scene_(scene),
        monitor_(scene.monitor()),
        hierarchy_(hierarchy),
        options_(options),
        memory_(memory),
        direct_(scene, hierarchy, options, memory),
        rng_(options.seed, options.same_paths ? 0 : x, options.same_paths ? 0 : y),
        x_(x),
        y_(y),
        room_(scene.description().ambient_radiance) {
    aimed_points_.assign(scene.description().objects.size(), SpreadPoints(rng_));
  }

  PixelTransport trace() {
    const int grid = options_.pixel_grid;
    if (options_.specular_grid > grid && meets_specular(grid))
      trace_grid(options_.specular_grid);
    else
      trace_grid(grid);
    return {memory_.row.take(), ambient_};
  }

 private:
  Ray primary_ray(int grid, int i, int j) {
    const auto at = [&](int cell) {
      return (static_cast<float>(cell) + static_cast<float>(rng_.uniform())) / static_cast<float>(grid);
    };
    const float dx = at(i), dy = at(j);
    return scene_.camera_ray(static_cast<float>(x_) + dx, static_cast<float>(y_) + dy);
  }

  bool meets_specular(int grid) {
    for (int j = 0; j < grid; ++j)
      for (int i = 0; i < grid; ++i) {
        const auto hit = intersect(primary_ray(grid, i, j));
        if (hit && !hit->is_monitor() && is_specular(scene_.material_of(hit->object))) return true;
      }
    return false;
  }

  void trace_grid(int grid) {
    const float share = 1.0f / static_cast<float>(grid * grid);
    footprints_.clear();
    for (int j = 0; j < grid; ++j)
      for (int i = 0; i < grid; ++i) {
        cell_x_ = i;
        cell_y_ = j;
        follow(primary_ray(grid, i, j), Rgb::Constant(share), 0, 0);
      }
    footprints_.deposit(hierarchy_, memory_.row);
  }

  std::optional<Hit> intersect(const Ray& ray) {
    ++memory_.rays;
    return scene_.intersect(ray);
  }

  // A ray through any number of mirrors and glass surfaces to where it ends. `diffuse_depth` counts the other
  // surfaces that the path has met before; at 0 the camera sees the end, and all is done finely.
  // `path` has a bit for each surface so far, under a leading one: 1 for a reflection.
  void follow(Ray ray, Rgb throughput, int diffuse_depth, int chain, std::uint32_t path = 1) {
    for (; chain < longest_specular_chain; ++chain) {
      const auto hit = intersect(ray);
      if (!hit) {
        ambient_ += throughput * room_;
        return;
      }
      if (hit->is_monitor()) {
        meet_monitor(*hit, ray, throughput, diffuse_depth, path);
        return;
      }
      const MaterialDescription& material = scene_.material_of(hit->object);
      if (!is_specular(material)) {
        if (diffuse_depth == 0)
          shade_finely(Surface(scene_, *hit, -ray.direction), throughput);
        else
          shade_coarsely(Surface(scene_, *hit, -ray.direction, smallest_alpha_further_on), throughput,
                         diffuse_depth);
        return;
      }
      const SpecularRays next = specular_rays(material, *hit, ray);
      const bool is_mirror = material.kind == MaterialKind::mirror;
      bool reflects = is_mirror;
      if (is_mirror) {
        throughput *= material.colour;
      } else if (chain == 0 && diffuse_depth == 0 && next.can_transmit) {
        // Both ways where the camera sees them directly.
        follow(next.mirrored, throughput * next.reflectance, diffuse_depth, chain + 1, path << 1 | 1);
        throughput *= (1.0f - next.reflectance) * material.colour;
      } else {
        reflects = rng_.uniform() < next.reflectance;
        if (!reflects) throughput *= material.colour;
      }
      ray = reflects ? next.mirrored : next.transmitted;
      path = path << 1 | (reflects ? 1 : 0);
    }
  }

  void meet_monitor(const Hit& hit, const Ray& ray, const Rgb& throughput, int diffuse_depth,
                    std::uint32_t path) {
    if (ray.direction.dot(monitor_.normal()) >= 0.0f) return;  // its back
    if (diffuse_depth == 0) {
      footprints_.add(cell_x_, cell_y_, path, monitor_.texels_at(hit.position), throughput);
      return;
    }
    const Eigen::Vector2i texel = monitor_.texel_at(hit.position);
    memory_.row.add_mean(hierarchy_.node_of_texel(hierarchy_.coarsest_level(), texel.x(), texel.y()),
                         throughput);
  }

  // A surface that the camera sees, directly or in a mirror.
  void shade_finely(const Surface& surface, const Rgb& throughput) {
    const double full_share = 1.0 / (options_.pixel_grid * options_.pixel_grid);
    const double share = std::min(1.0, throughput.maxCoeff() / full_share);
    direct_.integrate(surface, throughput, share, rng_);
    scatter_further(surface, throughput, share);
  }

  // Light that comes by way of other surfaces. Rays towards mirrors and glass are aimed: the hemisphere is
  // divided by what a ray meets first.
  void scatter_further(const Surface& surface, const Rgb& throughput, double share) {
    std::vector<char>& aimed = aimed_;
    aimed.assign(scene_.description().objects.size(), 0);
    if (share > 0.2)
      for (std::size_t object = 0; object < aimed.size(); ++object)
        if (is_specular(scene_.material_of(static_cast<int>(object))))
          aimed[object] = aim_at(surface, throughput, static_cast<int>(object));
    const int count =
        std::max(1, static_cast<int>(std::lround(options_.secondary_rays * share *
                                                 (surface.is_translucent() ? translucent_factor : 1))));
    for (int k = 0; k < count; ++k) {
      const auto [u, v] = scattered_points_.next();
      const auto sample = surface.sample(u, v, static_cast<float>(rng_.uniform()));
      if (!sample) continue;
      const Rgb weight = throughput * sample->weight / static_cast<float>(count);
      scatter_along(surface, sample->direction, weight, 1, &aimed);
    }
  }

  void scatter_along(const Surface& surface, const Vector3f& direction, const Rgb& weight, int depth,
                     const std::vector<char>* aimed) {
    const Ray ray{surface.off_surface(direction), direction};
    const auto hit = intersect(ray);
    if (!hit) {
      ambient_ += weight * room_;
    } else if (hit->is_monitor()) {
      return;  // counted as direct light
    } else if (!is_specular(scene_.material_of(hit->object))) {
      shade_coarsely(Surface(scene_, *hit, -direction, smallest_alpha_further_on), weight, depth);
    } else if (depth == 1 && !(aimed && (*aimed)[hit->object])) {
      follow(ray, weight, depth, 0);
    }
  }

  // Returns false when the object cannot be aimed at, since the surface lies within its bounding sphere.
  bool aim_at(const Surface& surface, const Rgb& throughput, int object) {
    const BoundingSphere& bounds = scene_.bounds_of(object);
    const Vector3f axis = bounds.centre - surface.position();
    const float distance = axis.norm();
    if (distance <= bounds.radius * 1.01f) return false;
    const float sine = bounds.radius / distance;
    const float cosine_limit = std::sqrt(1.0f - sine * sine);
    const float solid_angle = 2.0f * std::numbers::pi_v<float> * (1.0f - cosine_limit);
    const int count =
        std::clamp(static_cast<int>(std::ceil(solid_angle * static_cast<float>(4 * options_.caustic_rays))),
                   1, options_.caustic_rays);
    for (int k = 0; k < count; ++k) {
      const auto [u, v] = aimed_points_[object].next();
      const Vector3f direction = sample_cone(axis / distance, cosine_limit, u, v);
      const Rgb scattered = surface.scattering(direction);
      if (!(scattered.maxCoeff() > 0.0f)) continue;
      const Ray ray{surface.off_surface(direction), direction};
      const auto hit = intersect(ray);
      if (hit && hit->object == object)
        follow(ray, throughput * scattered * (solid_angle / static_cast<float>(count)), 1, 0);
    }
    return true;
  }

  // A surface further along a path.
  void shade_coarsely(const Surface& surface, const Rgb& weight, int depth) {
    direct_.sample(surface, weight, rng_);
    if (depth >= options_.depth) return;
    const auto u = static_cast<float>(rng_.uniform()), v = static_cast<float>(rng_.uniform());
    const auto sample = surface.sample(u, v, static_cast<float>(rng_.uniform()));
    if (!sample) return;
    const float survival = std::min(1.0f, sample->weight.maxCoeff());  // Russian roulette
    if (rng_.uniform() >= survival) return;
    scatter_along(surface, sample->direction, weight * sample->weight / survival, depth + 1, nullptr);
  }

  const TabletopScene& scene_;
  const MonitorSurface& monitor_;
  const LightHierarchy& hierarchy_;
  const TraceOptions& options_;
  TraceScratch& memory_;
  MonitorLight direct_;
  Rng rng_;
  int x_, y_;
  Rgb room_;
  Rgb ambient_ = Rgb::Zero();
  SpecularFootprints footprints_;
  int cell_x_ = 0, cell_y_ = 0;  // of the sample that is being followed
  SpreadPoints scattered_points_{rng_};
  std::vector<SpreadPoints> aimed_points_;  // of each object
  std::vector<char> aimed_;
};

}  // namespace

PixelTransport trace_pixel(const TabletopScene& scene, const LightHierarchy& hierarchy,
                           const TraceOptions& options, int x, int y, TraceScratch& scratch) {
  return PixelTracer(scene, hierarchy, options, x, y, scratch).trace();
}

}  // namespace refield
