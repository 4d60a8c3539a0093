// SPDX-License-Identifier: Apache-2.0
#include "simulate/recipe.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>

#include "core/errors.h"
#include "core/files.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr double unlimited = std::numeric_limits<double>::max();

std::string text_of(const toml::node& node) {
  std::ostringstream text;
  node.visit([&](const auto& value) { text << value; });
  return text.str();
}

// One table of the recipe. Remembers which keys were asked for: the others are errors.
class Section {
 public:
  Section(const fs::path& file, std::string name, const toml::table& table)
      : file_(file), name_(std::move(name)), table_(table) {}

  /// "recipe.toml:12: [camera] width = -3: what"
  [[noreturn]] void fail(const std::string& key, const std::string& what) const {
    const toml::node* node = table_.get(key);
    const auto line = node ? node->source().begin.line : table_.source().begin.line;
    throw InputError(file_.string() + ":" + std::to_string(line) + ": [" + name_ + "] " + key +
                     (node ? " = " + text_of(*node) : std::string()) + ": " + what);
  }

  bool has(const std::string& key) const { return table_.contains(key); }

  void number(const std::string& key, double& value, double low, double high) {
    if (const toml::node* node = known(key)) {
      const auto read = node->value<double>();
      if (!read || !(*read >= low && *read <= high)) fail(key, "give a number " + range_text(low, high));
      value = *read;
    }
  }
  void integer(const std::string& key, int& value, int low, int high) {
    if (const toml::node* node = known(key)) {
      const auto read = node->value_exact<std::int64_t>();
      if (!read || *read < low || *read > high) fail(key, "give a whole number " + range_text(low, high));
      value = static_cast<int>(*read);
    }
  }
  void flag(const std::string& key, bool& value) {
    if (const toml::node* node = known(key)) {
      const auto read = node->value_exact<bool>();
      if (!read) fail(key, "give true or false");
      value = *read;
    }
  }
  void text(const std::string& key, std::string& value) {
    if (const toml::node* node = known(key)) {
      const auto read = node->value_exact<std::string>();
      if (!read || read->empty()) fail(key, "give a text in quotes");
      value = *read;
    }
  }
  template <class Value>
  void choice(const std::string& key, Value& value,
              std::initializer_list<std::pair<const char*, Value>> choices) {
    if (!known(key)) return;
    std::string name, names;
    text(key, name);
    for (const auto& [choice_name, choice_value] : choices) {
      if (name == choice_name) {
        value = choice_value;
        return;
      }
      names += (names.empty() ? "" : ", ") + std::string(choice_name);
    }
    fail(key, "use one of " + names);
  }
  /// Three numbers.
  void triple(const std::string& key, std::array<double, 3>& value, double low, double high) {
    if (const toml::node* node = known(key)) {
      const toml::array* array = node->as_array();
      bool good = array && array->size() == 3;
      for (std::size_t i = 0; good && i < 3; ++i) {
        const auto read = array->get(i)->value<double>();
        good = read && *read >= low && *read <= high;
        if (good) value[i] = *read;
      }
      if (!good) fail(key, "give three numbers " + range_text(low, high) + ", for example [0.1, 0.2, 0.3]");
    }
  }
  void vector(const std::string& key, Eigen::Vector3d& value, double low = -1e6, double high = 1e6) {
    std::array<double, 3> v{value.x(), value.y(), value.z()};
    triple(key, v, low, high);
    value = {v[0], v[1], v[2]};
  }
  void colour(const std::string& key, Rgb& value, double high) {
    std::array<double, 3> v{value[0], value[1], value[2]};
    triple(key, v, 0.0, high);
    value = Eigen::Array3d(v[0], v[1], v[2]).cast<float>();
  }
  /// Pairs of numbers, at least two.
  void pairs(const std::string& key, std::vector<Eigen::Vector2d>& value) {
    const toml::node* node = known(key);
    if (!node) return;
    const toml::array* array = node->as_array();
    const char* remedy =
        "give at least two pairs [radius, height] with radius ≥ 0, from one end to the other";
    if (!array || array->size() < 2) fail(key, remedy);
    value.clear();
    for (const toml::node& element : *array) {
      const toml::array* pair = element.as_array();
      const auto r = pair && pair->size() == 2 ? pair->get(0)->value<double>() : std::nullopt;
      const auto h = pair && pair->size() == 2 ? pair->get(1)->value<double>() : std::nullopt;
      if (!r || !h || !(*r >= 0.0 && *r <= 1e6) || !(std::abs(*h) <= 1e6)) fail(key, remedy);
      value.emplace_back(*r, *h);
    }
  }
  void require(const std::string& key) const {
    if (!has(key)) fail(key, "is missing; add it");
  }
  /// Seconds from a number in units of `unit`.
  void seconds(const std::string& key, Seconds& value, Seconds unit, double low, double high) {
    double number_of_units = value / unit;
    if (!known(key)) return;
    number(key, number_of_units, low, high);
    value = number_of_units * unit;
  }
  void finish() const {
    for (const auto& [key, node] : table_)
      if (!known_.contains(std::string(key.str()))) {
        std::string names;
        for (const std::string& name : known_) names += (names.empty() ? "" : ", ") + name;
        fail(std::string(key.str()), "is not known here; known are " + names);
      }
  }

 private:
  static std::string range_text(double low, double high) {
    std::ostringstream text;
    if (high < unlimited && high < 1e6)
      text << "from " << low << " to " << high;
    else if (low > -1e6)
      text << "of at least " << low;
    else
      text << "of finite size";
    return text.str();
  }
  const toml::node* known(const std::string& key) {
    known_.insert(key);
    return table_.get(key);
  }

  const fs::path& file_;
  std::string name_;
  const toml::table& table_;
  std::set<std::string> known_;
};

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
  using Pattern = TextureDescription::Kind;
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
  section.colour("colour", material.colour, 1.0);
  section.choice("texture", material.texture.kind,
                 {{"plain", Pattern::plain},
                  {"checker", Pattern::checker},
                  {"noise", Pattern::noise},
                  {"wood", Pattern::wood}});
  section.colour("second_colour", material.texture.second_colour, 1.0);
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

const toml::table& table_at(const toml::table& root, const char* name, const fs::path& path) {
  if (const toml::table* table = root[name].as_table()) return *table;
  throw InputError(path.string() + ": lacks the table [" + name +
                   "]; docs/synthetic-scenes.md describes a recipe");
}

template <class Read>
void for_each_table(const toml::table& root, const char* name, const fs::path& path, Read read) {
  const toml::array* array = root[name].as_array();
  if (!array || array->empty() || !array->is_array_of_tables())
    throw InputError(path.string() + ": lacks any [[" + name +
                     "]]; docs/synthetic-scenes.md describes a recipe");
  for (const toml::node& node : *array) read(Section(path, name, *node.as_table()));
}

}  // namespace

Recipe read_recipe(const fs::path& path) {
  if (!fs::is_regular_file(path))
    throw InputError(path.string() + ": there is no such recipe; give a TOML file such as " +
                     "datasets_synthetic/tabletop/recipe.toml");
  toml::table root;
  try {
    root = toml::parse(read_text(path), path.string());
  } catch (const toml::parse_error& error) {
    throw InputError(path.string() + ":" + std::to_string(error.source().begin.line) +
                     ": is no valid TOML: " + std::string(error.description()));
  }
  static const std::set<std::string_view> known{"seed",   "camera", "monitor", "ambient",   "material",
                                                "object", "lights", "sensor",  "exposures", "reference"};
  for (const auto& [key, node] : root)
    if (!known.contains(key.str()))
      throw InputError(path.string() + ":" + std::to_string(node.source().begin.line) + ": '" +
                       std::string(key.str()) +
                       "' is not known; known are seed, [camera], [monitor], [ambient], " +
                       "[[material]], [[object]], [lights], [sensor], [exposures] and [reference]");

  Recipe recipe;
  recipe.path = path;
  if (const toml::node* seed = root.get("seed")) {
    const auto value = seed->value_exact<std::int64_t>();
    if (!value || *value < 0)
      throw InputError(path.string() + ":" + std::to_string(seed->source().begin.line) +
                       ": seed = " + text_of(*seed) + ": give a whole number of at least 0");
    recipe.seed = static_cast<std::uint64_t>(*value);
  }
  const toml::table none;
  const auto optional_table = [&](const char* name) -> const toml::table& {
    return root.contains(name) ? table_at(root, name, path) : none;
  };
  read_camera({path, "camera", table_at(root, "camera", path)}, recipe.scene.camera);
  read_monitor({path, "monitor", table_at(root, "monitor", path)}, recipe.scene.monitor, recipe.rig.monitor);
  Section ambient(path, "ambient", optional_table("ambient"));
  ambient.colour("radiance", recipe.scene.ambient_radiance, 1e5);
  ambient.finish();
  read_lights({path, "lights", optional_table("lights")}, recipe.lights);
  read_sensor({path, "sensor", optional_table("sensor")}, recipe.rig.sensor);
  read_exposures({path, "exposures", optional_table("exposures")}, recipe.rig.exposures);
  Section reference(path, "reference", optional_table("reference"));
  reference.integer("every", recipe.rig.reference_every, 0, 9999);
  reference.finish();
  for_each_table(root, "material", path, [&](Section section) {
    recipe.scene.materials.push_back(read_material(std::move(section)));
  });
  for_each_table(root, "object", path, [&](Section section) {
    recipe.scene.objects.push_back(read_object(std::move(section), recipe.scene.materials));
  });
  return recipe;
}

}  // namespace refield
