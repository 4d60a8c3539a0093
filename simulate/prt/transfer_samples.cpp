// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/transfer_samples.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

#include "core/errors.h"
#include "core/transfer_tiles.h"

namespace refield::prt {

namespace {

constexpr float inverse_pi = std::numbers::inv_pi_v<float>;

OutputLayout layout_of_vertices(std::size_t vertices) {
  constexpr std::size_t group = TransferSamples::group_outputs;
  OutputLayout layout;
  layout.width = output_image_width;
  layout.height = output_image_height(vertices);
  layout.outputs.assign((vertices + group - 1) / group * group, OutputLayout::none);
  layout.place_of_pixel.assign(static_cast<std::size_t>(layout.width) * layout.height, OutputLayout::none);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    layout.outputs[v] = v;
    layout.place_of_pixel[pixel_of_output(v)] = v;
  }
  return layout;
}

OutputLayout layout_of_pixels(int width, int height) {
  OutputLayout layout;
  layout.width = width;
  layout.height = height;
  layout.place_of_pixel.resize(static_cast<std::size_t>(width) * height);
  for (int y0 = 0; y0 < height; y0 += group_side_px)
    for (int x0 = 0; x0 < width; x0 += group_side_px)
      for (int i = 0; i < group_pixels; ++i) {
        const int x = x0 + i % group_side_px, y = y0 + i / group_side_px;
        const bool inside = x < width && y < height;
        const auto pixel = static_cast<std::uint32_t>(y * width + x);
        if (inside) layout.place_of_pixel[pixel] = static_cast<std::uint32_t>(layout.outputs.size());
        layout.outputs.push_back(inside ? pixel : OutputLayout::none);
      }
  return layout;
}

}  // namespace

OutputLayout layout_of(const Scene& scene, Relighting relighting) {
  if (scene.mesh.triangles.empty()) throw InputError("the scene has no triangles; nothing can be relit");
  if (relighting == Relighting::image) {
    if (!scene.camera)
      throw InputError(
          "the scene has no camera, which image relighting needs: describe one, or relight vertices");
    scene.camera->check();
    return layout_of_pixels(scene.camera->width, scene.camera->height);
  }
  if (!std::ranges::all_of(scene.materials, &Material::is_diffuse))
    throw InputError(
        "the scene has a glossy material, whose appearance depends on the view: choose image relighting with "
        "a "
        "camera, or give it specular = 0");
  return layout_of_vertices(scene.mesh.positions.size());
}

TransferSamples::TransferSamples(const Scene& scene, const TransferOptions& options,
                                 std::span<const std::uint32_t> outputs, const RunContext& run)
    : rays_(scene.mesh) {
  const bool image = options.relighting == Relighting::image;
  channels_ = image || (options.bounces > 0 && !bounces_grey(scene)) ? 3 : 1;
  const int side = image ? std::max(1, options.pixel_samples) : 1;
  packets_ = static_cast<std::size_t>(side) * side;
  const float share = 1.0f / static_cast<float>(packets_);
  const std::size_t group_count = (outputs.size() + group_outputs - 1) / group_outputs;
  points_.resize(group_count * packets_ * group_outputs);
  tbb::parallel_for(std::size_t{0}, outputs.size(), [&](std::size_t i) {
    if (outputs[i] == OutputLayout::none) return;
    Point* point = &points_[i / group_outputs * packets_ * group_outputs + i % group_outputs];
    for (std::size_t k = 0; k < packets_; ++k, point += group_outputs) {
      if (!image) {
        *point = vertex_point(scene, outputs[i]);
        continue;
      }
      const auto width = static_cast<std::uint32_t>(scene.camera->width);
      const auto at = [&](std::uint32_t pixel, std::size_t cell) {
        return static_cast<float>(pixel) + (static_cast<float>(cell) + 0.5f) / static_cast<float>(side);
      };
      *point = pixel_point(scene, at(outputs[i] % width, k % side), at(outputs[i] / width, k / side), share);
    }
  });
  if (options.bounces > 0) prepare_bounces(scene, options.bounces, run);
}

void TransferSamples::prepare_bounces(const Scene& scene, int bounces, const RunContext& run) {
  std::vector<Gatherer> gatherers(groups() * group_outputs);
  reflectance_.assign(gatherers.size(), Eigen::Array3f::Zero());
  for (std::size_t i = 0; i < gatherers.size(); ++i)
    for (std::size_t k = 0; k < packets_; ++k) {
      const Point& point = points_[(i / group_outputs * packets_ + k) * group_outputs + i % group_outputs];
      if (point.normal.isZero()) continue;
      gatherers[i] = {point.position, point.normal};  // the last of a pixel's stands for all
      reflectance_[i] += std::numbers::pi_v<float> * point.diffuse;
    }
  bounced_.emplace(scene, rays_, gatherers, bounces, run);
}

TransferSamples::Point TransferSamples::vertex_point(const Scene& scene, std::uint32_t vertex) const {
  Point point;
  point.normal = scene.mesh.normals[vertex];
  point.position = rays_.off_surface(scene.mesh.positions[vertex], point.normal);
  point.diffuse.setConstant(inverse_pi);
  return point;
}

TransferSamples::Point TransferSamples::pixel_point(const Scene& scene, float x, float y, float share) const {
  Point point;
  const PinholeCamera& camera = *scene.camera;
  const Eigen::Vector3f sight = camera.direction(x, y);
  const auto hit = rays_.intersect(camera.position, sight);
  if (!hit) return point;
  const Mesh& mesh = scene.mesh;
  const auto& triangle = mesh.triangles[hit->triangle];
  Eigen::Array3f colour = Eigen::Array3f::Zero();
  for (int i = 0; i < 3; ++i) {
    point.normal += hit->share[i] * mesh.normals[triangle[i]];
    colour += hit->share[i] * mesh.colours[triangle[i]];
  }
  point.normal.normalize();
  if (!hit->front) point.normal = -point.normal;
  const Eigen::Vector3f& corner = mesh.positions[triangle[0]];
  const Eigen::Vector3f plane =
      (mesh.positions[triangle[1]] - corner).cross(mesh.positions[triangle[2]] - corner).normalized();
  point.position = rays_.off_surface(camera.position + hit->distance * sight,
                                     hit->front ? plane : Eigen::Vector3f(-plane));
  point.mirrored = sight - 2.0f * sight.dot(point.normal) * point.normal;
  const Material& material = scene.material_of_triangle(hit->triangle);
  point.diffuse = share * inverse_pi * colour * material.diffuse;
  point.specular = share * 0.5f * inverse_pi * (material.exponent + 2.0f) * material.specular;
  point.exponent = material.exponent;
  return point;
}

std::uint32_t TransferSamples::evaluate(std::size_t group, const Eigen::Vector3f& direction,
                                        std::span<float> values) const {
  std::ranges::fill(values, 0.0f);
  std::uint32_t traced = 0;
  for (std::size_t packet = 0; packet < packets_; ++packet)
    traced += add_direct(&points_[(group * packets_ + packet) * group_outputs], direction, values);
  if (bounced_) add_bounced(group, direction, values);
  return traced;
}

std::uint32_t TransferSamples::add_direct(const Point* points, const Eigen::Vector3f& direction,
                                          std::span<float> values) const {
  std::array<Eigen::Vector3f, group_outputs> facing;
  std::array<std::uint8_t, group_outputs> lane;
  std::size_t count = 0;
  for (std::size_t i = 0; i < group_outputs; ++i)
    if (points[i].normal.dot(direction) > 0.0f) {
      facing[count] = points[i].position;
      lane[count++] = static_cast<std::uint8_t>(i);
    }
  if (count == 0) return 0;
  for (std::uint32_t free = rays_.unoccluded({facing.data(), count}, direction); free; free &= free - 1) {
    const std::size_t i = lane[static_cast<std::size_t>(std::countr_zero(free))];
    const Point& point = points[i];
    const float cosine = point.normal.dot(direction);
    const float mirrored = std::max(point.mirrored.dot(direction), 0.0f);
    const float lobe = point.exponent > 0.0f ? std::pow(mirrored, point.exponent) : 1.0f;
    for (int c = 0; c < channels_; ++c)
      values[static_cast<std::size_t>(c) * group_outputs + i] +=
          cosine * (point.diffuse[c] + lobe * point.specular[c]);
  }
  return static_cast<std::uint32_t>(count);
}

void TransferSamples::add_bounced(std::size_t group, const Eigen::Vector3f& direction,
                                  std::span<float> values) const {
  std::array<float, 3 * group_outputs> arriving{};
  bounced_->add(group, direction, std::span(arriving).first(values.size()));
  for (std::size_t v = 0; v < values.size(); ++v)
    values[v] +=
        arriving[v] *
        reflectance_[group * group_outputs + v % group_outputs][static_cast<Eigen::Index>(v / group_outputs)];
}

std::vector<Lobe> TransferSamples::lobes(std::size_t group, float narrow) const {
  std::vector<Lobe> found;
  const auto first = points_.begin() + static_cast<std::ptrdiff_t>(group * packets_ * group_outputs);
  std::for_each(first, first + static_cast<std::ptrdiff_t>(packets_ * group_outputs),
                [&](const Point& point) {
                  if (point.exponent >= narrow && (point.specular > 0.0f).any())
                    found.push_back({point.mirrored, point.exponent});
                });
  return found;
}

}  // namespace refield::prt
