// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/prt_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>
#include <numbers>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field/transfer_tiles.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/geometry/place_mesh.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield::prt {
namespace {

using refield::test::message_of;
using ::testing::HasSubstr;

double area(const Mesh& mesh) {
  double twice = 0.0;
  for (const auto& [a, b, c] : mesh.triangles)
    twice += (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]).norm();
  return 0.5 * twice;
}

/// How often each edge occurs, its direction left aside.
std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> count;
  for (const auto& triangle : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) ++count[std::minmax(triangle[i], triangle[(i + 1) % 3])];
  return count;
}

float longest_edge(const Mesh& mesh) {
  float longest = 0.0f;
  for (const auto& [edge, count] : edges(mesh))
    longest = std::max(longest, (mesh.positions[edge.first] - mesh.positions[edge.second]).norm());
  return longest;
}

/// Whether triangles' fronts and vertices' normals agree.
bool fronts_agree(const Mesh& mesh) {
  for (const auto& [a, b, c] : mesh.triangles)
    if ((mesh.positions[b] - mesh.positions[a])
            .cross(mesh.positions[c] - mesh.positions[a])
            .dot(mesh.normals[a] + mesh.normals[b] + mesh.normals[c]) <= 0.0f)
      return false;
  return true;
}

class Scenes : public ::testing::Test {
 protected:
  Scene read(const std::string& text) const {
    write_text_atomically(folder_ / "scene.toml", text);
    return read_scene(folder_ / "scene.toml");
  }
  std::string error_of(const std::string& text) const {
    return message_of([&] { read(text); });
  }
  refield::test::TemporaryFolder folder_;
};

TEST(Shapes, AreClosedAndFaceOutwards) {
  for (const Mesh& mesh : {sphere_mesh(8), rabbit_mesh(24)}) {
    EXPECT_TRUE(fronts_agree(mesh));
    for (const auto& [edge, count] : edges(mesh)) ASSERT_EQ(count, 2);
    for (const auto& triangle : mesh.triangles)  // all of these are seen from the origin
      ASSERT_GT(
          mesh.positions[triangle[0]].cross(mesh.positions[triangle[1]]).dot(mesh.positions[triangle[2]]),
          0.0f);
  }
  EXPECT_EQ(sphere_mesh(8).positions.size(), 642u);
  EXPECT_NEAR(area(sphere_mesh(32)), std::numbers::pi, 0.01);
  EXPECT_FLOAT_EQ(area(box_mesh(3)), 6.0);
  EXPECT_TRUE(fronts_agree(box_mesh(3)));
  const Mesh plane = plane_mesh(5);
  EXPECT_EQ(plane.positions.size(), 36u);
  for (const auto& normal : plane.normals) EXPECT_EQ(normal, Eigen::Vector3f::UnitY());
}

TEST_F(Scenes, LathesKeepTheirProfilesOrigin) {
  const Scene scene = read(R"(
[[object]]
shape = "lathe"
profile = [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]
smooth = false
position = [2, 3, 4]
)");
  Eigen::AlignedBox3f box;
  for (const auto& position : scene.mesh.positions) box.extend(position);
  EXPECT_LT((box.min() - Eigen::Vector3f(1.5f, 3, 3.5f)).norm(), 1e-5f);
  EXPECT_LT((box.max() - Eigen::Vector3f(2.5f, 4, 4.5f)).norm(), 1e-5f);
  EXPECT_TRUE(fronts_agree(scene.mesh));
  EXPECT_NEAR(area(scene.mesh), 1.5 * std::numbers::pi, 0.01);  // the wall is π, each end π/4
  EXPECT_THAT(error_of("[[object]]\nshape = \"lathe\"\nprofile = [[0, 0], [0, 1]]\n"),
              HasSubstr("encloses no surface"));
}

TEST(Refinement, KeepsTheSurfaceAndLeavesNoGaps) {
  for (const float limit : {0.4f, 0.11f}) {
    Mesh sphere = sphere_mesh(3);
    const double before = area(sphere);
    refine(sphere, limit);
    EXPECT_LE(longest_edge(sphere), limit);
    EXPECT_NEAR(area(sphere), before, 1e-5);
    for (const auto& [edge, count] : edges(sphere)) ASSERT_EQ(count, 2);  // a gap's edges occur once
    EXPECT_TRUE(fronts_agree(sphere));
    EXPECT_EQ(sphere.normals.size(), sphere.positions.size());
    EXPECT_EQ(sphere.colours.size(), sphere.positions.size());
  }
}

TEST(Refinement, RefusesWhatNoFieldCouldHold) {
  Mesh plane = plane_mesh(1);
  EXPECT_THROW(refine(plane, 0.0f), InputError);
  EXPECT_THAT(message_of([&] { refine(plane, 1e-5f); }), HasSubstr("allow longer ones"));
}

TEST_F(Scenes, PlacesMeshes) {
  const Scene scene = read(R"(
[[material]]
name = "brown"
diffuse = [0.5, 0.25, 0.0]
[[material]]
name = "shiny"
kind = "phong"
specular = [0.1, 0.1, 0.1]
exponent = 20
[[object]]
shape = "box"
material = "brown"
stretch = [1.0, 2.0, 1.0]
size = 4.0
position = [3.0, 9.0, -1.0]
on_ground = true
[[object]]
shape = "plane"
resolution = 4
rotation = [0, 90, 0]
material = "shiny"
[camera]
position = [0, 1, -5]
target = [0, 1, 0]
width = 320
)");
  ASSERT_EQ(scene.materials.size(), 2u);
  EXPECT_TRUE(scene.materials[0].is_diffuse());
  EXPECT_FLOAT_EQ(scene.materials[1].exponent, 20.0f);
  Eigen::AlignedBox3f box;
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v)
    if (scene.material_of_vertex[v] == 0) box.extend(scene.mesh.positions[v]);
  EXPECT_LT((box.min() - Eigen::Vector3f(2, 0, -2)).norm(), 1e-5f);
  EXPECT_LT((box.max() - Eigen::Vector3f(4, 4, 0)).norm(), 1e-5f);
  // Pitched down by a quarter turn, what faced up faces ahead.
  EXPECT_LT((scene.mesh.normals.back() - Eigen::Vector3f::UnitZ()).norm(), 1e-5f);
  ASSERT_TRUE(scene.camera);
  EXPECT_EQ(scene.camera->width, 320);
}

TEST_F(Scenes, ReadsMeshesBesideIt) {
  write_text_atomically(folder_ / "one.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  const Scene scene = read("[[object]]\nfile = \"one.off\"\nrefine = 0.5\n");
  EXPECT_EQ(scene.mesh.triangles.size(),
            8u);  // the longest edge is √2: 4 triangles, whose longest are halved
  const Scene alone = read_scene(folder_ / "one.off");
  EXPECT_EQ(alone.mesh.triangles.size(), 1u);
  EXPECT_EQ(alone.materials.size(), 1u);
}

TEST_F(Scenes, TakesMaterialsOfMeshFilesUnlessTheSceneNamesOne) {
  write_text_atomically(folder_ / "m.mtl", "newmtl dull\nKd 0.5 0.25 0\n");
  write_text_atomically(folder_ / "one.obj",
                        "mtllib m.mtl\nusemtl dull\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const auto reflectance = [](const Scene& scene) {
    return diffuse_reflectance(scene).front().matrix().eval();
  };
  const Eigen::Vector3f of_the_file(0.5f, 0.25f, 0.0f);
  EXPECT_LT((reflectance(read_scene(folder_ / "one.obj")) - of_the_file).norm(), 1e-6f);
  EXPECT_LT((reflectance(read("[[object]]\nfile = \"one.obj\"\n")) - of_the_file).norm(), 1e-6f);
  EXPECT_LT((reflectance(read("[[material]]\nname = \"blue\"\ndiffuse = [0, 0, 0.5]\n"
                              "[[object]]\nfile = \"one.obj\"\nmaterial = \"blue\"\n")) -
             Eigen::Vector3f(0.0f, 0.0f, 0.5f))
                .norm(),
            1e-6f);
}

TEST_F(Scenes, PartsOfAMeshFileKeepTheirLobes) {
  write_text_atomically(folder_ / "m.mtl",
                        "newmtl metal\nKd 0.9 0.6 0.3\nPm 1\nPr 0.5\nnewmtl wall\nKd 0.5 0.5 0.5\n");
  write_text_atomically(folder_ / "two.obj",
                        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl metal\nf 1 2 3\n"
                        "usemtl wall\nf 2 4 3\n");
  Scene scene = read("[[object]]\nfile = \"two.obj\"\nrefine = 0.3\n");
  sort_vertices(scene);
  ASSERT_EQ(scene.materials.size(), 2u);
  ASSERT_EQ(scene.specular_of_vertex.size(), scene.mesh.positions.size());
  EXPECT_GT(scene.mesh.positions.size(), 20u);
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v) {
    const bool metal = !scene.materials[scene.material_of_vertex[v]].is_diffuse();
    const float side = scene.mesh.positions[v].x() + scene.mesh.positions[v].y() - 1.0f;
    ASSERT_TRUE(metal ? side < 1e-5f : side > -1e-5f);
    const Eigen::Vector3f specular =
        metal ? Eigen::Vector3f(0.9f, 0.6f, 0.3f) : Eigen::Vector3f::Zero().eval();
    ASSERT_LT((scene.specular(v).matrix() - specular).norm(), 1e-6f);
    ASSERT_NEAR(scene.mesh.colours[v][0], metal ? 0.0f : 0.5f, 1e-6f);
    ASSERT_FLOAT_EQ(scene.materials[scene.material_of_vertex[v]].exponent, metal ? 5.625f : 0.0f);
  }
  for (const auto& triangle : scene.mesh.triangles)
    for (const std::uint32_t vertex : triangle)
      ASSERT_EQ(scene.material_of_vertex[vertex], scene.material_of_vertex[triangle[0]]);

  const Scene clusters = read_scene(folder_ / "two.obj", {}, Gloss::diffuse);
  ASSERT_EQ(clusters.materials.size(), 1u);
  EXPECT_TRUE(clusters.materials[0].is_diffuse());
  float brightest = 0.0f;
  for (const auto& reflectance : diffuse_reflectance(clusters))
    brightest = std::max(brightest, reflectance[0]);
  EXPECT_NEAR(brightest, 0.9f, 1e-6f);
}

TEST_F(Scenes, TakeTheGgxMaterialAsAPhongLobe) {
  const Scene scene = read(
      "[[material]]\nname = \"m\"\nkind = \"ggx\"\nspecular = [0.5, 0.5, 0.5]\nroughness = 0.5\n"
      "[[object]]\nshape = \"plane\"\nmaterial = \"m\"\n");
  EXPECT_FLOAT_EQ(scene.materials[0].exponent, 5.625f);
  EXPECT_FLOAT_EQ(scene.materials[0].roughness, 0.5f);
}

TEST_F(Scenes, DataSetsAreReadAndOfTheSizeTheySay) {
  const std::filesystem::path folder = REFIELD_SOURCE_DIR "/datasets_synthetic/prt";
  EXPECT_NEAR(static_cast<double>(read_scene(folder / "rabbit.toml").mesh.positions.size()), 73000.0, 500.0);
  EXPECT_NEAR(static_cast<double>(read_scene(folder / "small.toml").mesh.positions.size()), 3000.0, 100.0);
  const Scene glossy = read_scene(folder / "glossy.toml");
  EXPECT_EQ(glossy.materials.size(), 4u);
  EXPECT_TRUE(glossy.camera);
}

TEST_F(Scenes, ErrorsNameKeyAndRemedy) {
  EXPECT_THAT(error_of("[camera]\n"), HasSubstr("[[object]]"));
  EXPECT_THAT(error_of("[[object]]\n"), HasSubstr("either `shape` or `file`"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"cone\"\n"),
              HasSubstr("use one of plane, box, sphere, lathe, rabbit"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\ncolor = 1\n"), HasSubstr("color"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\nrefine = 1e-5\n"), HasSubstr("allow longer ones"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"plane\"\nresolution = 100000\n"), HasSubstr("resolution"));
  EXPECT_THAT(
      error_of("[[material]]\nname = \"it\"\nkind = \"phong\"\nspecular = [0.5, 0.5, 0.5]\nexponent = 9\n"),
      HasSubstr("add up to more than 1"));
  EXPECT_THAT(error_of("[[object]]\nfile = \"absent.obj\"\n"), HasSubstr("absent.obj"));
  EXPECT_THAT(error_of("[[mesh]]\nshape = \"box\"\n"), HasSubstr("camera, material, object"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\ndiffuse = [1, 1, 1]\n"),
              HasSubstr("name such a material by the key `material`"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\nmaterial = \"gold\"\n"),
              HasSubstr("no [[material]] of this name"));
  EXPECT_THAT(error_of("[[material]]\nname = \"it\"\nkind = \"glass\"\n[[object]]\nshape = \"box\"\n"),
              HasSubstr("scenes of this type support diffuse, phong"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\nturns = [[0, 0, 0, 0]]\n"), HasSubstr("turns"));
  EXPECT_THAT(error_of("[[object]]\nshape = \"box\"\n[camera]\nposition = [0, 0, 0]\ntarget = [0, 5, 0]\n"),
              HasSubstr("[camera] target"));
}

/// Of what varies between all vertices' normals and positions, the part within groups of 16.
double share_within_groups(const Mesh& mesh) {
  const auto variance = [&](std::size_t group) {
    double sum = 0.0;
    for (std::size_t first = 0; first < mesh.positions.size(); first += group) {
      const std::size_t count = std::min(group, mesh.positions.size() - first);
      Eigen::Matrix<float, 6, Eigen::Dynamic> values(6, count);
      for (std::size_t i = 0; i < count; ++i)
        values.col(static_cast<Eigen::Index>(i)) << mesh.positions[first + i], mesh.normals[first + i];
      sum += (values.colwise() - values.rowwise().mean()).squaredNorm();
    }
    return sum;
  };
  return variance(group_pixels) / variance(mesh.positions.size());
}

TEST_F(Scenes, SortedVerticesAreNeighbours) {
  Scene scene;
  scene.mesh = rabbit_mesh(30);
  scene.materials = {Material{}, Material{}};
  for (const auto& position : scene.mesh.positions)
    scene.material_of_vertex.push_back(position.y() > 0.0f ? 1 : 0);
  const double before = share_within_groups(scene.mesh), whole_area = area(scene.mesh);
  sort_vertices(scene);
  EXPECT_LT(share_within_groups(scene.mesh), 0.02);
  EXPECT_LT(share_within_groups(scene.mesh), 0.2 * before);
  EXPECT_NEAR(area(scene.mesh), whole_area, 1e-4);  // the same surface
  EXPECT_TRUE(fronts_agree(scene.mesh));
  for (const auto& [edge, count] : edges(scene.mesh)) ASSERT_EQ(count, 2);
  for (std::size_t v = 0; v < scene.mesh.positions.size(); ++v)
    ASSERT_EQ(scene.material_of_vertex[v], scene.mesh.positions[v].y() > 0.0f ? 1 : 0);
}

}  // namespace
}  // namespace refield::prt
