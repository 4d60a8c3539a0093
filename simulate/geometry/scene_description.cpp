// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/scene_description.h"

#include <algorithm>

#include "core/base/config_file.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_shapes.h"

namespace refield {

namespace {

/// Lengths in files that people write are within this.
constexpr double farthest = 1e6;

std::array<double, 3> read_triple(ConfigSection& section, const char* key, double low, double high,
                                  std::array<double, 3> value = {}) {
  section.triple(key, value, low, high);
  return value;
}

float read_number(ConfigSection& section, const char* key, float standard, double low, double high) {
  double value = standard;
  section.number(key, value, low, high);
  return static_cast<float>(value);
}

}  // namespace

Eigen::Vector3f read_vector(ConfigSection& section, const char* key, const Eigen::Vector3f& standard,
                            double low, double high) {
  const auto value = read_triple(section, key, low, high, {standard.x(), standard.y(), standard.z()});
  return Eigen::Vector3d(value[0], value[1], value[2]).cast<float>();
}

PinholeCamera SceneCamera::pinhole() const {
  return {.position = position.cast<float>(),
          .target = target.cast<float>(),
          .up = up.cast<float>(),
          .vertical_field_of_view_degrees = static_cast<float>(vertical_fov_degrees),
          .width = width,
          .height = height};
}

SceneCamera read_camera(ConfigSection section) {
  SceneCamera camera;
  for (const char* key : {"position", "target"}) section.require(key);
  section.vector("position", camera.position);
  section.vector("target", camera.target);
  section.vector("up", camera.up, -1.0, 1.0);
  section.number("vertical_fov_degrees", camera.vertical_fov_degrees, 1.0, 150.0);
  section.integer("width", camera.width, 1, 16384);
  section.integer("height", camera.height, 1, 16384);
  section.finish();
  try {
    camera.pinhole().check();
  } catch (const InputError& error) {
    section.fail("target", error.what());
  }
  return camera;
}

namespace {

using MaterialKind = MaterialDescription::Kind;

constexpr unsigned scene_bit(SceneKind scene) {
  return 1u << static_cast<unsigned>(scene);
}
constexpr unsigned kind_bit(MaterialKind kind) {
  return 1u << static_cast<unsigned>(kind);
}

struct KindUse {
  const char* name;
  MaterialKind kind;
  unsigned scenes;
};
constexpr std::array kind_uses{
    KindUse{"diffuse", MaterialKind::diffuse,
            scene_bit(SceneKind::traced) | scene_bit(SceneKind::precomputed) | scene_bit(SceneKind::dynamic)},
    KindUse{"phong", MaterialKind::phong, scene_bit(SceneKind::precomputed) | scene_bit(SceneKind::dynamic)},
    KindUse{"ggx", MaterialKind::ggx, scene_bit(SceneKind::precomputed) | scene_bit(SceneKind::dynamic)},
    KindUse{"glossy", MaterialKind::glossy, scene_bit(SceneKind::traced)},
    KindUse{"metal", MaterialKind::metal, scene_bit(SceneKind::traced)},
    KindUse{"mirror", MaterialKind::mirror, scene_bit(SceneKind::traced)},
    KindUse{"glass", MaterialKind::glass, scene_bit(SceneKind::traced)},
    KindUse{"translucent", MaterialKind::translucent, scene_bit(SceneKind::traced)}};

struct KeyUse {
  const char* name;
  unsigned kinds;
};
constexpr std::array key_uses{
    KeyUse{"diffuse", kind_bit(MaterialKind::diffuse) | kind_bit(MaterialKind::phong) |
                          kind_bit(MaterialKind::ggx) | kind_bit(MaterialKind::glossy) |
                          kind_bit(MaterialKind::translucent)},
    KeyUse{"specular", kind_bit(MaterialKind::phong) | kind_bit(MaterialKind::ggx) |
                           kind_bit(MaterialKind::metal) | kind_bit(MaterialKind::mirror)},
    KeyUse{"transmittance", kind_bit(MaterialKind::glass)},
    KeyUse{"exponent", kind_bit(MaterialKind::phong)},
    KeyUse{"roughness",
           kind_bit(MaterialKind::ggx) | kind_bit(MaterialKind::glossy) | kind_bit(MaterialKind::metal)},
    KeyUse{"index_of_refraction", kind_bit(MaterialKind::glossy) | kind_bit(MaterialKind::glass)},
    KeyUse{"transmission", kind_bit(MaterialKind::translucent)}};

/// "diffuse, phong": the kinds of a scene that are among `kinds`.
std::string names_of(SceneKind scene, unsigned kinds) {
  std::string names;
  for (const KindUse& use : kind_uses)
    if ((use.scenes & scene_bit(scene)) != 0 && (kind_bit(use.kind) & kinds) != 0)
      names += (names.empty() ? "" : ", ") + std::string(use.name);
  return names;
}

MaterialKind read_kind(ConfigSection& section, SceneKind scene) {
  std::string name = "diffuse";
  section.text("kind", name);
  const auto found = std::ranges::find(kind_uses, name, &KindUse::name);
  if (found == kind_uses.end() || (found->scenes & scene_bit(scene)) == 0)
    section.fail("kind", "scenes of this type support " + names_of(scene, ~0u));
  for (const KeyUse& key : key_uses)
    if (section.has(key.name) && (key.kinds & kind_bit(found->kind)) == 0) {
      const std::string users = names_of(scene, key.kinds);
      section.fail(key.name, "materials of kind '" + name + "' do not use it; " +
                                 (users.empty() ? "leave it out" : "the following kinds do: " + users));
    }
  return found->kind;
}

Rgb read_colour(ConfigSection& section, const char* key, const Rgb& standard) {
  return read_vector(section, key, standard.matrix(), 0.0, 1.0).array();
}

/// The lobe that phong and ggx have beside the diffuse one.
void read_lobe(ConfigSection& section, MaterialDescription& material) {
  section.require("specular");
  material.specular = read_colour(section, "specular", Rgb::Ones());
  if ((material.specular == 0.0f).all())
    section.fail("specular", "is zero; give a reflectance above zero, or kind = \"diffuse\"");
  if (material.kind == MaterialKind::phong) {
    section.require("exponent");
    section.number("exponent", material.exponent, 1.0, 1e5);
    if ((material.colour + material.specular > 1.0f).any())
      section.fail("specular", "with `diffuse` it must not add up to more than 1");
  } else {
    section.require("roughness");
    section.number("roughness", material.roughness, 0.1, 1.0);
  }
}

void read_texture(ConfigSection& section, TextureDescription& texture) {
  section.choice("texture", texture.kind,
                 {{"plain", TextureDescription::Kind::plain},
                  {"checker", TextureDescription::Kind::checker},
                  {"noise", TextureDescription::Kind::noise},
                  {"wood", TextureDescription::Kind::wood}});
  texture.second_colour = read_colour(section, "second_colour", texture.second_colour);
  section.number("scale_m", texture.scale_m, 1e-4, 100.0);
}

MaterialDescription read_material(ConfigSection section, SceneKind scene) {
  MaterialDescription material;
  section.require("name");
  section.text("name", material.name);
  const MaterialKind kind = material.kind = read_kind(section, scene);
  if (kind == MaterialKind::glass) material.colour.setOnes();
  const char* colour_key = kind == MaterialKind::metal || kind == MaterialKind::mirror ? "specular"
                           : kind == MaterialKind::glass                               ? "transmittance"
                                                                                       : "diffuse";
  material.colour = read_colour(section, colour_key, material.colour);
  if (kind == MaterialKind::phong || kind == MaterialKind::ggx) read_lobe(section, material);
  if (kind == MaterialKind::glossy || kind == MaterialKind::metal)
    section.number("roughness", material.roughness, 0.2, 1.0);
  if (kind == MaterialKind::glossy || kind == MaterialKind::glass)
    section.number("index_of_refraction", material.index_of_refraction, 1.01, 4.0);
  if (kind == MaterialKind::translucent) section.number("transmission", material.transmission, 0.0, 1.0);
  if (scene == SceneKind::traced) read_texture(section, material.texture);
  section.finish();
  return material;
}

}  // namespace

std::vector<MaterialDescription> read_materials(const ConfigFile& file, SceneKind scene) {
  std::vector<MaterialDescription> materials;
  if (!file.has("material")) return materials;
  for (const ConfigSection& section : file.sections("material")) {
    const MaterialDescription material = read_material(section, scene);
    if (std::ranges::find(materials, material.name, &MaterialDescription::name) != materials.end())
      section.fail("name", "there is another [[material]] of this name; give each its own");
    materials.push_back(material);
  }
  return materials;
}

MaterialDescription read_material_of(ConfigSection& section, std::span<const MaterialDescription> materials) {
  for (const KeyUse& key : key_uses)
    if (section.has(key.name))
      section.fail(key.name, "it is a key of [[material]]; name such a material by the key `material`");
  std::string name;
  section.text("material", name);
  if (name.empty()) return {};
  const auto found = std::ranges::find(materials, name, &MaterialDescription::name);
  if (found != materials.end()) return *found;
  std::string names;
  for (const MaterialDescription& material : materials)
    names += (names.empty() ? "; there are " : ", ") + material.name;
  section.fail("material", "there is no [[material]] of this name" + names);
}

namespace {

void read_placement(ConfigSection& section, prt::Placement& placement) {
  placement.stretch = read_vector(section, "stretch", placement.stretch, 1e-6, farthest);
  const auto turn = read_triple(section, "rotation", -360.0, 360.0);
  placement.turn = {turn[0], turn[1], turn[2]};
  const auto size = read_number(section, "size", 1.0f, 1e-6, farthest);
  if (section.has("size")) placement.size = size;
  if (section.has("position")) placement.position = read_vector(section, "position", {0, 0, 0});
  section.flag("on_ground", placement.on_ground);
}

}  // namespace

ObjectDescription read_object(ConfigSection& section, SceneKind scene) {
  using Shape = ObjectDescription::Shape;
  const bool traced = scene == SceneKind::traced;
  ObjectDescription object;
  section.text("name", object.name);
  if (!traced && section.has("file") == section.has("shape"))
    section.fail("shape", "give either `shape` or `file`");
  if (!traced && section.has("file")) {
    object.shape = Shape::file;
    std::string name;
    section.text("file", name);
    object.file = name;
    section.choice<std::optional<prt::ColourCoding>>(
        "colours", object.colours,
        {{"srgb", prt::ColourCoding::srgb}, {"linear", prt::ColourCoding::linear}});
  } else if (traced) {
    section.require("shape");
    section.choice(
        "shape", object.shape,
        {{"plane", Shape::plane}, {"box", Shape::box}, {"sphere", Shape::sphere}, {"lathe", Shape::lathe}});
    if (object.shape == Shape::sphere && section.has("stretch"))
      section.fail("stretch", "a ray-traced sphere remains round; give its diameter as `size`");
  } else {
    section.choice("shape", object.shape,
                   {{"plane", Shape::plane},
                    {"box", Shape::box},
                    {"sphere", Shape::sphere},
                    {"lathe", Shape::lathe},
                    {"rabbit", Shape::rabbit}});
    if (object.shape != Shape::lathe)  // a few million vertices at most
      section.integer("resolution", object.resolution, 1, object.shape == Shape::plane ? 2048 : 512);
  }
  if (object.shape == Shape::lathe) {
    section.require("profile");
    section.pairs("profile", object.profile);
    section.flag("smooth", object.smooth);
    object.place.keeps_origin = true;
  }
  read_placement(section, object.place);
  return object;
}

Mesh shape_mesh(const ObjectDescription& object) {
  using Shape = ObjectDescription::Shape;
  const auto resolution = [&](int standard) { return object.resolution > 0 ? object.resolution : standard; };
  switch (object.shape) {
    case Shape::plane:
      return prt::plane_mesh(resolution(1));
    case Shape::box:
      return prt::box_mesh(resolution(1));
    case Shape::sphere:
      return prt::sphere_mesh(resolution(32));
    case Shape::lathe:
      return prt::lathe_mesh(object.profile, object.smooth);
    case Shape::rabbit:
      return prt::rabbit_mesh(resolution(32));
    case Shape::file:
      break;
  }
  throw InputError("object '", object.name, "': its shape is in a file; read that");
}

namespace {

/// `options` without the coding, which the section has.
prt::MeshFile read_shape(ConfigSection& section, SceneKind scene, prt::MeshFileOptions options,
                         const fs::path& folder, const RunContext& run) {
  const ObjectDescription object = read_object(section, scene);
  prt::MeshFile file;
  options.coding = object.colours;
  if (object.shape == ObjectDescription::Shape::file)
    file = prt::read_mesh_file(folder / object.file, options, run);
  else
    file.mesh = shape_mesh(object);
  Mesh& mesh = file.mesh;
  if (mesh.triangles.empty())
    section.fail("profile", "encloses no surface; give points with a radius above zero");
  prt::place(mesh, object.place);
  if (section.has("refine")) {
    const float longest_edge = read_number(section, "refine", 1.0f, 1e-6, farthest);
    try {
      prt::refine(mesh, longest_edge, &file.lobes);
    } catch (const InputError& error) {
      section.fail("refine", error.what());
    }
  }
  return file;
}

}  // namespace

Mesh read_mesh(ConfigSection& section, SceneKind scene, const fs::path& folder, const RunContext& run) {
  return read_shape(section, scene, {.materials = false}, folder, run).mesh;
}

SceneObject read_scene_object(ConfigSection& section, SceneKind scene,
                              std::span<const MaterialDescription> materials, const fs::path& folder,
                              prt::Gloss gloss, const RunContext& run) {
  MaterialDescription material = read_material_of(section, materials);
  prt::MeshFile file =
      read_shape(section, scene, {.materials = material.name.empty(), .gloss = gloss}, folder, run);
  if (file.has_materials) material.colour = Rgb::Ones();
  return {std::move(file.mesh), std::move(material), std::move(file.lobes)};
}

void check_triangle_count(const fs::path& scene, std::size_t triangles) {
  if (triangles > prt::max_triangles)
    throw InputError(scene, ": the scene has more than ", prt::max_triangles,
                     " triangles; simplify its meshes or refine them less");
}

namespace {

/// Keyframes of a time and three numbers.
std::vector<std::vector<double>> read_keyframes(ConfigSection& section, const char* key, const char* values) {
  const std::string remedy =
      std::string("give keyframes [seconds, ") + values + "] with ascending times from 0 or later";
  auto rows = section.rows(key, 4, remedy.c_str());
  if (rows.empty()) section.fail(key, remedy);
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i][0] < 0.0 || (i > 0 && rows[i][0] <= rows[i - 1][0])) section.fail(key, remedy);
  return rows;
}

/// The keyframes around a time, and how far it is from one to the other; both the same at the ends.
template <class Keyframe>
struct Interval {
  const Keyframe *before, *after;
  double share;
};
template <class Keyframe>
Interval<Keyframe> interval_at(const std::vector<Keyframe>& frames, double time) {
  const auto next = std::ranges::find_if(frames, [time](const Keyframe& frame) { return frame.time > time; });
  if (next == frames.begin()) return {&frames.front(), &frames.front(), 0.0};
  if (next == frames.end()) return {&frames.back(), &frames.back(), 0.0};
  const Keyframe& last = *(next - 1);
  return {&last, &*next, (time - last.time) / (next->time - last.time)};
}

}  // namespace

Motion read_motion(ConfigSection& section, const Eigen::Vector3f& position, bool with_turns) {
  Motion motion;
  if (section.has("path"))
    for (const auto& row : read_keyframes(section, "path", "x, y, z"))
      motion.path.push_back({row[0], Eigen::Vector3d(row[1], row[2], row[3]).cast<float>()});
  else
    motion.path = {{0.0, position}};
  if (with_turns && section.has("turns"))
    for (const auto& row : read_keyframes(section, "turns", "yaw, pitch, roll"))
      motion.turns.push_back({row[0], {.yaw = row[1], .pitch = row[2], .roll = row[3]}});
  return motion;
}

Eigen::Vector3f Motion::position(double time) const {
  const auto [before, after, share] = interval_at(path, time);
  return before->position + static_cast<float>(share) * (after->position - before->position);
}

Eigen::Isometry3f Motion::at(double time) const {
  Eigen::Isometry3f pose = Eigen::Isometry3f::Identity();
  pose.translation() = position(time);
  if (turns.empty()) return pose;
  const auto [before, after, share] = interval_at(turns, time);
  const EulerAngles &a = before->turn, &b = after->turn;
  const EulerAngles turn = {.yaw = a.yaw + share * (b.yaw - a.yaw),
                            .pitch = a.pitch + share * (b.pitch - a.pitch),
                            .roll = a.roll + share * (b.roll - a.roll)};
  pose.linear() = rotation_of(turn).cast<float>();
  return pose;
}

double Motion::duration() const {
  return std::max(path.back().time, turns.empty() ? 0.0 : turns.back().time);
}

}  // namespace refield
