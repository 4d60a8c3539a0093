// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/mesh_view.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

#include "core/light/cube_map.h"
#include "core/light/harmonics.h"

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
    throw InputError("an image of ", shape_text(outputs), " does not hold the outputs of ", vertices,
                     " vertices");
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
