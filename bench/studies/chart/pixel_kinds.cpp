// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/pixel_kinds.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "simulate/tabletop/surface.h"

namespace refield::chart {

namespace fs = std::filesystem;

namespace {

constexpr int level_of_a_label = 50;

fs::path names_path(fs::path png) {
  return png.replace_extension(".json");
}

/// Level → name, from the file beside the picture.
std::vector<std::pair<int, std::string>> read_names(const fs::path& path) {
  const auto json = json_if_valid(read_text(path));
  const std::string form = "write an object such as {\"50\": \"diffuse\", \"100\": \"glossy\"}";
  if (!json.is_object()) throw FormatError(path, "is not a JSON object; " + form);
  std::vector<std::pair<int, std::string>> names;
  for (const auto& [key, value] : json.items()) {
    const int level = number_from_text<int>(key).value_or(-1);
    if (level < 0 || level > 255 || !value.is_string())
      throw FormatError(path, "'" + key + "' does not name a grey level from 0 to 255; " + form);
    names.emplace_back(level, value.get<std::string>());
  }
  return names;
}

}  // namespace

Mask PixelKinds::mask_of(std::size_t kind, const Mask& mask) const {
  Mask result(labels.size());
  for (std::size_t p = 0; p < labels.size(); ++p)
    result[p] = labels[p] == kind + 1 && (mask.empty() || mask[p]) ? 1 : 0;
  return result;
}

void write_pixel_kinds(const fs::path& png, const PixelKinds& kinds) {
  if (kinds.names.size() * level_of_a_label > 255)
    throw InputError(png.string() + ": " + std::to_string(kinds.names.size()) +
                     " pixel classes are too many; give at most five");
  Image image(kinds.width, kinds.height, 1);
  for (std::size_t p = 0; p < kinds.labels.size(); ++p)
    image.values[p] = linear_from_srgb(static_cast<float>(kinds.labels[p] * level_of_a_label) / 255.0f);
  Json names;
  for (std::size_t k = 0; k < kinds.names.size(); ++k)
    names[std::to_string((k + 1) * level_of_a_label)] = kinds.names[k];
  write_png(png, image);
  write_text_atomically(names_path(png), json_text(names, 2) + "\n");
}

PixelKinds read_pixel_kinds(const fs::path& png, int width, int height) {
  const Image image = read_image(png);
  if (image.width != width || image.height != height)
    throw InputError(png.string() + ": is " + shape_text(image) + ", the photographs are " +
                     std::to_string(width) + "×" + std::to_string(height));
  const auto names = read_names(names_path(png));
  PixelKinds kinds{width, height, {}, std::vector<std::uint8_t>(image.pixel_count(), 0)};
  for (const auto& [level, name] : names) kinds.names.push_back(name);
  for (std::size_t p = 0; p < kinds.labels.size(); ++p) {
    const float value = srgb_from_linear(image.values[p * static_cast<std::size_t>(image.channels)]);
    const int level = static_cast<int>(std::lround(255.0f * value));
    for (std::size_t k = 0; k < names.size(); ++k)
      if (names[k].first == level) kinds.labels[p] = static_cast<std::uint8_t>(k + 1);
  }
  return kinds;
}

namespace {

constexpr int grid = 4;  // rays per pixel, along a side
constexpr int min_majority = 3 * grid * grid / 4;
constexpr int monitor_columns = 16, monitor_rows = 12;
constexpr double least_hidden = 0.05, max_hidden = 0.95;

Label label_of(const TabletopScene& scene, const std::optional<Hit>& hit) {
  if (!hit) return no_kind;
  if (hit->is_monitor()) return refraction;
  switch (scene.material_of(hit->object).kind) {
    case MaterialDescription::Kind::mirror:
    case MaterialDescription::Kind::glass:
      return refraction;
    case MaterialDescription::Kind::glossy:
    case MaterialDescription::Kind::metal:
      return glossy;
    default:
      return diffuse;
  }
}

/// Points of the monitor that could light a surface, and those of them that something hides.
struct Visibility {
  int facing = 0;
  int hidden = 0;
};

void look_at_monitor(const TabletopScene& scene, const Hit& hit, const Ray& ray, Visibility& seen) {
  const Surface surface(scene, hit, -ray.direction);
  const MonitorSurface& monitor = scene.monitor();
  const Eigen::Vector3f normal =
      hit.geometric_normal.dot(ray.direction) < 0.0f ? hit.geometric_normal : (-hit.geometric_normal).eval();
  for (int j = 0; j < monitor_rows; ++j)
    for (int i = 0; i < monitor_columns; ++i) {
      const auto at = [](int cell, int cells, int texels) {
        return (static_cast<float>(cell) + 0.5f) * static_cast<float>(texels) / static_cast<float>(cells);
      };
      const Eigen::Vector3f point = monitor.point(at(i, monitor_columns, monitor.texels().width),
                                                  at(j, monitor_rows, monitor.texels().height));
      const Eigen::Vector3f direction = (point - hit.position).normalized();
      if (direction.dot(normal) <= 0.0f || direction.dot(monitor.normal()) >= 0.0f) continue;
      ++seen.facing;
      if (scene.occluded(surface.off_surface(direction), point)) ++seen.hidden;
    }
}

Label label_pixel(const TabletopScene& scene, int x, int y) {
  std::array<int, mixed + 1> counts{};
  Visibility seen;
  for (int j = 0; j < grid; ++j)
    for (int i = 0; i < grid; ++i) {
      const Ray ray = scene.camera_ray(static_cast<float>(x) + (static_cast<float>(i) + 0.5f) / grid,
                                       static_cast<float>(y) + (static_cast<float>(j) + 0.5f) / grid);
      const auto hit = scene.intersect(ray);
      const Label label = label_of(scene, hit);
      ++counts[label];
      if (label == diffuse || label == glossy) look_at_monitor(scene, *hit, ray, seen);
    }
  const auto largest = std::ranges::max_element(counts);
  if (*largest < min_majority) return mixed;
  const auto label = static_cast<Label>(std::distance(counts.begin(), largest));
  if (label != diffuse && label != glossy) return label;
  const double hidden = seen.facing > 0 ? static_cast<double>(seen.hidden) / seen.facing : 0.0;
  return hidden > least_hidden && hidden < max_hidden ? hard_shadow : label;
}

}  // namespace

PixelKinds scene_kinds(const TabletopScene& scene, const RunContext& run) {
  const SceneCamera& camera = scene.description().camera;
  PixelKinds kinds{camera.width, camera.height, {std::begin(kind_names), std::end(kind_names)}, {}};
  kinds.labels.resize(static_cast<std::size_t>(camera.width) * camera.height);
  tbb::parallel_for(0, camera.height, [&](int y) {
    run.throw_if_stopped();
    for (int x = 0; x < camera.width; ++x)
      kinds.labels[static_cast<std::size_t>(y) * camera.width + x] = label_pixel(scene, x, y);
  });
  return kinds;
}

}  // namespace refield::chart
