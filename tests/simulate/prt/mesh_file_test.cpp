// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield::prt {
namespace {

using refield::test::message_of;
using ::testing::HasSubstr;

// A tetrahedron with outward faces, right-handed.
constexpr const char* tetrahedron_off =
    "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
constexpr const char* tetrahedron_obj =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
const std::string ply_head =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 0 128 0 0\n1 0 0 128 0 0\n0 1 0 128 0 0\n0 0 1 0 0 255\n";
const std::string tetrahedron_ply = ply_head + "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

/// By the divergence theorem; positive where all faces look outwards.
double volume(const Mesh& mesh) {
  double six_volumes = 0.0;
  for (const auto& [a, b, c] : mesh.triangles)
    six_volumes += mesh.positions[a].cross(mesh.positions[b]).dot(mesh.positions[c]);
  return six_volumes / 6.0;
}

class MeshFiles : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& name, const std::string& text) const {
    write_text_atomically(folder_ / name, text);
    return folder_ / name;
  }
  Mesh read(const std::string& name, const std::string& text) const {
    return read_mesh_file(file(name, text)).mesh;
  }
  std::string error_of(const std::string& name, const std::string& text) const {
    return message_of<FormatError>([&] { read(name, text); });
  }
  refield::test::TemporaryFolder folder_;
};

TEST_F(MeshFiles, AllFormatsGiveTheSameMeshInLightAxes) {
  const std::vector<std::pair<const char*, std::string>> files = {{"t.off", tetrahedron_off},
                                                                  {"T.OFF", tetrahedron_off},
                                                                  {"t.obj", tetrahedron_obj},
                                                                  {"t.ply", tetrahedron_ply}};
  for (const auto& [name, text] : files) {
    SCOPED_TRACE(name);
    const Mesh mesh = read(name, text);
    EXPECT_EQ(mesh.positions.size(), 4u);
    EXPECT_EQ(mesh.triangles.size(), 4u);
    EXPECT_NEAR(volume(mesh), 1.0 / 6.0, 1e-6);
    float lowest_z = 0.0f;
    for (const auto& position : mesh.positions) lowest_z = std::min(lowest_z, position.z());
    EXPECT_FLOAT_EQ(lowest_z, -1.0f);
  }
}

TEST_F(MeshFiles, NormalsAreWeightedByArea) {
  const Mesh mesh = read("t.off", tetrahedron_off);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    if (!mesh.positions[v].isZero()) continue;
    // Three faces of equal area meet here.
    EXPECT_LT((mesh.normals[v] - Eigen::Vector3f(-1, -1, 1).normalized()).norm(), 1e-6f);
  }
}

TEST_F(MeshFiles, ColoursOfEightBitFilesAreDecodedAsSrgb) {
  const Mesh mesh = read("t.ply", tetrahedron_ply);
  const Mesh linear = read_mesh_file(folder_ / "t.ply", {ColourCoding::linear}).mesh;
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    const bool blue = mesh.positions[v].z() < 0.0f;
    EXPECT_NEAR(mesh.colours[v][0], blue ? 0.0f : linear_from_srgb(128.0f / 255.0f), 1e-5f);
    EXPECT_NEAR(linear.colours[v][0], blue ? 0.0f : 128.0f / 255.0f, 1e-5f);
    EXPECT_NEAR(mesh.colours[v][2], blue ? 1.0f : 0.0f, 1e-5f);
  }
  const Mesh off =
      read("c.off", "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n0 1 0 255 0 0 255\n3 0 1 2\n");
  EXPECT_EQ(off.colours[0].matrix(), Eigen::Vector3f(1, 0, 0));
}

TEST_F(MeshFiles, DuplicatesAreJoinedUnlessTheirNormalsDiffer) {
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 0 0 1\nv 0 0 0\n";
  EXPECT_EQ(read("soft.obj", corners + "f 1 2 3\nf 4 6 5\n").positions.size(), 4u);
  const std::string normals = "vn 0 0 1\nvn 0 -1 0\n";
  const Mesh hard = read("hard.obj", corners + normals + "f 1//1 2//1 3//1\nf 4//2 6//2 5//2\n");
  ASSERT_EQ(hard.positions.size(), 6u);
  for (const auto& normal : hard.normals) EXPECT_FLOAT_EQ(normal.cwiseAbs().maxCoeff(), 1.0f);
}

TEST_F(MeshFiles, TrianglesWithoutAreaAreLeftOut) {
  const Mesh mesh = read("d.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\n");
  EXPECT_EQ(mesh.triangles.size(), 1u);
  EXPECT_EQ(mesh.positions.size(), 3u);
}

TEST_F(MeshFiles, BadMeshesAreNamedWithTheRemedy) {
  EXPECT_THAT(error_of("empty.off", ""), HasSubstr("empty"));
  EXPECT_THAT(error_of("none.off", "OFF\n0 0 0\n"), HasSubstr("convert a point cloud"));
  EXPECT_THAT(error_of("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), HasSubstr("none with an area"));
  EXPECT_THAT(error_of("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), HasSubstr("not finite"));
  EXPECT_THAT(error_of("inf.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1e39 0\n3 0 1 2\n"), HasSubstr("not finite"));
  EXPECT_THAT(error_of("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), HasSubstr("index"));
  EXPECT_THAT(error_of("index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
              HasSubstr("names vertex 7 of 3"));
  EXPECT_THAT(error_of("index.ply", ply_head + "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 9\n"),
              HasSubstr("names vertex 9 of 4"));
  EXPECT_THAT(
      error_of("endless.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_hea\n0\n"),
      HasSubstr("does not end"));
  EXPECT_THAT(error_of("text.glb", "this is no mesh"), HasSubstr("text.glb"));
  EXPECT_THAT(error_of("mesh.stl", tetrahedron_obj), HasSubstr("convert this one"));
  EXPECT_THAT(message_of<DeviceError>([&] { read_mesh_file(folder_ / "absent.obj"); }),
              HasSubstr("absent.obj"));
}

TEST_F(MeshFiles, GigabytesAskedForAreRefused) {
  EXPECT_THAT(error_of("huge.off", "OFF\n4000000000 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
              HasSubstr("cannot hold that many"));
  EXPECT_THAT(error_of("huge.ply",
                       "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n0\n"),
              HasSubstr("cannot hold that many"));
}

TEST_F(MeshFiles, GltfHasItsPartsInPlaceAndLinearColours) {
  const std::vector<float> values = {0, 0, 0, 1, 0, 0, 0, 1, 0, .5f, .25f, 0, .5f, .25f, 0, .5f, .25f, 0};
  const std::vector<std::uint16_t> indices = {0, 1, 2};
  std::string bytes(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  bytes.append(reinterpret_cast<const char*>(indices.data()), indices.size() * sizeof(std::uint16_t));
  file("data.bin", bytes);
  nlohmann::json gltf = nlohmann::json::parse(R"({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "translation": [0, 0, 5]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}]}],
    "accessors": [
      {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
      {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC3"},
      {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteLength": 72}, {"buffer": 0, "byteOffset": 72, "byteLength": 6}],
    "buffers": [{"uri": "data.bin", "byteLength": 78}]})");
  std::string notes;
  const RunContext run{.on_note = [&](const std::string& note) { notes += note; }};
  const MeshFile plain = read_mesh_file(file("mesh.gltf", gltf.dump()), {}, run);
  EXPECT_EQ(notes, "");
  EXPECT_FALSE(plain.has_materials);
  const Mesh& mesh = plain.mesh;
  ASSERT_EQ(mesh.positions.size(), 3u);
  EXPECT_FLOAT_EQ(mesh.positions[0].z(), -5.0f);
  EXPECT_NEAR(mesh.colours[0][1], 0.25f, 1e-6f);

  gltf["materials"] = {
      {{"pbrMetallicRoughness", {{"baseColorFactor", {1, 0.5, 0, 1}}, {"metallicFactor", 0}}}}};
  gltf["meshes"][0]["primitives"][0]["material"] = 0;
  const MeshFile coloured = read_mesh_file(file("mesh.gltf", gltf.dump()), {}, run);
  EXPECT_EQ(notes, "");
  EXPECT_TRUE(coloured.has_materials);
  EXPECT_TRUE(coloured.lobes.empty()) << "roughness is 1 by default";
  EXPECT_NEAR(coloured.mesh.colours[0][0], 0.96f * 0.5f + 0.04f, 1e-6f);
  EXPECT_NEAR(coloured.mesh.colours[0][1], 0.96f * 0.125f + 0.04f, 1e-6f);
  EXPECT_FLOAT_EQ(read_mesh_file(folder_ / "mesh.gltf", {.materials = false}, run).mesh.colours[0][0], 0.5f);

  gltf["materials"][0]["normalTexture"] = {{"index", 0}};
  gltf["textures"] = {{{"source", 0}}};
  gltf["images"] = {{{"uri", "absent.png"}}};
  gltf["materials"][0]["emissiveFactor"] = {1, 1, 1};
  read_mesh_file(file("mesh.gltf", gltf.dump()), {}, run);
  EXPECT_THAT(notes, HasSubstr("normal and bump maps, emission are ignored"));

  gltf["accessors"][0]["count"] = 4000000000u;
  EXPECT_THAT(error_of("huge.gltf", gltf.dump()), HasSubstr("huge.gltf"));
}

/// A quad in z = 0 of `steps`² squares whose texture coordinates go `turns` times around.
std::string textured_quad(int steps, double turns) {
  std::ostringstream obj;
  obj << "mtllib m.mtl\nusemtl painted\n";
  for (int j = 0; j <= steps; ++j)
    for (int i = 0; i <= steps; ++i)
      obj << "v " << i << ' ' << j << " 0\nvt " << turns * i / steps << ' ' << turns * j / steps << '\n';
  for (int j = 0; j < steps; ++j)
    for (int i = 0; i < steps; ++i) {
      const int a = j * (steps + 1) + i + 1, b = a + 1, c = b + steps + 1, d = c - 1;
      obj << "f " << a << '/' << a << ' ' << b << '/' << b << ' ' << c << '/' << c << ' ' << d << '/' << d
          << '\n';
    }
  return obj.str();
}

/// Upper left red, upper right green, lower left blue, lower right white.
Image four_colours(int side) {
  Image image(side, side, 3);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const bool right = 2 * x >= side, low = 2 * y >= side;
      image.at(x, y, 0) = right == low ? 1.0f : 0.0f;
      image.at(x, y, 1) = right ? 1.0f : 0.0f;
      image.at(x, y, 2) = low ? 1.0f : 0.0f;
    }
  return image;
}

TEST_F(MeshFiles, VerticesHaveTheColourOfTheTextureAroundThem) {
  write_png(folder_ / "paint.png", four_colours(64), {.exposure = 1.0});
  file("m.mtl", "newmtl painted\nKd 1 0.5 1\nmap_Kd paint.png\n");
  const Mesh mesh = read("fine.obj", textured_quad(8, 1.0));
  ASSERT_EQ(mesh.positions.size(), 81u);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    const float x = mesh.positions[v].x(), y = mesh.positions[v].y();
    if (x < 1.0f || x > 7.0f || y < 1.0f || y > 7.0f || x == 4.0f || y == 4.0f) continue;  // mixed
    const bool right = x > 4.0f, low = y < 4.0f;
    const Eigen::Vector3f expected(right == low ? 1.0f : 0.0f, right ? 0.5f : 0.0f, low ? 1.0f : 0.0f);
    EXPECT_LT((mesh.colours[v].matrix() - expected).norm(), 1e-5f) << x << ' ' << y;
  }
  // Where the exporter had it does not matter.
  for (const char* place : {"/home/artist/paint.png", "C:\\textures\\paint.png"}) {
    file("m.mtl", std::string("newmtl painted\nKd 1 0.5 1\nmap_Kd ") + place + "\n");
    EXPECT_EQ(read("fine.obj", textured_quad(8, 1.0)).colours[0].matrix(), mesh.colours[0].matrix()) << place;
  }
  // Finer than the mesh: no single texel, but the mean.
  for (const auto& colour : read("coarse.obj", textured_quad(2, 32.0)).colours)
    EXPECT_LT((colour.matrix() - Eigen::Vector3f(0.5f, 0.25f, 0.5f)).norm(), 0.05f);
}

std::string base64(const std::vector<std::uint8_t>& bytes) {
  constexpr const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t j = i; j < i + 3; ++j) three = three << 8 | (j < bytes.size() ? bytes[j] : 0u);
    for (int shift = 18; shift >= 0; shift -= 6) text += digits[three >> shift & 63];
  }
  for (std::size_t i = 0; i < (3 - bytes.size() % 3) % 3; ++i) text[text.size() - 1 - i] = '=';
  return text;
}

/// A triangle and its file of data: a vertex in the upper half of a texture and two in the lower one, all
/// with the vertex colour (0.5, 0.5, 1).
class GltfMaterials : public MeshFiles {
 protected:
  GltfMaterials() {
    const std::vector<float> values = {0,   0,   0,   1,   0,   0, 0,   1,   0, .1f, .2f, .1f,
                                       .8f, .2f, .8f, .5f, .5f, 1, .5f, .5f, 1, .5f, .5f, 1};
    file("data.bin",
         std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)));
  }
  MeshFile read_material(nlohmann::json material, const nlohmann::json& image = "absent.png",
                         Gloss gloss = Gloss::lobes) {
    gltf_["materials"] = {{{"pbrMetallicRoughness", std::move(material)}}};
    gltf_["images"] = {{{"uri", image}}};
    notes_.clear();
    return read_mesh_file(file("material.gltf", gltf_.dump()), {.gloss = gloss},
                          {.on_note = [&](const std::string& note) { notes_ += note; }});
  }

  std::string notes_;
  nlohmann::json gltf_ = nlohmann::json::parse(R"({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
    "textures": [{"source": 0}],
    "accessors": [
      {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
      {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2"},
      {"bufferView": 0, "byteOffset": 60, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 96}],
    "buffers": [{"uri": "data.bin", "byteLength": 96}]})");
};

TEST_F(GltfMaterials, MetallicRoughnessIsSharedOutBetweenColourAndLobe) {
  gltf_["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2;
  const nlohmann::json material = {
      {"baseColorFactor", {0.8, 0.4, 0.2, 1}}, {"metallicFactor", 0.25}, {"roughnessFactor", 0.4}};
  const Eigen::Array3f base(0.4f, 0.2f, 0.2f);  // vertex colours multiply
  const Eigen::Array3f colour = 0.75f * 0.96f * base, specular = 0.75f * 0.04f + 0.25f * base;
  const MeshFile mesh = read_material(material);
  EXPECT_EQ(notes_, "");
  ASSERT_EQ(mesh.lobes.size(), 3u);
  for (std::size_t v = 0; v < 3; ++v) {
    EXPECT_LT((mesh.mesh.colours[v] - colour).abs().maxCoeff(), 1e-6f);
    EXPECT_LT((mesh.lobes[v].head<3>() - specular).abs().maxCoeff(), 1e-6f);
    EXPECT_FLOAT_EQ(mesh.lobes[v][3], 0.4f);
  }
  EXPECT_EQ(read_material({{"roughnessFactor", 0.4}}).lobes.size(), 3u) << "white metal without a name";
  const MeshFile diffuse = read_material(material, "absent.png", Gloss::diffuse);
  EXPECT_THAT(notes_, HasSubstr("reflected diffusely, with the same reflectance"));
  EXPECT_TRUE(diffuse.lobes.empty());
  EXPECT_LT((diffuse.mesh.colours[0] - colour - specular).abs().maxCoeff(), 1e-6f);
}

TEST_F(GltfMaterials, MetallicVariesByItsTextureAndRoughnessIsAveraged) {
  Image map(64, 64, 3);  // linear green and blue: rough and dielectric above, smooth and metallic below
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      map.at(x, y, 1) = linear_from_srgb(y < 32 ? 0.8f : 0.2f);
      map.at(x, y, 2) = y < 32 ? 0.0f : 1.0f;
    }
  const std::string image = "data:image/png;base64," + base64(encode_png(map, {.exposure = 1.0}));
  const MeshFile mesh = read_material({{"metallicRoughnessTexture", {{"index", 0}}}}, image);
  ASSERT_EQ(mesh.lobes.size(), 3u);
  float above = 0.0f, below = 0.0f;
  for (std::size_t v = 0; v < 3; ++v) (mesh.mesh.positions[v].isZero() ? above : below) = mesh.lobes[v][0];
  EXPECT_GT(below, above + 0.2f);
  EXPECT_EQ(mesh.lobes[0][3], mesh.lobes[1][3]);
  EXPECT_GT(mesh.lobes[0][3], 0.3f);
  EXPECT_LT(mesh.lobes[0][3], 0.6f);
}

TEST_F(GltfMaterials, FactorsOutOfRangeAreClampedAndTold) {
  const MeshFile mesh =
      read_material({{"baseColorFactor", {2, 0.5, -1, 1}}, {"metallicFactor", 7}, {"roughnessFactor", -3}});
  EXPECT_THAT(notes_, HasSubstr("factors outside [0, 1]"));
  ASSERT_EQ(mesh.lobes.size(), 3u);
  EXPECT_EQ(mesh.mesh.colours[0].matrix(), Eigen::Vector3f::Zero());
  EXPECT_EQ(mesh.lobes[0].matrix(), Eigen::Vector4f(1.0f, 0.5f, 0.0f, min_roughness));
}

TEST_F(GltfMaterials, AMissingTextureOfMetalIsTold) {
  const MeshFile mesh =
      read_material({{"metallicRoughnessTexture", {{"index", 0}}}, {"roughnessFactor", 0.5}});
  EXPECT_THAT(notes_, HasSubstr("shown without it"));
  ASSERT_EQ(mesh.lobes.size(), 3u);
  EXPECT_FLOAT_EQ(mesh.lobes[0][0], 1.0f);
  EXPECT_FLOAT_EQ(mesh.lobes[0][3], 0.5f);
}

TEST_F(MeshFiles, MaterialsOfObjHaveLobes) {
  const std::string triangle = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n";
  const auto read_mtl = [&](const std::string& material) {
    file("m.mtl", "newmtl m\n" + material);
    return read_mesh_file(file("m.obj", "mtllib m.mtl\nusemtl m\n" + triangle));
  };
  const MeshFile metal = read_mtl("Kd 0.5 0.5 0.5\nPm 1\nPr 0.3\n");
  ASSERT_EQ(metal.lobes.size(), 3u);
  EXPECT_EQ(metal.mesh.colours[0].matrix(), Eigen::Vector3f::Zero());
  EXPECT_LT((metal.lobes[0] - Eigen::Array4f(0.5f, 0.0f, 0.0f, 0.3f)).abs().maxCoeff(), 1e-6f);

  // Kd + Ks, and a half-vector lobe of exponent 198: α² = 1/100.
  const MeshFile phong = read_mtl("Kd 0.6 0.6 0.6\nKs 0.25 0.25 0.25\nNs 198\nillum 2\n");
  ASSERT_EQ(phong.lobes.size(), 3u);
  EXPECT_LT((phong.mesh.colours[0] - Eigen::Array3f(0.6f, 0.0f, 0.0f)).abs().maxCoeff(), 1e-6f);
  EXPECT_LT((phong.lobes[0] - Eigen::Array4f(0.25f, 0.25f, 0.25f, std::sqrt(0.1f))).abs().maxCoeff(), 1e-6f);

  const MeshFile excess = read_mtl("Kd 0.8 0.8 0.8\nKs 0.5 0.5 0.5\nNs 198\n");
  EXPECT_NEAR(excess.mesh.colours[0][0], 0.5f, 1e-6f) << "no more than what Ks leaves";
  EXPECT_TRUE(read_mtl("Kd 0.8 0.8 0.8\nNs 198\n").lobes.empty());
}

TEST_F(GltfMaterials, TexturesInsideAFileAreRead) {
  // glTF counts rows of a texture from the top.
  Image stripes(64, 64, 3);  // red above, blue below
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) stripes.at(x, y, y < 32 ? 0 : 2) = 1.0f;
  const MeshFile mesh = read_material({{"baseColorTexture", {{"index", 0}}}, {"metallicFactor", 0}},
                                      "data:image/png;base64," + base64(encode_png(stripes)));
  EXPECT_TRUE(mesh.has_materials);
  for (std::size_t v = 0; v < 3;
       ++v)  // averages reach over the middle: the triangle is as large as the texture
    EXPECT_EQ(mesh.mesh.colours[v][0] > mesh.mesh.colours[v][2], mesh.mesh.positions[v].isZero()) << v;
}

TEST_F(MeshFiles, TexturesThatCannotBeReadAreTold) {
  const refield::test::TemporaryFolder elsewhere;
  write_png(elsewhere / "secret.png", four_colours(4));
  std::filesystem::create_symlink(elsewhere / "secret.png", folder_ / "link.png");
  file("damaged.png", std::string("\x89PNG\r\n\x1a\n") + "no more");
  for (const char* name : {"absent.png", "link.png", "damaged.png", "../../../../etc/passwd"}) {
    file("m.mtl", std::string("newmtl painted\nKd 0.5 0.5 0.5\nmap_Kd ") + name + "\n");
    std::string notes;
    const RunContext run{.on_note = [&](const std::string& note) { notes += note; }};
    const MeshFile mesh = read_mesh_file(file("t.obj", textured_quad(1, 1.0)), {}, run);
    EXPECT_THAT(notes, HasSubstr("shown without it")) << name;
    EXPECT_THAT(notes, ::testing::Not(HasSubstr("passwd")));
    EXPECT_NEAR(mesh.mesh.colours[0][1], 0.5f, 1e-5f) << name;
  }
}

TEST_F(MeshFiles, NormalsGoOverTheEdgesOfMaterials) {
  file("m.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n");
  const Mesh mesh = read("t.obj",
                         "mtllib m.mtl\nv 0 0 0\nv 0 1 0\nv -1 0 1\nv 1 0 1\n"
                         "usemtl a\nf 1 2 3\nusemtl b\nf 1 4 2\n");
  ASSERT_EQ(mesh.positions.size(), 6u);  // both colours along the ridge
  for (std::size_t v = 0; v < 6; ++v) {
    if (mesh.positions[v].x() != 0.0f) continue;
    EXPECT_NEAR(std::abs(mesh.normals[v].z()), 1.0f, 1e-6f);
  }
}

// A mesh from elsewhere must not make the program read the user's other files, show them or wait for a pipe.
TEST_F(MeshFiles, ReferencesStayInTheFolder) {
  const refield::test::TemporaryFolder elsewhere;
  const std::string secret = "root:x:0:0:secret";
  write_text_atomically(elsewhere / "secret.mtl", secret + "\nnewmtl " + secret + "\n");
  const std::string outside = std::filesystem::relative(elsewhere / "secret.mtl", folder_.path()).string();
  std::filesystem::create_symlink(elsewhere / "secret.mtl", folder_ / "link.mtl");
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  const auto gltf = [](const std::string& uri) {
    return R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
      "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
      "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
      "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": ")" +
           uri + "\"}]}";
  };
  for (const std::string& name : {outside, std::string("link.mtl"), std::string("pipe")}) {
    for (const std::string& error :
         {error_of("a.obj", "mtllib " + name + "\n" + tetrahedron_obj), error_of("a.gltf", gltf(name))}) {
      EXPECT_THAT(error, HasSubstr("refers to")) << name;
      EXPECT_THAT(error, ::testing::Not(HasSubstr("secret:"))) << name;
      EXPECT_THAT(error, ::testing::Not(HasSubstr("root"))) << name;
    }
  }
  file("own.mtl", "newmtl red\nKd 1 0 0\n");
  const Mesh own = read("own.obj", std::string("mtllib own.mtl\nusemtl red\n") + tetrahedron_obj);
  ASSERT_EQ(own.positions.size(), 4u);
  EXPECT_EQ(own.colours[0].matrix(), Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(read("absent.obj", std::string("mtllib absent.mtl\n") + tetrahedron_obj).positions.size(), 4u);
}

TEST_F(MeshFiles, ErrorsDoNotQuoteTheFile) {
  for (const char* name : {"secret.obj", "secret.off", "secret.gltf", "secret.glb"})
    EXPECT_THAT(error_of(name, "root:x:0:0:root:/root:/bin/bash\n\x1b[2J {]\nusemtl \x1b[2J\n"),
                ::testing::Not(::testing::AnyOf(HasSubstr("root"), HasSubstr("\x1b"))));
}

}  // namespace
}  // namespace refield::prt
