// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <string>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/prt/transfer_samples.h"
#include "tests/simulate/dynamic/hemisphere.h"
#include "tests/support/temporary_folder.h"

namespace refield::dynamic {
namespace {

/// What a surface reflects of light from one direction in all: ∫ f cosθ_o dω_o.
double albedo(const Brdf& brdf, const Eigen::Vector3f& in) {
  double sum = 0.0;
  for (const Eigen::Vector3f& out : test::hemisphere(20000)) sum += brdf(in, out)[0] * out.z();
  return sum * 2.0 * std::numbers::pi / 20000;
}

TEST(Brdf, ReflectsWhatItsReflectancesSay) {
  const Brdf diffuse{.diffuse = {0.7f, 0.5f, 0.2f}};
  EXPECT_NEAR(albedo(diffuse, {0.6f, 0.0f, 0.8f}), 0.7, 1e-3);
  const Brdf phong{.diffuse = {0, 0, 0}, .specular = {0.5f, 0.5f, 0.5f}, .lobe = Lobe::phong, .exponent = 20};
  EXPECT_NEAR(albedo(phong, {0.0f, 0.0f, 1.0f}), 0.5, 1e-3);
  const Brdf ggx{.diffuse = {0, 0, 0}, .specular = {1, 1, 1}, .lobe = Lobe::ggx, .roughness = 0.2f};
  const double kept = albedo(ggx, {0.0f, 0.0f, 1.0f});
  EXPECT_LT(kept, 1.001);  // what light would meet a second time is lost, some per cent
  EXPECT_GT(kept, 0.93);
}

TEST(Brdf, IsReciprocalAndFiniteDownToTheHorizon) {
  const auto directions = test::hemisphere(64);
  for (const Brdf& brdf : test::assorted_brdfs())
    for (const Eigen::Vector3f& in : directions)
      for (const Eigen::Vector3f& out : directions)
        EXPECT_NEAR(brdf(in, out)[1], brdf(out, in)[1], 1e-3f * (1.0f + brdf(in, out)[1]));
  const Brdf sharp{.specular = {1, 1, 1}, .lobe = Lobe::ggx, .roughness = 0.01f};
  for (const float z : {1e-30f, 1e-7f, 1.1e-6f, 1e-3f})
    EXPECT_TRUE(sharp({-1.0f, 0.0f, z}, {1.0f, 0.0f, z}).isFinite().all()) << z;
  EXPECT_TRUE((sharp({0.6f, 0.0f, -0.8f}, {0.6f, 0.0f, 0.8f}) == 0.0f).all());
}

TEST(TangentFrame, IsOrthonormalForAllNormals) {
  std::vector<Eigen::Vector3d> normals = prt::hammersley_sphere(500);
  for (const Eigen::Vector3d& normal : {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0, 0, -1),
                                        Eigen::Vector3d(1e-8, 0, -1), Eigen::Vector3d(1, 0, -0.0)})
    normals.push_back(normal);
  for (const Eigen::Vector3d& normal : normals) {
    const Eigen::Matrix3f frame = tangent_frame(normal.cast<float>());
    EXPECT_TRUE((frame * frame.transpose()).isIdentity(1e-5f)) << normal.transpose();
    EXPECT_LT((frame * normal.cast<float>() - Eigen::Vector3f::UnitZ()).norm(), 1e-5f);
  }
}

// Half of the surface is metal, half dielectric: each keeps its reflectance, and they share a lobe.
TEST(DynamicScene, AnObjectHasTheMeanLobeOfItsMeshFile) {
  const refield::test::TemporaryFolder folder;
  const auto read = [&](const std::string& materials) {
    write_text_atomically(folder / "m.mtl", materials);
    write_text_atomically(folder / "m.obj",
                          "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl a\nf 1 2 3\n"
                          "usemtl b\nf 2 4 3\n");
    write_text_atomically(folder / "scene.toml",
                          "[[object]]\nfile = \"m.obj\"\n[[light]]\nshape = \"sphere\"\n"
                          "radiance = [1, 1, 1]\nposition = [0, 3, 0]\n");
    std::string notes;
    DynamicScene scene = read_dynamic_scene(folder / "scene.toml",
                                            {.on_note = [&](const std::string& note) { notes += note; }});
    return std::pair(std::move(scene.objects.at(0)), notes);
  };
  const std::string metal = "Kd 0.6 0.6 0.6\nPm 1\nPr 0.5\n";
  const auto [alike, quiet] = read("newmtl a\n" + metal + "newmtl b\n" + metal);
  EXPECT_EQ(quiet, "");
  EXPECT_EQ(alike.brdf.lobe, Lobe::ggx);
  EXPECT_FLOAT_EQ(alike.brdf.roughness, 0.25f);
  EXPECT_FLOAT_EQ(alike.brdf.specular[0], 1.0f);
  EXPECT_FLOAT_EQ(alike.mesh.colours[0][0], 0.6f);

  const auto [mixed, told] = read("newmtl a\n" + metal + "newmtl b\nKd 0.2 0.2 0.2\n");
  EXPECT_NE(told.find("averaged"), std::string::npos) << told;
  EXPECT_NEAR(mixed.brdf.specular[0], 0.75f, 1e-6f);
  EXPECT_NEAR(mixed.brdf.diffuse[0], 0.25f, 1e-6f);
  EXPECT_FLOAT_EQ(mixed.brdf.roughness, 0.25f);
  for (const auto& colour : mixed.mesh.colours)
    EXPECT_LT(std::min(std::abs(colour[0] - 0.6f), std::abs(colour[0] - 0.2f)), 1e-6f);
}

}  // namespace
}  // namespace refield::dynamic
