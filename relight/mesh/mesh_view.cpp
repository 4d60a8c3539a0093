// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/mesh_view.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/base/errors.h"
#include "core/field/mesh.h"
#include "core/light/cube_map.h"
#include "core/light/harmonics.h"
#include "relight/mesh/mesh_raster.h"

namespace refield {

namespace {

/// Shares of the few vertices that a pixel shows.
class PixelShares {
 public:
  void add(std::uint32_t vertex, float share) {
    for (std::size_t i = 0; i < count_; ++i)
      if (vertices_[i] == vertex) {
        shares_[i] += share;
        return;
      }
    vertices_[count_] = vertex;
    shares_[count_++] = share;
  }
  std::size_t count() const { return count_; }
  std::uint32_t vertex(std::size_t i) const { return vertices_[i]; }
  float share(std::size_t i) const { return shares_[i]; }

 private:
  std::array<std::uint32_t, 12> vertices_;  // of four triangles
  std::array<float, 12> shares_;
  std::size_t count_ = 0;
};

PixelShares shares_of(const Mesh& mesh, std::span<const SeenPoint> seen) {
  PixelShares shares;
  for (const SeenPoint& point : seen)
    if (point.triangle != SeenPoint::nothing && point.front)
      for (std::size_t i = 0; i < 3; ++i)
        shares.add(mesh.triangles[point.triangle][i], point.share[i] / static_cast<float>(seen.size()));
  return shares;
}

Eigen::Array3f output_of(const Image& outputs, std::size_t output) {
  return Eigen::Map<const Eigen::Array3f>(outputs.values.data() + 3 * pixel_of_output(output));
}

}  // namespace

PinholeCamera framing_camera(const Mesh& mesh, int width, int height) {
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  PinholeCamera camera;
  camera.width = width;
  camera.height = height;
  camera.target = bounds.center();
  const Eigen::Vector3f ahead = Eigen::Vector3f(0.0f, -0.35f, 1.0f).normalized();
  const Eigen::Vector3f above = ahead.cross(Eigen::Vector3f::UnitX());
  const float tangent = std::tan(camera.vertical_field_of_view_degrees * std::numbers::pi_v<float> / 360.0f);
  const float across = tangent * static_cast<float>(width) / static_cast<float>(height);
  float distance = 0.0f;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3f corner =
        bounds.corner(static_cast<Eigen::AlignedBox3f::CornerType>(i)) - camera.target;
    const float needed = std::max(std::abs(corner.x()) / across, std::abs(corner.dot(above)) / tangent);
    distance = std::max(distance, needed - corner.dot(ahead));
  }
  constexpr float margin = 1.05f;
  camera.position =
      camera.target - margin * (distance > 0.0f ? distance : 1.0f) * ahead;  // of any size, but a point
  return camera;
}

namespace {

const OutputMesh& mesh_of(const FieldOutline& field) {
  if (!field.mesh) throw InputError("the field has no mesh, so the view cannot change");
  return *field.mesh;
}

}  // namespace

PinholeCamera standard_camera(const FieldOutline& field) {
  const PinholeCamera standard;
  const OutputMesh& mesh = mesh_of(field);
  return mesh.camera ? *mesh.camera : framing_camera(mesh, standard.width, standard.height);
}

MeshRenderer::MeshRenderer(const FieldOutline& field, const PinholeCamera& camera, int samples)
    : MeshRenderer(mesh_of(field), camera, samples) {
  if (const int order = field.mesh->outgoing_order; order > 0) evaluate_mirrored_sight(*field.mesh, order);
}

MeshRenderer::MeshRenderer(const Mesh& mesh, const PinholeCamera& camera, int samples)
    : camera_(camera), mesh_(&mesh) {
  if (mesh.empty()) throw InputError("the mesh has no vertices, so there is nothing to be seen");
  gather_shares(mesh, samples);
}

void MeshRenderer::gather_shares(const Mesh& mesh, int samples) {
  const std::vector<SeenPoint> seen = rasterise(mesh, camera_, samples);
  const auto pixels = static_cast<std::size_t>(camera_.width) * camera_.height;
  const std::size_t of_pixel = seen.size() / pixels;
  const auto at = [&](std::size_t pixel) { return std::span(seen).subspan(pixel * of_pixel, of_pixel); };
  first_.assign(pixels + 1, 0);
  hits_.resize(pixels);
  samples_ = static_cast<int>(of_pixel);
  tbb::parallel_for(std::size_t{0}, pixels, [&](std::size_t pixel) {
    first_[pixel + 1] = static_cast<std::uint32_t>(shares_of(mesh, at(pixel)).count());
    hits_[pixel] = static_cast<std::uint8_t>(std::ranges::count_if(
        at(pixel), [](const SeenPoint& point) { return point.triangle != SeenPoint::nothing; }));
  });
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) first_[pixel + 1] += first_[pixel];
  shares_.resize(first_.back());
  tbb::parallel_for(std::size_t{0}, pixels, [&](std::size_t pixel) {
    const PixelShares shares = shares_of(mesh, at(pixel));
    for (std::size_t i = 0; i < shares.count(); ++i)
      shares_[first_[pixel] + i] = {shares.vertex(i), shares.share(i)};
  });
}

void MeshRenderer::evaluate_mirrored_sight(const Mesh& mesh, int order) {
  outputs_a_vertex_ = static_cast<std::size_t>(harmonics_of(order));
  harmonics_.resize(mesh.positions.size() * outputs_a_vertex_);
  tbb::parallel_for(std::size_t{0}, mesh.positions.size(), [&](std::size_t v) {
    const Eigen::Vector3d sight = (camera_.position - mesh.positions[v]).cast<double>().normalized();
    const Eigen::Vector3d normal = mesh.normals[v].cast<double>();
    const Eigen::Vector3d mirrored = 2.0 * normal.dot(sight) * normal - sight;
    std::array<double, harmonics_of(largest_harmonics_order)> values{};
    evaluate_harmonics(order, mirrored, std::span(values).first(outputs_a_vertex_));
    std::copy_n(values.begin(), outputs_a_vertex_,
                harmonics_.begin() + static_cast<std::ptrdiff_t>(v * outputs_a_vertex_));
  });
}

Eigen::Array3f MeshRenderer::radiance(const Image& outputs, std::uint32_t vertex) const {
  if (harmonics_.empty()) return output_of(outputs, vertex);
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  const std::size_t first = vertex * outputs_a_vertex_;
  for (std::size_t i = 0; i < outputs_a_vertex_; ++i)
    sum += harmonics_[first + i] * output_of(outputs, first + i);
  return sum;
}

Image MeshRenderer::show(const Image& outputs) const {
  const std::size_t vertices = mesh_->positions.size();
  if (outputs.width != output_image_width || outputs.channels != 3 ||
      outputs.height < output_image_height(vertices * outputs_a_vertex_))
    throw InputError("an image of " + shape_text(outputs) + " does not hold the outputs of " +
                     std::to_string(vertices) + " vertices");
  std::vector<Eigen::Array3f> light(vertices);
  tbb::parallel_for(std::size_t{0}, vertices, [&](std::size_t v) {
    light[v] = mesh_->colours[v] * radiance(outputs, static_cast<std::uint32_t>(v));
  });
  return show(light);
}

Image MeshRenderer::show(std::span<const Eigen::Array3f> radiance) const {
  Image picture(camera_.width, camera_.height, 3);
  tbb::parallel_for(std::size_t{0}, picture.pixel_count(), [&](std::size_t pixel) {
    Eigen::Array3f sum = Eigen::Array3f::Zero();
    for (std::uint32_t i = first_[pixel]; i < first_[pixel + 1]; ++i)
      sum += shares_[i].share * radiance[shares_[i].vertex];
    Eigen::Map<Eigen::Array3f>(picture.values.data() + 3 * pixel) = sum;
  });
  return picture;
}

std::vector<float> MeshRenderer::coverage() const {
  std::vector<float> shares(hits_.size());
  std::ranges::transform(hits_, shares.begin(), [&](std::uint8_t hits) {
    return static_cast<float>(hits) / static_cast<float>(samples_);
  });
  return shares;
}

std::optional<std::uint32_t> MeshRenderer::vertex_at(int x, int y) const {
  const std::size_t pixel = static_cast<std::size_t>(y) * camera_.width + x;
  const auto first = shares_.begin() + first_[pixel], last = shares_.begin() + first_[pixel + 1];
  if (first == last) return std::nullopt;
  return std::max_element(first, last, [](const Share& a, const Share& b) { return a.share < b.share; })
      ->vertex;
}

namespace {

constexpr int pixels_of_side = 4;  // of a texel
constexpr int samples_of_pixel = 4;

PinholeCamera face_camera(int face, const Eigen::Vector3f& middle, int side) {
  const Eigen::Matrix3f axes = cube_face_axes(face).cast<float>();
  PinholeCamera camera;
  camera.position = middle;
  camera.target = middle + axes.row(2).transpose();
  camera.up = axes.row(1).transpose();
  camera.vertical_field_of_view_degrees = 90.0f;
  camera.width = camera.height = side;
  return camera;
}

Eigen::Array3f radiance(const Mesh& emitters, const SeenPoint& point) {
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (std::size_t k = 0; k < 3; ++k)
    sum += point.share[k] * emitters.colours[emitters.triangles[point.triangle][k]];
  return sum;
}

}  // namespace

LightMap emitter_map(const Mesh& emitters, const Eigen::Vector3f& middle, int resolution) {
  LightMap map{Image(resolution, cube_faces * resolution, 3), Parameterisation::cube};
  const int side = resolution * pixels_of_side;
  const std::vector<float> fine = cube_solid_angles(side), coarse = cube_solid_angles(resolution);
  tbb::parallel_for(0, cube_faces, [&](int face) {
    const std::vector<SeenPoint> seen =
        rasterise(emitters, face_camera(face, middle, side), samples_of_pixel);
    for (std::size_t k = 0; k < seen.size(); ++k) {
      if (seen[k].triangle == SeenPoint::nothing) continue;
      const std::size_t pixel = k / samples_of_pixel;
      const int x = static_cast<int>(pixel) % side / pixels_of_side,
                y = static_cast<int>(pixel) / side / pixels_of_side;
      const float share =
          fine[pixel] / (samples_of_pixel * coarse[static_cast<std::size_t>(y) * resolution + x]);
      const Eigen::Array3f light = share * radiance(emitters, seen[k]);
      for (int c = 0; c < 3; ++c) map.radiance.at(x, face * resolution + y, c) += light[c];
    }
  });
  return map;
}

}  // namespace refield
