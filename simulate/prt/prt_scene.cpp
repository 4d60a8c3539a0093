// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/prt_scene.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/config_file.h"
#include "core/base/number_text.h"
#include "core/field/transfer_tiles.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/geometry/scene_description.h"

namespace refield::prt {

namespace {

Material material_of(const MaterialDescription& description) {
  if (description.kind == MaterialDescription::Kind::ggx)
    return Material::ggx(description.colour, description.specular, static_cast<float>(description.roughness));
  return {description.colour, description.specular, static_cast<float>(description.exponent)};
}

/// `path`: of the scene, for its errors.
void append(const SceneObject& object, const fs::path& path, Scene& scene) {
  prt::append(object.mesh, Eigen::Isometry3f::Identity(), scene.mesh);
  const auto add = [&](const Material& material) {
    constexpr std::size_t max_materials = 65535;  // numbered in 16 bits
    if (scene.materials.size() == max_materials)
      throw InputError(path, ": the scene has more than ", max_materials,
                       " materials, one for each object and each roughness in its file; join some objects");
    scene.materials.push_back(material);
    return static_cast<std::uint16_t>(scene.materials.size() - 1);
  };
  if (object.lobes.empty()) {
    scene.material_of_vertex.resize(scene.mesh.positions.size(), add(material_of(object.material)));
    scene.specular_of_vertex.resize(scene.mesh.positions.size(), Eigen::Array3f::Ones());
    return;
  }
  std::map<float, std::uint16_t> of_roughness;
  for (const Eigen::Array4f& lobe : object.lobes) {
    const auto [found, is_new] = of_roughness.try_emplace(lobe[3]);
    if (is_new) {
      const bool diffuse = lobe[3] > max_roughness;
      found->second = add(diffuse ? Material{Eigen::Array3f::Ones()}
                                  : Material::ggx(Eigen::Array3f::Ones(), Eigen::Array3f::Ones(), lobe[3]));
    }
    scene.material_of_vertex.push_back(found->second);
    scene.specular_of_vertex.emplace_back(lobe.head<3>());
  }
}

Scene read_description(const fs::path& path, Gloss gloss, const RunContext& run) {
  const ConfigFile file(path, "scene", "docs/reference/scene-files.md");
  file.check_names({"camera", "material", "object"});
  const std::vector<MaterialDescription> materials = read_materials(file, SceneKind::precomputed);
  std::vector<ConfigSection> objects = file.sections("object");
  Scene scene;
  for (ConfigSection& section : objects) {
    const SceneObject object =
        read_scene_object(section, SceneKind::precomputed, materials, path.parent_path(), gloss, run);
    section.finish();
    append(object, path, scene);
    check_triangle_count(path, scene.mesh.triangles.size());
  }
  if (file.has("camera")) scene.camera = read_camera(file.section("camera")).pinhole();
  return scene;
}

}  // namespace

Scene read_scene(const fs::path& path, const RunContext& run, Gloss gloss) {
  if (lower_case(path.extension()) == ".toml") return read_description(path, gloss, run);
  Scene scene;
  MeshFile file = read_mesh_file(path, {.gloss = gloss}, run);
  SceneObject object{std::move(file.mesh), {}, std::move(file.lobes)};
  if (file.has_materials) object.material.colour = Rgb::Ones();
  append(object, path, scene);
  return scene;
}

std::vector<Eigen::Array3f> diffuse_reflectance(const Scene& scene) {
  std::vector<Eigen::Array3f> reflectance = scene.mesh.colours;
  for (std::size_t v = 0; v < reflectance.size(); ++v)
    reflectance[v] *= scene.materials[scene.material_of_vertex[v]].diffuse;
  return reflectance;
}

namespace {

using Feature = Eigen::Array<float, 6, 1>;

/// Places between which halves are cut: whole tiles as long as there are several, then whole groups.
std::size_t middle_of(std::size_t count) {
  const std::size_t unit = count > tile_pixels ? tile_pixels : group_pixels;
  return (count / 2 + unit - 1) / unit * unit;
}

/// Halves vertices along the feature that varies most, again and again, until groups are left: a k-d tree's
/// leaves in order (Bentley 1975).
void sort_by_features(std::span<std::uint32_t> order, const std::vector<Feature>& features) {
  if (order.size() <= group_pixels) {
    std::ranges::sort(order);
    return;
  }
  Feature low = features[order[0]], high = low;
  for (const std::uint32_t vertex : order) {
    low = low.min(features[vertex]);
    high = high.max(features[vertex]);
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const std::size_t middle = middle_of(order.size());
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(middle), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) {
                     const float of_a = features[a][axis], of_b = features[b][axis];
                     return of_a != of_b ? of_a < of_b : a < b;
                   });
  sort_by_features(order.first(middle), features);
  sort_by_features(order.subspan(middle), features);
}

template <class Value>
void reorder(std::vector<Value>& values, const std::vector<std::uint32_t>& order) {
  std::vector<Value> sorted;
  sorted.reserve(values.size());
  for (const std::uint32_t i : order) sorted.push_back(values[i]);
  values = std::move(sorted);
}

}  // namespace

void sort_vertices(Scene& scene) {
  Mesh& mesh = scene.mesh;
  const float scale = mesh.empty() ? 1.0f : 1.0f / std::max(bounds_of(mesh).sizes().maxCoeff(), 1e-30f);
  // How far apart in the scene two vertices are as unlike as two whose normals differ by one: measured on
  // scanned figures on a ground plane.
  constexpr float distance_of_a_normal = 0.1f;
  std::vector<Feature> features(mesh.positions.size());
  for (std::size_t v = 0; v < features.size(); ++v)
    features[v] << mesh.positions[v].array() * scale, mesh.normals[v].array() * distance_of_a_normal;

  std::vector<std::uint32_t> order(features.size()), place(features.size());
  std::iota(order.begin(), order.end(), 0u);
  sort_by_features(order, features);
  for (std::uint32_t i = 0; i < order.size(); ++i) place[order[i]] = i;
  reorder(mesh.positions, order);
  reorder(mesh.normals, order);
  reorder(mesh.colours, order);
  reorder(scene.material_of_vertex, order);
  if (!scene.specular_of_vertex.empty()) reorder(scene.specular_of_vertex, order);
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& vertex : triangle) vertex = place[vertex];
  std::ranges::sort(mesh.triangles);
}

namespace {

constexpr int samples = 4096;

/// Calls use(u, v) for points of the unit square (Roberts 2018).
template <class Use>
void for_samples(const Use& use) {
  constexpr double g = 1.32471795724474602596;
  for (int i = 0; i < samples; ++i) use(std::fmod((i + 0.5) / g, 1.0), std::fmod((i + 0.5) / (g * g), 1.0));
}

/// Reflectance of uniform light at f₀ = 1 less its Fresnel part, and that part, by half vectors of GGX's
/// distribution.
GgxGain::At reflected_by_ggx(double alpha, double cosine) {
  const double sine = std::sqrt(1.0 - cosine * cosine), squared = alpha * alpha;
  const auto shadow = [&](double c) { return std::sqrt(squared + (1.0 - squared) * c * c); };
  double scale = 0.0, offset = 0.0;
  for_samples([&](double u, double v) {
    const double half = std::sqrt((1.0 - u) / (1.0 + (squared - 1.0) * u));
    const double across = std::sqrt(1.0 - half * half) * std::cos(2.0 * std::numbers::pi * v);
    const double sight = sine * across + cosine * half;
    const double light = 2.0 * sight * half - cosine;
    if (sight <= 0.0 || light <= 0.0) return;
    const double smith = 2.0 * light * cosine / (cosine * shadow(light) + light * shadow(cosine));
    const double weight = smith * sight / (half * cosine), fresnel = std::pow(1.0 - sight, 5.0);
    scale += weight * (1.0 - fresnel);
    offset += weight * fresnel;
  });
  return {static_cast<float>(scale / samples), static_cast<float>(offset / samples)};
}

/// Reflected part of a Phong lobe of reflectance 1, by directions of its density.
double reflected_by_phong(double exponent, double cosine) {
  const double sine = std::sqrt(1.0 - cosine * cosine);
  double sum = 0.0;
  for_samples([&](double u, double v) {
    const double along = std::pow(1.0 - u, 1.0 / (exponent + 1.0));
    const double across =
        std::sqrt(std::max(0.0, 1.0 - along * along)) * std::cos(2.0 * std::numbers::pi * v);
    sum += std::max(0.0, along * cosine + across * sine);
  });
  return sum / samples * (exponent + 2.0) / (exponent + 1.0);
}

}  // namespace

float phong_exponent(float roughness) {
  const float alpha = roughness * roughness;
  return 0.375f * (1.0f / (alpha * alpha) - 1.0f);
}

GgxGain::GgxGain(float roughness) {
  const double alpha = static_cast<double>(roughness) * roughness, exponent = phong_exponent(roughness);
  for (std::size_t i = 0; i < places; ++i) {
    const double cosine = (static_cast<double>(i) + 0.5) / places;
    const At ggx = reflected_by_ggx(alpha, cosine);
    const auto phong = static_cast<float>(reflected_by_phong(exponent, cosine));
    table_[i] = {ggx.scale / phong, ggx.offset / phong};
  }
}

GgxGain::At GgxGain::operator()(float cosine) const {
  const float place = std::clamp(std::abs(cosine) * places - 0.5f, 0.0f, places - 1.0f);
  const auto i = std::min(static_cast<std::size_t>(place), places - 2);
  const float share = place - static_cast<float>(i);
  const auto between = [&](float At::*of) {
    return (1.0f - share) * table_[i].*of + share * table_[i + 1].*of;
  };
  return {between(&At::scale), between(&At::offset)};
}

}  // namespace refield::prt
