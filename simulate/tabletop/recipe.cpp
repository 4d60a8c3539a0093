// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/recipe.h"

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <set>

#include "core/base/config_file.h"
#include "core/base/errors.h"
#include "core/base/files.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

using Section = ConfigSection;

void read_colour(Section& section, const std::string& key, Rgb& value, double high) {
  std::array<double, 3> v{value[0], value[1], value[2]};
  section.triple(key, v, 0.0, high);
  value = Eigen::Array3d(v[0], v[1], v[2]).cast<float>();
}

void read_camera(Section section, CameraInScene& camera) {
  for (const char* key : {"width", "height", "position", "target"}) section.require(key);
  section.integer("width", camera.width, 1, 16384);
  section.integer("height", camera.height, 1, 16384);
  section.vector("position", camera.position);
  section.vector("target", camera.target);
  section.number("vertical_fov_degrees", camera.vertical_fov_degrees, 1.0, 150.0);
  if ((camera.target - camera.position).cross(Eigen::Vector3d::UnitY()).norm() < 1e-9)
    section.fail("target", "the camera must not look straight up, straight down or at itself");
  section.finish();
}

void read_monitor(Section section, MonitorInScene& place, MonitorModel& model) {
  for (const char* key : {"width", "height", "centre", "facing"}) section.require(key);
  section.integer("width", place.texels.width, 8, 8192);
  section.integer("height", place.texels.height, 8, 8192);
  section.vector("centre", place.centre);
  section.vector("facing", place.facing);
  section.number("width_m", place.width_m, 1e-3, 100.0);
  section.number("height_m", place.height_m, 1e-3, 100.0);
  if (place.facing.cross(Eigen::Vector3d::UnitY()).norm() < 1e-9)
    section.fail("facing", "the monitor must not lie flat; give a direction that is not vertical");
  section.triple("gamma", model.gamma, 0.5, 5.0);
  section.number("black_level", model.black_level, 0.0, 0.999);
  section.number("white_radiance", model.white_radiance, 1e-6, 1e5);
  section.number("falloff", model.falloff, 0.0, 0.9);
  section.number("dimming", model.dimming, 0.0, 0.9);
  section.number("pwm_hz", model.pwm_hz, 0.0, 1e6);
  section.number("pwm_depth", model.pwm_depth, 0.0, 1.0);
  section.triple("drift", model.drift, -0.9, 10.0);
  section.number("drift_settling", model.drift_settling, 0.0, 100.0);
  double refresh_hz = 1.0 / model.refresh_interval.count();
  section.number("refresh_hz", refresh_hz, 1.0, 10000.0);
  model.refresh_interval = Seconds(1.0 / refresh_hz);
  section.seconds("latency_ms", model.latency, Seconds(1e-3), 0.0, 1e4);
  section.seconds("settling_ms", model.settling, Seconds(1e-3), 0.0, 1e4);
  section.finish();
}

void read_sensor(Section section, SensorModel& sensor) {
  section.choice("layout", sensor.layout,
                 {{"rgb", PixelLayout::rgb},
                  {"grey", PixelLayout::grey},
                  {"bayer_rggb", PixelLayout::bayer_rggb},
                  {"bayer_grbg", PixelLayout::bayer_grbg},
                  {"bayer_gbrg", PixelLayout::bayer_gbrg},
                  {"bayer_bggr", PixelLayout::bayer_bggr}});
  section.integer("bits", sensor.bits, 8, 12);
  if (sensor.bits % 2 != 0) section.fail("bits", "use 8, 10 or 12");
  section.number("sensitivity", sensor.sensitivity, 1e-3, 1e12);
  section.number("electrons_per_dn", sensor.electrons_per_dn, 1e-6, 1e6);
  section.number("full_well_electrons", sensor.full_well_electrons, 1.0, 1e9);
  section.number("read_noise_electrons", sensor.read_noise_electrons, 0.0, 1e6);
  section.number("black_level_dn", sensor.black_level_dn, 0.0, sensor.full_scale() / 4.0);
  section.number("vignetting", sensor.vignetting, 0.0, 0.9);
  section.number("response_gamma", sensor.response_gamma, 0.5, 5.0);
  section.number("largest_gain", sensor.largest_gain, 1.0, 1e4);
  section.seconds("longest_exposure_s", sensor.longest_exposure, Seconds(1.0), 1e-6, 3600.0);
  section.seconds("shortest_exposure_s", sensor.shortest_exposure, Seconds(1.0), 1e-6,
                  sensor.longest_exposure.count());
  section.seconds("frame_interval_ms", sensor.frame_interval, Seconds(1e-3), 0.01, 1e6);
  section.integer("control_latency_frames", sensor.control_latency_frames, 0, 64);
  section.integer("latency_frames", sensor.latency_frames, 0, 64);
  section.finish();
}

void read_exposures(Section section, ExposureSeries& exposures) {
  section.integer("count", exposures.count, 1, 16);
  section.number("ratio", exposures.ratio, 1.01, 64.0);
  section.integer("frames", exposures.frames, 1, 1000);
  double longest = 0.0;
  section.number("longest_s", longest, 1e-6, 3600.0);
  if (section.has("longest_s")) exposures.longest = Seconds(longest);
  section.finish();
}

void read_lights(Section section, LightPlan& lights) {
  section.integer("train", lights.train, 1, 9999);
  section.integer("natural", lights.natural, 0, 9999);
  section.integer("bars", lights.bars, 0, 999);
  section.integer("squares", lights.squares, 0, 999);
  section.integer("white", lights.white, 0, 1);
  section.integer("black", lights.black, 0, 1);
  section.finish();
}

MaterialDescription read_material(Section section) {
  using Kind = MaterialDescription::Kind;
  using TextureKind = TextureDescription::Kind;
  MaterialDescription material;
  for (const char* key : {"name", "kind"}) section.require(key);
  section.text("name", material.name);
  section.choice("kind", material.kind,
                 {{"diffuse", Kind::diffuse},
                  {"glossy", Kind::glossy},
                  {"metal", Kind::metal},
                  {"mirror", Kind::mirror},
                  {"glass", Kind::glass},
                  {"translucent", Kind::translucent}});
  if (material.kind == Kind::glass) material.colour = Rgb::Ones();
  read_colour(section, "colour", material.colour, 1.0);
  section.choice("texture", material.texture.kind,
                 {{"plain", TextureKind::plain},
                  {"checker", TextureKind::checker},
                  {"noise", TextureKind::noise},
                  {"wood", TextureKind::wood}});
  read_colour(section, "second_colour", material.texture.second_colour, 1.0);
  section.number("scale_m", material.texture.scale_m, 1e-4, 100.0);
  section.number("roughness", material.roughness, 0.2, 1.0);
  section.number("index_of_refraction", material.index_of_refraction, 1.01, 4.0);
  section.number("transmission", material.transmission, 0.0, 1.0);
  section.finish();
  return material;
}

ObjectDescription read_object(Section section, const std::vector<MaterialDescription>& materials) {
  using Kind = ObjectDescription::Kind;
  ObjectDescription object;
  for (const char* key : {"shape", "material"}) section.require(key);
  section.text("name", object.name);
  section.choice(
      "shape", object.kind,
      {{"quad", Kind::quad}, {"box", Kind::box}, {"sphere", Kind::sphere}, {"lathe", Kind::lathe}});
  section.text("material", object.material);
  std::string names;
  bool found = false;
  for (const MaterialDescription& material : materials) {
    found = found || material.name == object.material;
    names += (names.empty() ? "" : ", ") + material.name;
  }
  if (!found) section.fail("material", "there is no [[material]] of this name; there are " + names);
  section.vector("position", object.position);
  section.vector("size", object.size, 1e-6, 1e4);
  section.vector("rotation_degrees", object.rotation_degrees, -360.0, 360.0);
  section.number("radius", object.radius, 1e-6, 1e4);
  section.pairs("profile", object.profile);
  section.flag("smooth", object.smooth);
  if (object.kind == Kind::lathe) section.require("profile");
  section.finish();
  return object;
}

}  // namespace

Recipe read_recipe(const fs::path& path) {
  const ConfigFile file(path, "recipe", "docs/reference/synthetic-scenes.md");
  file.check_names({"seed", "camera", "monitor", "ambient", "material", "object", "lights", "sensor",
                    "exposures", "reference"});

  Recipe recipe;
  recipe.path = path;
  file.whole_number("seed", recipe.seed);
  read_camera(file.section("camera"), recipe.scene.camera);
  read_monitor(file.section("monitor"), recipe.scene.monitor, recipe.rig.monitor);
  Section ambient = file.optional_section("ambient");
  read_colour(ambient, "radiance", recipe.scene.ambient_radiance, 1e5);
  ambient.finish();
  read_lights(file.optional_section("lights"), recipe.lights);
  read_sensor(file.optional_section("sensor"), recipe.rig.sensor);
  read_exposures(file.optional_section("exposures"), recipe.rig.exposures);
  Section reference = file.optional_section("reference");
  reference.integer("every", recipe.rig.reference_every, 0, 9999);
  reference.finish();
  for (Section section : file.sections("material"))
    recipe.scene.materials.push_back(read_material(std::move(section)));
  for (Section section : file.sections("object"))
    recipe.scene.objects.push_back(read_object(std::move(section), recipe.scene.materials));
  return recipe;
}

}  // namespace refield
