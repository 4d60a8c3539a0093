// SPDX-License-Identifier: Apache-2.0
// What the verbs do with fields over a mesh.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "relight/field_pictures.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/cli/matchers.h"
#include "tests/support/mesh_field.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

class MeshFieldVerbs : public testing::Test {
 protected:
  MeshFieldVerbs() : field_(test::unshadowed_field(prt::rabbit_mesh(6))) {
    for (auto& colour : field_.mesh->colours) colour = Eigen::Array3f(0.8f, 0.5f, 0.2f);
    write_reflectance_field(path_, field_);
    Rng rng(1);
    light_ = test::random_light(rng, field_.basis.domain);
    write_exr(light_path_, light_.radiance);
  }

  test::CommandResult relight(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"relight", path_});
    return run_refield(arguments);
  }
  Image picture(const PinholeCamera& camera) const {
    return FieldPictures(field_, {camera}).picture(light_, 0);
  }

  test::TemporaryFolder folder_;
  const std::string path_ = folder_ / "rabbit.rfield", light_path_ = folder_ / "light.exr",
                    output_ = folder_ / "out.exr";
  ReflectanceField field_;
  LightMap light_;
};

TEST_F(MeshFieldVerbs, RelightShowsTheMeshFromInFront) {
  EXPECT_THAT(relight({"--light", light_path_, "-o", output_}), Succeeded());
  const Image shown = read_image(output_);
  EXPECT_EQ(shown.width, 640);
  EXPECT_EQ(shown.values, picture(framing_camera(*field_.mesh, 640, 480)).values);
  double sum = 0.0;
  for (const float value : shown.values) sum += value;
  EXPECT_GT(sum, 0.0);
}

TEST_F(MeshFieldVerbs, RelightWritesCoverageAsAlpha) {
  const std::string png = folder_ / "out.png";
  const std::vector<std::string> camera = {
      "--camera-position", "0,0,-3", "--camera-target", "0,0,0", "--size", "64x48"};
  for (const std::string& output : {output_, png}) {
    std::vector<std::string> arguments = {"--light", light_path_, "-o", output, "--exposure", "1"};
    arguments.insert(arguments.end(), camera.begin(), camera.end());
    ASSERT_THAT(relight(arguments), Succeeded());
    const auto input = OIIO::ImageInput::open(output);
    const OIIO::ImageSpec& spec = input->spec();
    ASSERT_EQ(spec.nchannels, 4) << output;
    EXPECT_EQ(spec.alpha_channel, 3);
    std::vector<float> values(std::size_t{64} * 48 * 4);
    ASSERT_TRUE(input->read_image(0, 0, 0, 4, OIIO::TypeDesc::FLOAT, values.data()));
    EXPECT_EQ(values[3], 0.0f) << "a corner shows the background";
    EXPECT_EQ(values[(24 * 64 + 32) * 4 + 3], 1.0f) << "the middle shows the mesh";
    const auto partly = [&](std::size_t p) { return values[4 * p + 3] > 0.0f && values[4 * p + 3] < 1.0f; };
    std::size_t edges = 0;
    for (std::size_t p = 0; p < values.size() / 4; ++p) edges += partly(p) ? 1 : 0;
    EXPECT_GT(edges, 20u);
  }
  // Both say the same radiance over black; PNG rounds it.
  const Image exact = read_image(output_), rounded = read_image(png);
  for (std::size_t i = 0; i < exact.values.size(); ++i)
    EXPECT_NEAR(std::min(exact.values[i], 1.0f), rounded.values[i], 0.02f) << i;
}

TEST_F(MeshFieldVerbs, TheEnvironmentIsShownBehindTheMesh) {
  // Dark but for what lies ahead to the right, 45° to 90° from +Z.
  const std::string sky = folder_ / "sky.exr";
  Image map(64, 32, 3);
  for (int y = 0; y < 32; ++y)
    for (int x = 40; x < 48; ++x) map.at(x, y, 1) = 3.0f;
  write_exr(sky, map);
  const auto picture = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"--env", sky, "-o", output_, "--camera-position", "0,0,-3", "--camera-target",
                               "0,0,0", "--vertical-fov", "60", "--size", "90x60"});
    EXPECT_THAT(relight(more), Succeeded());
    const auto input = OIIO::ImageInput::open(output_);
    return std::pair(read_image(output_), input->spec().nchannels);
  };
  const auto [scene, with_alpha] = picture({});
  const auto [whole, without] = picture({"--show-environment"});
  EXPECT_EQ(with_alpha, 4);
  EXPECT_EQ(without, 3);
  EXPECT_EQ(whole.at(45, 30, 1), scene.at(45, 30, 1)) << "the mesh";
  EXPECT_EQ(whole.at(10, 5, 1), 0.0f) << "41° to the left is dark";
  EXPECT_EQ(whole.at(80, 5, 1), 0.0f) << "and so is 39° to the right";
  const Image turned = picture({"--show-environment", "--yaw", "-30"}).first;
  EXPECT_NEAR(turned.at(80, 5, 1), 3.0f, 1e-5f) << "where the light has come from further right";
  EXPECT_EQ(turned.at(10, 5, 1), 0.0f);
  EXPECT_THAT(relight({"--env", sky, "--show-environment", "--rotate", "--frames", "2", "--size", "40x30",
                       "-o", folder_ / "out.mp4"}),
              Succeeded());
}

TEST_F(MeshFieldVerbs, LightIsBakedIntoVertexColours) {
  const std::string baked = folder_ / "rabbit.glb";
  ASSERT_THAT(relight({"--light", light_path_, "--exposure", "0.5", "-o", baked}), Succeeded());
  const prt::MeshFile back = prt::read_mesh_file(baked);
  ASSERT_EQ(back.mesh.positions.size(), field_.mesh->positions.size());
  ASSERT_EQ(back.mesh.triangles.size(), field_.mesh->triangles.size());
  const Image outputs = field_.relight(light_);
  // Vertices may come back in another order.
  for (std::size_t v = 0; v < back.mesh.positions.size(); v += 7) {
    const auto distance = [&](std::size_t other) {
      return (field_.mesh->positions[other] - back.mesh.positions[v]).norm();
    };
    std::size_t nearest = 0;
    for (std::size_t other = 0; other < field_.mesh->positions.size(); ++other)
      if (distance(other) < distance(nearest)) nearest = other;
    EXPECT_LT(distance(nearest), 1e-6f);
    EXPECT_GT(back.mesh.normals[v].dot(field_.mesh->normals[nearest]), 0.99f);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(back.mesh.colours[v][c],
                  std::clamp(0.5f * outputs.values[3 * pixel_of_output(nearest) + c] *
                                 field_.mesh->colours[nearest][c],
                             0.0f, 1.0f),
                  1e-5f);
  }
}

TEST_F(MeshFieldVerbs, RelightTakesACamera) {
  EXPECT_THAT(relight({"--light", light_path_, "--camera-position", "-1.5,0.5,2", "--camera-target",
                       "0,0.1,-.1", "--vertical-fov", "50", "--size", "120x90", "-o", output_}),
              Succeeded());
  PinholeCamera camera;
  camera.position = {-1.5f, 0.5f, 2.0f};
  camera.target = {0.0f, 0.1f, -0.1f};
  camera.vertical_field_of_view_degrees = 50.0f;
  camera.width = 120;
  camera.height = 90;
  EXPECT_EQ(read_image(output_).values, picture(camera).values);
}

TEST_F(MeshFieldVerbs, TheScenesOwnCameraComesFirst) {
  field_.mesh->camera = PinholeCamera{{1.0f, 1.0f, -2.0f}, {0, 0, 0}, {0, 1, 0}, 40.0f, 100, 80};
  write_reflectance_field(path_, field_);
  EXPECT_THAT(relight({"--light", light_path_, "-o", output_}), Succeeded());
  EXPECT_EQ(read_image(output_).values, picture(*field_.mesh->camera).values);
}

TEST_F(MeshFieldVerbs, ATurntableGoesAround) {
  const fs::path around = folder_ / "around";
  EXPECT_THAT(
      relight({"--light", light_path_, "--turntable", "--frames", "4", "--size", "60x60", "-o", around}),
      Succeeded());
  PinholeCamera camera = framing_camera(*field_.mesh, 60, 60);
  EXPECT_EQ(read_image(around / "turntable_0000.exr").values, picture(camera).values);
  // Half a turn later it stands opposite.
  const Eigen::Vector3f offset = camera.position - camera.target;
  camera.position = camera.target + Eigen::Vector3f(-offset.x(), offset.y(), -offset.z());
  EXPECT_LT(relative_rmse(read_image(around / "turntable_0002.exr"), picture(camera)), 0.02);
}

TEST_F(MeshFieldVerbs, EnvironmentsOfAnySizeLightIt) {
  // White all around: every vertex gives its colour.
  const std::string white = folder_ / "white.exr";
  write_exr(white, Image(64, 32, 3, 1.0f));
  EXPECT_THAT(relight({"--env", white, "--rotate", "--turntable", "--frames", "2", "--size", "40x40", "-o",
                       folder_ / "white"}),
              Succeeded());
  const Image shown = read_image(folder_ / "white/rotation_0001.exr");
  EXPECT_NEAR(shown.at(20, 22, 0), 0.8f, 0.05f);  // sixteen texels per face
  EXPECT_NEAR(shown.at(20, 22, 2), 0.2f, 0.0125f);
}

TEST_F(MeshFieldVerbs, WrongCamerasAreRefused) {
  const std::vector<std::string> lit = {"--light", light_path_, "-o", output_};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), lit.begin(), lit.end());
    return relight(more);
  };
  EXPECT_THAT(with({"--size", "0x7"}), RefusedNaming("--size", "16384x16384"));
  EXPECT_THAT(with({"--vertical-fov", "180"}), RefusedNaming("field of view", "between 0 and 180"));
  EXPECT_THAT(with({"--camera-position", "0,9,0", "--camera-target", "0,0,0"}),
              RefusedNaming("camera", "another target or up"));
  EXPECT_THAT(with({"--turntable"}), RefusedNaming("--frames", "--turntable"));
}

TEST_F(MeshFieldVerbs, PhotographsHaveNoOtherCamera) {
  Rng rng(1);
  const std::string photographed = folder_ / "photographed.rfield";
  write_reflectance_field(photographed, test::random_field(rng, 12, 9, field_.basis.domain, 40, 6));
  EXPECT_THAT(
      run_refield({"relight", photographed, "--light", light_path_, "--vertical-fov", "40", "-o", output_}),
      RefusedNaming("photographed.rfield", "remove --camera-position"));
}

TEST_F(MeshFieldVerbs, VerbsThatNeedPixelsSaySo) {
  EXPECT_THAT(run_refield({"compare", path_, "--light", light_path_, "--observed", light_path_}),
              RefusedNaming("rabbit.rfield", "refield view"));
}

}  // namespace
}  // namespace refield
