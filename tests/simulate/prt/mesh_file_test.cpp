// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "core/base/errors.h"
#include "core/base/files.h"
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
    return read_mesh_file(file(name, text));
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
  const Mesh linear = read_mesh_file(folder_ / "t.ply", ColourCoding::linear);
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
  EXPECT_THAT(error_of("none.off", "OFF\n0 0 0\n"), HasSubstr("no readable mesh"));
  EXPECT_THAT(error_of("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), HasSubstr("none with an area"));
  EXPECT_THAT(error_of("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), HasSubstr("not finite"));
  EXPECT_THAT(error_of("inf.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1e39 0\n3 0 1 2\n"), HasSubstr("not finite"));
  EXPECT_THAT(error_of("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), HasSubstr("index"));
  EXPECT_THAT(error_of("index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
              HasSubstr("refers to a vertex"));
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
  const Mesh mesh = read_mesh_file(file("mesh.gltf", gltf.dump()), std::nullopt, run);
  EXPECT_EQ(notes, "");
  ASSERT_EQ(mesh.positions.size(), 3u);
  EXPECT_FLOAT_EQ(mesh.positions[0].z(), -5.0f);
  EXPECT_NEAR(mesh.colours[0][1], 0.25f, 1e-6f);

  gltf["materials"] = {{{"pbrMetallicRoughness", {{"baseColorFactor", {1, 0, 0, 1}}}}}};
  gltf["meshes"][0]["primitives"][0]["material"] = 0;
  read_mesh_file(file("mesh.gltf", gltf.dump()), std::nullopt, run);
  EXPECT_THAT(notes, HasSubstr("mesh.gltf: its material is not read"));

  gltf["accessors"][0]["count"] = 4000000000u;
  EXPECT_THAT(error_of("huge.gltf", gltf.dump()), HasSubstr("huge.gltf"));
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
  EXPECT_EQ(read("own.obj", std::string("mtllib own.mtl\nusemtl red\n") + tetrahedron_obj).positions.size(),
            4u);
  EXPECT_EQ(read("absent.obj", std::string("mtllib absent.mtl\n") + tetrahedron_obj).positions.size(), 4u);
}

TEST_F(MeshFiles, ErrorsDoNotQuoteTheFile) {
  for (const char* name : {"secret.obj", "secret.off", "secret.gltf", "secret.glb"})
    EXPECT_THAT(error_of(name, "root:x:0:0:root:/root:/bin/bash\n\x1b[2J {]\nusemtl \x1b[2J\n"),
                ::testing::Not(::testing::AnyOf(HasSubstr("root"), HasSubstr("\x1b"))));
}

}  // namespace
}  // namespace refield::prt
