// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/transfer_samples.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "core/field/transfer_tiles.h"
#include "core/light/cube_map.h"

namespace refield::prt {

double radical_inverse(std::uint32_t k) {
  double value = 0.0;
  for (double digit = 0.5; k > 0; k >>= 1, digit *= 0.5)
    if (k & 1) value += digit;
  return value;
}

std::vector<Eigen::Vector3d> hammersley_sphere(int count) {
  std::vector<Eigen::Vector3d> directions;
  directions.reserve(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) {
    const double z = 1.0 - (2.0 * k + 1.0) / count, radius = std::sqrt(1.0 - z * z);
    const double phi = 2.0 * std::numbers::pi * radical_inverse(static_cast<std::uint32_t>(k));
    directions.emplace_back(radius * std::cos(phi), radius * std::sin(phi), z);
  }
  return directions;
}

namespace {

constexpr int gather_rays = 128;
constexpr int cells_of_side = 8;
constexpr int cells_of_face = cells_of_side * cells_of_side;
constexpr std::size_t cells = static_cast<std::size_t>(cube_faces) * cells_of_face;
constexpr int directions_of_side = 2;  // of a cell

using VertexLight = std::vector<Eigen::Array3f>;  // at vertices or points

/// What points see: rows of (vertex, share of its radiance in E ∕ π).
class Environment {
 public:
  Environment(const MeshRays& rays, std::span<const Gatherer> points, const RunContext& run)
      : rows_(points.size()) {
    const std::vector<Eigen::Vector3d> around = hammersley_sphere(gather_rays);
    Progress progress(run, "gathering indirect light", points.size());
    tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t p) {
      if (run.is_stopped()) return;  // thrown away
      if (!points[p].normal.isZero())
        for (const Eigen::Vector3d& direction : around)
          look(rays, points[p], direction.cast<float>(), rows_[p]);
      progress.advance();
    });
    run.throw_if_stopped();
  }

  VertexLight gather(const VertexLight& radiance) const {
    VertexLight gathered(rows_.size(), Eigen::Array3f::Zero());
    for (std::size_t p = 0; p < rows_.size(); ++p)
      for (const Seen& seen : rows_[p]) gathered[p] += seen.share * radiance[seen.vertex];
    return gathered;
  }

 private:
  struct Seen {
    std::uint32_t vertex;
    float share;
  };

  /// A point of the unit sphere that touches a surface lies in a direction of cosine distribution.
  static void look(const MeshRays& rays, const Gatherer& point, const Eigen::Vector3f& on_sphere,
                   std::vector<Seen>& row) {
    const Eigen::Vector3f direction = point.normal + on_sphere;
    const float length = direction.norm();
    if (length < 1e-3f) return;
    const auto hit = rays.intersect(point.position, direction / length);
    if (!hit || !hit->front) return;
    const auto& corners = rays.mesh().triangles[hit->triangle];
    for (std::size_t i = 0; i < corners.size(); ++i) row.push_back({corners[i], hit->share[i] / gather_rays});
  }

  std::vector<std::vector<Seen>> rows_;
};

std::vector<Gatherer> gatherers_of(const Scene& scene, const MeshRays& rays) {
  const Mesh& mesh = scene.mesh;
  std::vector<Gatherer> points(mesh.positions.size());
  for (std::size_t v = 0; v < points.size(); ++v)
    points[v] = {rays.off_surface(mesh.positions[v], mesh.normals[v]), mesh.normals[v]};
  return points;
}

/// V cos ∕ π at vertices.
void add_direct(const MeshRays& rays, std::span<const Gatherer> vertices, const Eigen::Vector3f& direction,
                VertexLight& light) {
  std::array<Eigen::Vector3f, MeshRays::packet> points;
  std::array<std::size_t, MeshRays::packet> vertex;
  std::size_t count = 0;
  const auto trace = [&] {
    const std::uint32_t free = rays.unoccluded({points.data(), count}, direction);
    for (std::size_t i = 0; i < count; ++i)
      if (free >> i & 1)
        light[vertex[i]] += vertices[vertex[i]].normal.dot(direction) * std::numbers::inv_pi_v<float>;
    count = 0;
  };
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (vertices[v].normal.dot(direction) <= 0.0f) continue;
    points[count] = vertices[v].position;
    vertex[count++] = v;
    if (count == MeshRays::packet) trace();
  }
  if (count > 0) trace();
}

}  // namespace

BouncedLight::BouncedLight(const Scene& scene, const MeshRays& rays, std::span<const Gatherer> points,
                           int bounces, const RunContext& run)
    : blocks_((points.size() + block - 1) / block), table_(blocks_ * cells * 3 * block) {
  const std::vector<Gatherer> vertices = gatherers_of(scene, rays);
  const VertexLight reflectance = diffuse_reflectance(scene);
  const Environment of_vertices(rays, vertices, run), of_points(rays, points, run);
  Progress progress(run, "computing indirect light", cells);
  tbb::parallel_for(std::size_t{0}, cells, [&](std::size_t cell) {
    if (run.is_stopped()) return;  // thrown away
    constexpr int side = cells_of_side * directions_of_side;
    const auto x = static_cast<int>(cell) % cells_of_side, y = static_cast<int>(cell) / cells_of_side;
    VertexLight direct(vertices.size(), Eigen::Array3f::Zero());
    for (int k = 0; k < directions_of_side * directions_of_side; ++k)
      add_direct(rays, vertices,
                 cube_direction(directions_of_side * x + k % directions_of_side + 0.5,
                                directions_of_side * y + k / directions_of_side + 0.5, side)
                     .cast<float>(),
                 direct);
    for (auto& light : direct) light /= directions_of_side * directions_of_side;
    // All in linear terms: radiance = reflectance (direct + gathered radiance).
    VertexLight radiance(vertices.size(), Eigen::Array3f::Zero());
    for (int bounce = 0; bounce < bounces; ++bounce) {
      radiance = of_vertices.gather(radiance);
      for (std::size_t v = 0; v < vertices.size(); ++v)
        radiance[v] = reflectance[v] * (radiance[v] + direct[v]);
    }
    const VertexLight gathered = of_points.gather(radiance);
    for (std::size_t p = 0; p < points.size(); ++p)
      for (std::size_t c = 0; c < 3; ++c)
        table_[((p / block * cells + cell) * 3 + c) * block + p % block] =
            Eigen::half(gathered[p][static_cast<Eigen::Index>(c)]);
    progress.advance();
  });
  run.throw_if_stopped();
}

void BouncedLight::add(std::size_t of_block, const Eigen::Vector3f& direction,
                       std::span<float> values) const {
  const Eigen::Vector2d at = cube_position(direction.cast<double>(), cells_of_side);
  const int face = std::min(static_cast<int>(at.y()) / cells_of_side, cube_faces - 1);
  const auto between = [](double position) { return std::clamp(position - 0.5, 0.0, cells_of_side - 1.0); };
  const double x = between(at.x()), y = between(at.y() - face * cells_of_side);
  const int x0 = std::min(static_cast<int>(x), cells_of_side - 2),
            y0 = std::min(static_cast<int>(y), cells_of_side - 2);
  for (int k = 0; k < 4; ++k) {
    const int dx = k % 2, dy = k / 2;
    const auto share = static_cast<float>((dx ? x - x0 : 1.0 - (x - x0)) * (dy ? y - y0 : 1.0 - (y - y0)));
    const std::size_t cell =
        static_cast<std::size_t>(face) * cells_of_face + (y0 + dy) * cells_of_side + x0 + dx;
    const Eigen::half* from = &table_[(of_block * cells + cell) * 3 * block];
    for (std::size_t i = 0; i < values.size(); ++i) values[i] += share * static_cast<float>(from[i]);
  }
}

bool bounces_grey(const Scene& scene) {
  return std::ranges::all_of(diffuse_reflectance(scene),
                             [](const Eigen::Array3f& value) { return (value == value[0]).all(); });
}

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
        "a camera, or give it specular = 0");
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
  for (const Material& material : scene.materials)
    if (material.roughness > 0.0f) gains_.try_emplace(material.roughness, material.roughness);
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
  Eigen::Array3f colour = Eigen::Array3f::Zero(), specular = Eigen::Array3f::Zero();
  for (int i = 0; i < 3; ++i) {
    point.normal += hit->share[i] * mesh.normals[triangle[i]];
    colour += hit->share[i] * mesh.colours[triangle[i]];
    specular += hit->share[i] * scene.specular(triangle[i]);
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
  if (material.roughness > 0.0f) {
    const GgxGain::At gain = gains_.at(material.roughness)(point.normal.dot(sight));
    specular = gain(specular, (colour * material.diffuse == 0.0f).all());
  }
  point.specular = share * 0.5f * inverse_pi * (material.exponent + 2.0f) * specular;
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
