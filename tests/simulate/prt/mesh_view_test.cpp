// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/mesh_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "core/base/errors.h"
#include "core/light/harmonics.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"
#include "tests/support/message_of.h"

namespace refield {
namespace {

/// A rabbit above a ground plane that goes on behind the camera.
Mesh rabbit_on_ground() {
  Mesh mesh = prt::rabbit_mesh(12), plane = prt::plane_mesh(2);
  prt::place(plane, {.size = 40.0f, .position = Eigen::Vector3f(0, -0.6f, 0)});
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), plane.positions.begin(), plane.positions.end());
  mesh.normals.insert(mesh.normals.end(), plane.normals.begin(), plane.normals.end());
  mesh.colours.resize(mesh.positions.size(), Eigen::Array3f::Ones());
  for (const auto& [a, b, c] : plane.triangles) mesh.triangles.push_back({first + a, first + b, first + c});
  return mesh;
}

/// A field of which the view alone matters.
ReflectanceField field_over(Mesh mesh, int outgoing_order = 0) {
  ReflectanceField field;
  field.mesh = OutputMesh{std::move(mesh), outgoing_order};
  field.width = output_image_width;
  field.height = output_image_height(field.mesh->outputs());
  return field;
}

Image outputs_of(const ReflectanceField& field, float value) {
  return Image(field.width, field.height, 3, value);
}

void set_output(Image& outputs, std::size_t output, const Eigen::Array3f& value) {
  for (int c = 0; c < 3; ++c)
    outputs.values[3 * pixel_of_output(output) + static_cast<std::size_t>(c)] = value[c];
}

const PinholeCamera oblique = {{0.9f, 0.5f, -2.2f}, {0.1f, 0.1f, 0.0f}, {0.1f, 1.0f, 0.0f}, 40.0f, 161, 97};

TEST(MeshRaster, SeesWhatRaysMeet) {
  const Mesh mesh = rabbit_on_ground();
  const prt::MeshRays rays(mesh);
  for (const int samples : {1, 4}) {
    const auto seen = rasterise(mesh, oblique, samples);
    const auto points = sight_points(samples);
    std::size_t others = 0, hits = 0;
    for (int y = 0; y < oblique.height; ++y)
      for (int x = 0; x < oblique.width; ++x)
        for (std::size_t s = 0; s < points.size(); ++s) {
          const SeenPoint& found =
              seen[(static_cast<std::size_t>(y) * oblique.width + x) * points.size() + s];
          const auto hit =
              rays.intersect(oblique.position, oblique.direction(static_cast<float>(x) + points[s].x(),
                                                                 static_cast<float>(y) + points[s].y()));
          if (hit.has_value() != (found.triangle != SeenPoint::nothing)) {
            ++others;
            continue;
          }
          if (!hit) continue;
          ++hits;
          if (hit->triangle != found.triangle) {
            ++others;
            continue;
          }
          ASSERT_EQ(hit->front, found.front);
          for (std::size_t i = 0; i < 3; ++i) ASSERT_NEAR(hit->share[i], found.share[i], 2e-3f);
        }
    EXPECT_GT(hits, points.size() * 10000);
    // Rays that meet an edge may fall to either triangle.
    EXPECT_LT(others, hits / 2000);
  }
}

TEST(MeshRaster, LeavesNoGapsBetweenTriangles) {
  // From inside, every line of sight meets the sphere.
  const Mesh sphere = prt::sphere_mesh(24);
  PinholeCamera inside;
  inside.position = {0.05f, 0.03f, -0.02f};
  inside.target = {0.3f, 0.2f, 0.5f};
  inside.vertical_field_of_view_degrees = 100.0f;
  inside.width = 160;
  inside.height = 120;
  for (const SeenPoint& point : rasterise(sphere, inside, 4)) {
    ASSERT_NE(point.triangle, SeenPoint::nothing);
    ASSERT_FALSE(point.front);
  }
}

TEST(MeshRenderer, AveragesOverAPixelAndMultipliesByColours) {
  ReflectanceField field = field_over(prt::plane_mesh(1));
  for (auto& colour : field.mesh->colours) colour = Eigen::Array3f(0.5f, 0.25f, 1.0f);
  PinholeCamera camera;
  camera.position = {0, 3, 0};
  camera.up = {0, 0, 1};
  camera.vertical_field_of_view_degrees = 60.0f;
  camera.width = camera.height = 200;
  const Image picture = MeshRenderer(field, camera).show(outputs_of(field, 2.0f));
  EXPECT_NEAR(picture.at(100, 100, 0), 1.0f, 1e-5f);
  EXPECT_NEAR(picture.at(100, 100, 1), 0.5f, 1e-5f);
  EXPECT_EQ(picture.at(0, 0, 0), 0.0f);
  // As much light as the square covers of the image: 1 of (2 · 3 tan 30°)².
  double sum = 0.0;
  for (std::size_t i = 0; i < picture.pixel_count(); ++i) sum += picture.values[3 * i];
  EXPECT_NEAR(sum / 40000.0, 1.0 / 12.0, 0.001);  // edges fall between sight points
  camera.position.y() = -3.0f;                    // the back is dark
  for (const float value : MeshRenderer(field, camera).show(outputs_of(field, 2.0f)).values)
    ASSERT_EQ(value, 0.0f);
}

TEST(MeshRenderer, InterpolatesInPerspective) {
  // Light that grows with x: at the point that is seen, not along the image.
  const ReflectanceField field = field_over(prt::plane_mesh(1));
  Image outputs = outputs_of(field, 0.0f);
  for (std::size_t v = 0; v < field.mesh->positions.size(); ++v)
    set_output(outputs, v, Eigen::Array3f::Constant(field.mesh->positions[v].z() + 0.5f));
  PinholeCamera camera;
  camera.position = {0, 0.4f, -0.7f};
  camera.target = {0, 0, 0};
  camera.width = camera.height = 101;
  const Image picture = MeshRenderer(field, camera, 1).show(outputs);
  for (const int y : {30, 50, 70}) {
    const Eigen::Vector3f direction = camera.direction(50.5f, static_cast<float>(y) + 0.5f);
    const Eigen::Vector3f point = camera.position - camera.position.y() / direction.y() * direction;
    EXPECT_NEAR(picture.at(50, y, 1), point.z() + 0.5f, 1e-4f);
  }
}

TEST(MeshRenderer, GlossyVerticesShineIntoTheMirroredSight) {
  constexpr int order = 3;
  const ReflectanceField field = field_over(prt::plane_mesh(1), order);
  Image outputs = outputs_of(field, 0.0f);
  // Radiance over the mirrored direction R: 2 + R_z.
  const double constant = 2.0 * std::sqrt(4.0 * std::numbers::pi),
               along_z = std::sqrt(4.0 * std::numbers::pi / 3.0);
  for (std::size_t v = 0; v < field.mesh->positions.size(); ++v) {
    set_output(outputs, 9 * v, Eigen::Array3f::Constant(static_cast<float>(constant)));
    set_output(outputs, 9 * v + 2, Eigen::Array3f::Constant(static_cast<float>(along_z)));
  }
  PinholeCamera camera;
  camera.position = {0, 400, -300};  // so far that all vertices see it in one direction
  camera.target = {0, 0, 0};
  camera.vertical_field_of_view_degrees = 0.1f;
  camera.width = camera.height = 21;
  const Image picture = MeshRenderer(field, camera).show(outputs);
  EXPECT_NEAR(picture.at(10, 10, 0), 2.0f + 0.6f, 2e-3f);  // sight from −z is mirrored to +z
}

TEST(MeshRenderer, FramesAMeshByItself) {
  const ReflectanceField field = field_over(prt::rabbit_mesh(8));
  for (const auto& [width, height] : {std::pair{200, 100}, {100, 200}}) {
    const Image picture =
        MeshRenderer(field, framing_camera(*field.mesh, width, height)).show(outputs_of(field, 1.0f));
    double covered = 0.0;
    for (std::size_t i = 0; i < picture.pixel_count(); ++i) covered += picture.values[3 * i];
    EXPECT_GT(covered / static_cast<double>(picture.pixel_count()), 0.1);
    for (int x = 0; x < width; ++x) ASSERT_EQ(picture.at(x, 0, 0) + picture.at(x, height - 1, 0), 0.0f);
    for (int y = 0; y < height; ++y) ASSERT_EQ(picture.at(0, y, 0) + picture.at(width - 1, y, 0), 0.0f);
  }
}

TEST(MeshRenderer, TellsTheVertexUnderAPixel) {
  const ReflectanceField field = field_over(prt::plane_mesh(1));
  PinholeCamera camera;
  camera.position = {0, 2, 0};
  camera.up = {0, 0, 1};
  camera.width = camera.height = 100;
  const MeshRenderer view(field, camera);
  // Upper right of the picture: +x, +z.
  const auto vertex = view.vertex_at(80, 20);
  ASSERT_TRUE(vertex);
  EXPECT_EQ(field.mesh->positions[*vertex], Eigen::Vector3f(0.5f, 0, 0.5f));
  EXPECT_FALSE(view.vertex_at(0, 0));
}

TEST(MeshRenderer, RefusesWhatDoesNotFit) {
  const ReflectanceField field = field_over(prt::sphere_mesh(16));
  EXPECT_THROW(MeshRenderer(field_over({}), PinholeCamera{}), InputError);
  PinholeCamera blind;
  blind.target = blind.position;
  EXPECT_THROW(MeshRenderer(field, blind), InputError);
  EXPECT_THROW(MeshRenderer(field, PinholeCamera{}).show(Image(64, 16, 3)), InputError);
}

TEST(FramingCamera, ShowsAMeshOfAnySizeAlike) {
  const Mesh mesh = prt::rabbit_mesh(12);
  const PinholeCamera usual = framing_camera(mesh, 64, 48);
  for (const float size : {1e-12f, 1e-9f, 1e-6f, 1e6f}) {
    Mesh other = mesh;
    for (auto& position : other.positions) position *= size;
    const PinholeCamera camera = framing_camera(other, 64, 48);
    for (std::size_t v = 0; v < mesh.positions.size(); v += 16) {
      const auto expected = usual.image_point(mesh.positions[v]),
                 seen = camera.image_point(other.positions[v]);
      ASSERT_TRUE(expected && seen);
      EXPECT_LT((*expected - *seen).norm(), 0.01f) << "at size " << size;
    }
  }
}

}  // namespace
}  // namespace refield
