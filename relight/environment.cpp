// SPDX-License-Identifier: Apache-2.0
#include "relight/environment.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "relight/sequence.h"

namespace refield {

namespace {

using std::numbers::pi;

/// Radiance times solid angle over the whole map, all channels together.
double energy_of(const LightMap& environment) {
  const Image& map = environment.radiance;
  const bool is_cube = environment.parameterisation == Parameterisation::cube;
  const SphereGrid cube =
      is_cube ? SphereGrid(environment.domain()) : SphereGrid({1, 1, Parameterisation::lat_long});
  double energy = 0.0;
  for (int y = 0; y < map.height; ++y) {
    const auto row = map.row(y);
    const double ring = 2.0 * pi * (std::cos(pi * y / map.height) - std::cos(pi * (y + 1) / map.height));
    for (int x = 0; x < map.width; ++x) {
      const double angle =
          is_cube ? solid_angle(cube.patches()[0].texel(x, y % map.width)) : ring / map.width;
      energy += angle * (static_cast<double>(row[3 * x]) + row[3 * x + 1] + row[3 * x + 2]);
    }
  }
  return energy;
}

/// Of one texel of the light map.
struct TexelSums {
  double energy[3] = {};     ///< radiance times solid angle
  double solid_angle = 0.0;  ///< of the texel
  double own = 0.0;          ///< of it, what is not left to other windows

  void add(const std::vector<TexelOverlap>& overlaps, int windows, const Image& radiance) {
    for (const TexelOverlap& overlap : overlaps) {
      const double share = overlap.solid_angle / windows;
      solid_angle += overlap.solid_angle;
      own += share;
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

LightMap read_environment(const std::filesystem::path& path) {
  const ImageHeader header = read_image_header(path);
  if (const auto kind = environment_kind(header.width, header.height)) return read_light_map(path, *kind);
  throw InputError(path.string() + ": is " + std::to_string(header.width) + "×" +
                   std::to_string(header.height) +
                   ", which is no environment: give a lat-long map (twice as wide as high) or a cube (six "
                   "square faces above one another, +X −X +Y −Y +Z −Z)");
}

EnvironmentProjector::EnvironmentProjector(const LightDomain& target,
                                           std::span<const MonitorPlacement> monitors)
    : grid_(target, monitors) {}

std::vector<SeenPart> EnvironmentProjector::parts_of(const SphericalPolygon& texel,
                                                     const SpherePatch& window) const {
  std::vector<SeenPart> parts{{texel, 1}};
  if (grid_.domain().parameterisation == Parameterisation::monitor)
    for (const SpherePatch& other : grid_.patches())
      if (&other != &window) parts = divided(std::move(parts), other);
  return parts;
}

EnvironmentLight EnvironmentProjector::project(const LightMap& environment, const Turn& turn) const {
  const LightDomain& domain = grid_.domain();
  if (environment.parameterisation == Parameterisation::monitor)
    throw InputError("a monitor's light map is no environment; give a lat-long map or a cube");
  if (environment.domain() == domain) {
    if (turn.is_none()) return {environment, {}};
    if (domain.parameterisation == Parameterisation::lat_long && Turn{0.0, turn.pitch, turn.roll}.is_none())
      return {rotated(environment, turn.yaw / 360.0), {}};
  }
  const SphereGrid source(environment.domain());
  const Eigen::Matrix3d environment_from_scene = turn.matrix().transpose();
  EnvironmentLight result{{Image(domain.width, domain.height, 3), domain.parameterisation}, {}};
  std::vector<double> covered(domain.height), energy(domain.height);
  Progress progress("resample the map", static_cast<std::uint64_t>(domain.height));
  tbb::parallel_for(0, domain.height, [&](int y) {
    throw_if_interrupted();
    OverlapFinder finder(source);
    std::vector<TexelSums> row(domain.width);
    for (const SpherePatch& patch : grid_.patches()) {
      if (y < patch.first_row || y >= patch.first_row + patch.rows()) continue;
      for (int x = 0; x < patch.columns(); ++x) {
        for (SeenPart& part : parts_of(patch.texel(x, y - patch.first_row), patch)) {
          for (Eigen::Vector3d& corner : part.outline) corner = environment_from_scene * corner;
          row[patch.first_column + x].add(finder.find(part.outline), part.windows, environment.radiance);
        }
      }
    }
    for (int x = 0; x < domain.width; ++x)
      for (int c = 0; c < 3; ++c) {
        result.light.radiance.at(x, y, c) = static_cast<float>(row[x].energy[c] / row[x].solid_angle);
        energy[y] += row[x].energy[c];
      }
    for (const TexelSums& texel : row) covered[y] += texel.own;
    progress.advance();
  });
  double seen = 0.0, sphere = 0.0;
  for (int y = 0; y < domain.height; ++y) {
    seen += energy[y];
    sphere += covered[y];
  }
  const double whole = energy_of(environment);
  result.share = {sphere / (4.0 * pi), whole > 0.0 ? seen / whole : 1.0};
  return result;
}

}  // namespace refield
