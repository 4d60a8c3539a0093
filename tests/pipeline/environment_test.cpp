// SPDX-License-Identifier: Apache-2.0
// A scene is captured before a virtual monitor and put into new environment. The truth is traced anew with a
// monitor of sixteen times as many texels, each of which shines as the environment does in its direction;
// that direction follows from the recipe by the formulas here, without the geometry that the field carries.
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "simulate/rig/light_maps.h"
#include "simulate/tabletop/recipe.h"
#include "simulate/tabletop/scene.h"
#include "simulate/tabletop/simulate.h"
#include "tests/pipeline/program.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

constexpr const char* recipe_text = R"(
seed = 12
[camera]
width = 32
height = 24
position = [-0.2, 0.45, -1.0]
target = [0.02, 0.06, 0.0]
vertical_fov_degrees = 26.0
[monitor]
width = 32
height = 24
position = [0.62, 0.33, -0.1]
towards = [-0.38, 0.08, -0.25]
width_m = 0.8
height_m = 0.6
[lights]
train = 90
natural = 6
bars = 1
squares = 1
[[material]]
name = "clay"
kind = "diffuse"
diffuse = [0.6, 0.4, 0.3]
[[material]]
name = "glaze"
kind = "glossy"
diffuse = [0.2, 0.3, 0.5]
roughness = 0.4
[[object]]
name = "table"
shape = "plane"
material = "clay"
stretch = [1.2, 1.0, 1.2]
[[object]]
name = "ball"
shape = "sphere"
material = "glaze"
position = [0.0, 0.1, 0.0]
size = 0.2
)";

/// What the environment looks like from the middle of the scene towards a point, texel by texel: axes and
/// formulas of docs/guide/relighting.md and docs/reference/conventions.md, written out.
class Environment {
 public:
  Environment(const Image& map, double yaw_degrees, const SceneCamera& camera)
      : map_(map), yaw_(yaw_degrees * pi / 180.0), middle_(camera.target) {
    ahead_ = camera.target - camera.position;
    ahead_.y() = 0.0;
    ahead_.normalize();
  }

  void shine(const Vector3d& point, float* radiance) const {
    const Vector3d to = (point - middle_).normalized();
    const double ahead = to.dot(ahead_), right = to.z() * ahead_.x() - to.x() * ahead_.z();
    // Azimuth from ahead to the right, and on the map, which is turned to the right itself.
    const double azimuth = std::atan2(right, ahead) - yaw_;
    const double turns = azimuth / (2.0 * pi) + 0.5;
    const int x = static_cast<int>((turns - std::floor(turns)) * map_.width) % map_.width;
    const int y = std::min(static_cast<int>(std::acos(to.y()) / pi * map_.height), map_.height - 1);
    for (int c = 0; c < 3; ++c) radiance[c] = map_.at(x, y, c);
  }

 private:
  static constexpr double pi = std::numbers::pi;
  const Image& map_;
  double yaw_;
  Vector3d middle_, ahead_;
};

/// The scene before a fine window, traced once.
class Truth {
 public:
  explicit Truth(const Recipe& recipe) : scene_(recipe.scene) {
    constexpr int finer = 4;
    scene_.monitor.texels.width *= finer;
    scene_.monitor.texels.height *= finer;
    transport_ = trace_scene(scene_, TraceOptions::of_quality(3, recipe.seed)).transport;
  }

  Image in(const Image& map, double yaw_degrees) const {
    constexpr int samples = 4;
    const MonitorSurface screen(scene_.monitor);
    const Environment seen(map, yaw_degrees, scene_.camera);
    LightMap light{Image(scene_.monitor.texels.width, scene_.monitor.texels.height, 3),
                   Parameterisation::monitor};
    const auto at = [](int texel, int sample) {
      return static_cast<float>(texel + (sample + 0.5) / samples);
    };
    for (int y = 0; y < light.radiance.height; ++y)
      for (int x = 0; x < light.radiance.width; ++x)
        for (int s = 0; s < samples * samples; ++s) {
          float radiance[3];
          seen.shine(screen.point(at(x, s % samples), at(y, s / samples)).cast<double>(), radiance);
          for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) += radiance[c] / (samples * samples);
        }
    return transport_.relight(light);
  }

 private:
  SceneDescription scene_;
  ReflectanceField transport_;
};

class NewSurroundings : public testing::Test {
 protected:
  /// Runs the program, which must succeed, and returns what it printed.
  std::string run(std::vector<std::string> arguments) {
    const int status = test::run_program(std::move(arguments), path("log"));
    const std::string said = read_text(path("log"));
    EXPECT_EQ(status, 0) << said;
    return said;
  }
  std::string path(const char* name) const { return folder_ / name; }

  Image relit(const char* field, double yaw_degrees) {
    run({"relight", path(field), "--env", path("map.exr"), "--yaw", std::to_string(yaw_degrees), "-o",
         path("relit.exr")});
    return read_image(path("relit.exr"));
  }

  test::TemporaryFolder folder_;
};

TEST_F(NewSurroundings, AreWithinTheFieldsOwnHeldOutError) {
  std::ofstream(path("recipe.toml")) << recipe_text;
  run({"simulate", path("recipe.toml"), "-o", path("truth"), "--quality", "3"});
  run({"acquire", "run", path("recipe.toml"), "--truth", path("truth"), "-o", path("session")});
  run({"estimate", path("session"), "-o", path("scene.rfield")});
  const std::string said = run({"compare", path("scene.rfield"), path("session"), "--truth",
                                path("truth/transport.rfield"), "--json"});
  const auto held_out = nlohmann::json::parse(said.substr(said.find('{')))["held_out"];
  const double allowed = held_out["natural"]["relative_rmse"];

  const Truth truth(read_recipe(path("recipe.toml")));
  const Image map = make_panorama(77, 0, 512);
  write_exr(path("map.exr"), map);
  for (const double yaw : {50.0, 140.0, 230.0, 320.0}) {
    const Image expected = truth.in(map, yaw);
    const double of_projection = relative_rmse(relit("truth/transport.rfield", yaw), expected);
    const double of_all = relative_rmse(relit("scene.rfield", yaw), expected);
    std::printf("yaw %3.0f: error of the window %.4f, with the field's %.4f; held-out natural light %.4f\n",
                yaw, of_projection, of_all, allowed);
    EXPECT_LE(of_projection, 0.5 * allowed) << yaw;
    EXPECT_LE(of_all, allowed) << yaw;
  }
}

}  // namespace
}  // namespace refield
