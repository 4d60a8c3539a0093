// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/recipe.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "core/base/files.h"

namespace refield {

namespace {

using Section = ConfigSection;

void read_colour(Section& section, const std::string& key, Rgb& value, double high) {
  std::array<double, 3> v{value[0], value[1], value[2]};
  section.triple(key, v, 0.0, high);
  value = Eigen::Array3d(v[0], v[1], v[2]).cast<float>();
}

/// From the left-handed axes of scene files to the scene's (scene.h).
void mirror(Eigen::Vector3d& position) {
  position.z() = 0.0 - position.z();
}

/// Rows whose first number is the share of the capture from which on the others hold, ascending.
std::vector<std::vector<double>> rows_by_share(Section& section, const std::string& key,
                                               const std::vector<std::string>& others) {
  if (!section.has(key)) return {};
  std::string form = "[share of the capture";
  for (const std::string& other : others) form += ", " + other;
  const std::string remedy = "give rows " + form + "], the shares ascending from 0 to 1";
  const auto rows = section.rows(key, 1 + others.size(), remedy.c_str());
  double last = 0.0;
  for (const auto& row : rows) {
    if (!(row[0] >= last && row[0] <= 1.0)) section.fail(key, remedy);
    last = row[0];
  }
  return rows;
}

SceneCamera read_mirrored_camera(Section section, Disturbances& disturbances) {
  for (const auto& row : rows_by_share(section, "moves", {"pixels to the right", "pixels down"}))
    disturbances.moves.push_back({row[0], row[1], row[2]});
  SceneCamera camera = read_camera(std::move(section));
  for (Eigen::Vector3d* vector : {&camera.position, &camera.target, &camera.up}) mirror(*vector);
  return camera;
}

void read_monitor(Section section, MonitorInScene& place, MonitorModel& model) {
  for (const char* key : {"width", "height", "position", "towards"}) section.require(key);
  section.integer("width", place.texels.width, 8, 8192);
  section.integer("height", place.texels.height, 8, 8192);
  Eigen::Vector3d towards;
  section.vector("position", place.centre);
  section.vector("towards", towards);
  place.facing = towards - place.centre;
  mirror(place.centre);
  mirror(place.facing);
  section.number("width_m", place.width_m, 1e-3, 100.0);
  section.number("height_m", place.height_m, 1e-3, 100.0);
  if (place.facing.cross(Eigen::Vector3d::UnitY()).norm() < 1e-9)
    section.fail("towards",
                 "the monitor must not lie flat; give a point that is not above or below its position");
  section.triple("gamma", model.gamma, 0.5, 5.0);
  if (section.has("stated_gamma"))
    section.triple("stated_gamma", model.stated_gamma.emplace(model.gamma), 0.5, 5.0);
  section.number("black_level", model.black_level, 0.0, 0.999);
  section.number("white_radiance", model.white_radiance, 1e-6, 1e5);
  section.number("falloff", model.falloff, 0.0, 0.9);
  section.number("dimming", model.dimming, 0.0, 0.9);
  section.number("pwm_hz", model.pwm_hz, 0.0, 1e6);
  if (model.pwm_hz > 0.0 && model.pwm_hz < 1.0) section.fail("pwm_hz", "give 0 or 1 to 1000000");
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
  for (const auto& [c, key] : {std::pair{0, "mixing_red"}, {1, "mixing_green"}, {2, "mixing_blue"}}) {
    section.triple(key, sensor.mixing[c], 0.0, 1.0);
    if (sensor.mixing[c][c] != 1.0 || std::ranges::count(sensor.mixing[c], 1.0) > 1)
      section.fail(key, "the channel's own primary must have the share 1, the others less");
  }
  section.flag("rounds_exposures", sensor.rounds_exposures);
  section.number("gain_jitter", sensor.gain_jitter, 0.0, 0.3);
  section.number("balance_jitter", sensor.balance_jitter, 0.0, 0.3);
  section.finish();
}

void read_exposures(Section section, ExposureSeries& exposures) {
  section.integer("count", exposures.count, 1, 16);
  section.number("ratio", exposures.ratio, 1.01, 64.0);
  section.integer("averaged_frames", exposures.frames, 1, 1000);
  section.integer("ambient_frames", exposures.ambient_frames, 0, 64);
  double longest = 0.0;
  section.number("longest_s", longest, 1e-6, 3600.0);
  if (section.has("longest_s")) exposures.longest = Seconds(longest);
  section.finish();
}

void read_lights(Section section, LightPlan& lights) {
  section.integer("train", lights.train, 1, 9999);
  section.choice<std::string>("kind", lights.kind, {{"natural", "natural"}, {"designed", "designed"}});
  section.integer("natural", lights.natural, 0, 9999);
  section.integer("coloured", lights.coloured, 0, 999);
  section.integer("bars", lights.bars, 0, 999);
  section.integer("squares", lights.squares, 0, 999);
  section.integer("white", lights.white, 0, 1);
  section.integer("black", lights.black, 0, 1);
  section.finish();
}

ObjectDescription read_mirrored_object(Section section, const std::vector<MaterialDescription>& materials) {
  ObjectDescription object = read_object(section, SceneKind::traced);
  object.material = read_material_of(section, materials).name;
  section.finish();
  if (object.place.position) object.place.position->z() = 0.0f - object.place.position->z();
  object.place.turn.yaw *= -1.0;
  object.place.turn.pitch *= -1.0;
  return object;
}

}  // namespace

Recipe read_recipe(const fs::path& path) {
  ConfigFile file(path, "recipe", "docs/reference/synthetic-scenes.md");
  Recipe recipe;
  recipe.base = file.add_base();
  file.check_names({"seed", "camera", "monitor", "ambient", "material", "object", "lights", "sensor",
                    "exposures", "reference"});

  recipe.path = path;
  file.whole_number("seed", recipe.seed);
  recipe.scene.camera = read_mirrored_camera(file.section("camera"), recipe.rig.disturbances);
  read_monitor(file.section("monitor"), recipe.scene.monitor, recipe.rig.monitor);
  Section ambient = file.optional_section("ambient");
  read_colour(ambient, "radiance", recipe.scene.ambient_radiance, 1e5);
  ambient.number("variation", recipe.rig.disturbances.room_variation, 0.0, 1.0);
  for (const auto& row : rows_by_share(ambient, "switched", {"factor"}))
    recipe.rig.disturbances.room_light.push_back({row[0], row[1]});
  ambient.finish();
  read_lights(file.optional_section("lights"), recipe.lights);
  read_sensor(file.optional_section("sensor"), recipe.rig.sensor);
  read_exposures(file.optional_section("exposures"), recipe.rig.exposures);
  Section reference = file.optional_section("reference");
  reference.integer("every", recipe.rig.reference_every, 0, 9999);
  reference.finish();
  recipe.scene.materials = read_materials(file, SceneKind::traced);
  for (Section section : file.sections("object"))
    recipe.scene.objects.push_back(read_mirrored_object(std::move(section), recipe.scene.materials));
  return recipe;
}

}  // namespace refield
