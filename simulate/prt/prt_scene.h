// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/geometry/mesh_file.h"

namespace refield::prt {

/// The exponent of Phong's lobe around the mirror direction that stands for a GGX lobe of α = roughness²:
/// n = 3/8 (1/α² − 1). A lobe of Blinn's half vectors is as wide with n_b = 2/α² − 2 (Walter et al. 2007,
/// section 5.2), and the angle from the mirror direction is twice that between half vector and normal, so
/// that n = n_b/4 (Fisher and Woo 1994); three quarters of it have the least error with GgxGain, under light
/// as smooth as exp(4 cos), for roughness .3 to .7. `roughness` above 0, to 1.
float phong_exponent(float roughness);

/// What GGX reflects of uniform light at an angle over what the Phong lobe does that stands for it. Phong's
/// loses its cosine towards grazing angles, GGX (Smith's height-correlated shadowing, Schlick's Fresnel
/// reflection) nearly nothing: reflectance at normal incidence f₀ is reflected as f₀ · scale + offset of the
/// lobe (the two terms of Karis 2013).
class GgxGain {
 public:
  explicit GgxGain(float roughness);

  struct At {
    float scale, offset;

    /// Metals have no diffuse part; their Fresnel reflection keeps their colour.
    Eigen::Array3f operator()(const Eigen::Array3f& specular, bool metal) const {
      if (metal) return specular * (scale + offset);
      return specular * scale + (specular > 0.0f).select(Eigen::Array3f::Constant(offset), 0.0f);
    }
  };
  /// `cosine` of the line of sight to the normal; that of below the horizon is taken without its sign.
  At operator()(float cosine) const;

 private:
  static constexpr std::size_t places = 32;
  std::array<At, places> table_;  // at the middles of equal parts of the cosine
};

/// How a surface reflects: f(ω, ω_o) = diffuse/π + specular · (n + 2)/2π · max(r · ω_o, 0)ⁿ, with r the
/// mirror direction of ω and n the exponent (Phong 1975, normalised as by Lafortune and Willems 1994).
struct Material {
  Eigen::Array3f diffuse = {0.8f, 0.8f, 0.8f};   ///< reflectance, linear RGB; times the vertex' colour
  Eigen::Array3f specular = {0.0f, 0.0f, 0.0f};  ///< reflectance at normal incidence
  float exponent = 0.0f;
  float roughness = 0.0f;  ///< above 0: of a GGX lobe, for which Phong's stands with GgxGain

  /// A GGX material.
  static Material ggx(const Eigen::Array3f& diffuse, const Eigen::Array3f& specular, float roughness) {
    return {diffuse, specular, phong_exponent(roughness), roughness};
  }
  bool is_diffuse() const { return (specular == 0.0f).all(); }
};

/// Meshes in place, joined into one, each vertex with its material.
struct Scene {
  Mesh mesh;  ///< colours: those of the files, or white
  std::vector<Material> materials;
  std::vector<std::uint16_t> material_of_vertex;  ///< [vertices]; a triangle's vertices have the same
  /// [vertices]: what Material::specular is multiplied by, as its diffuse reflectance is by the colour;
  /// empty: white.
  std::vector<Eigen::Array3f> specular_of_vertex;
  std::optional<PinholeCamera> camera;  ///< of image relighting and of pictures

  const Material& material_of_triangle(std::uint32_t triangle) const {
    return materials[material_of_vertex[mesh.triangles[triangle][0]]];
  }
  Eigen::Array3f specular(std::size_t vertex) const {
    const Eigen::Array3f& specular = materials[material_of_vertex[vertex]].specular;
    return specular_of_vertex.empty() ? specular : (specular * specular_of_vertex[vertex]).eval();
  }
};

/// Reads a scene's description (TOML, docs/reference/scene-files.md) and the meshes that it names, relative
/// to it; or, of a mesh's own file, the mesh alone, in its own materials, else white. Materials of mesh files
/// are read by `gloss`; Gloss::diffuse is for clusters of vertices. Throws InputError or FormatError, naming
/// the file.
Scene read_scene(const fs::path& path, const RunContext& run = {}, Gloss gloss = Gloss::lobes);

/// [vertices], linear RGB: colours times their material's diffuse reflectance.
std::vector<Eigen::Array3f> diffuse_reflectance(const Scene& scene);

/// Sorts vertices so that successive ones are neighbours with like normals (blocks of 16 and of 256 as
/// core/field/mesh.h explains); triangles and materials follow.
void sort_vertices(Scene& scene);

}  // namespace refield::prt
