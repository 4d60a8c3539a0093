// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/surface_response.h"

#include <algorithm>

#include "core/harmonics.h"

namespace refield::prt {

namespace {

/// Diffuse radiance as the coefficient of y_00 over I_00: (1/π) (I_0 / y_00) / y_00.
constexpr float diffuse_factor = 4.0f;

bool is_grey(const Eigen::Array3f& colour) {
  return (colour == colour[0]).all();
}

}  // namespace

std::vector<double> lobe_factors(double exponent, int order) {
  std::vector<double> factors = {(exponent + 2.0) / (exponent + 1.0), 1.0};
  for (int l = 2; l < order; ++l)
    factors.push_back(factors[static_cast<std::size_t>(l) - 2] * (exponent - l + 2.0) / (exponent + l + 1.0));
  factors.resize(static_cast<std::size_t>(order));
  return factors;
}

SurfaceResponse::SurfaceResponse(const Scene& scene, int order) : scene_(&scene) {
  for (const Material& material : scene.materials) {
    if (!material.is_diffuse()) outputs_ = harmonics_of(order);
    const std::vector<double> bands = lobe_factors(material.exponent, order);
    std::vector<float>& lobe = lobe_.emplace_back();
    for (int l = 0; l < order; ++l)
      lobe.insert(lobe.end(), 2 * static_cast<std::size_t>(l) + 1,
                  static_cast<float>(bands[static_cast<std::size_t>(l)]));
  }
  for (std::size_t v = 0; v < scene.mesh.positions.size() && grey_; ++v)
    grey_ = prt::is_grey(diffuse(v)) && prt::is_grey(material(v).specular);
}

Eigen::Array3f SurfaceResponse::diffuse(std::size_t vertex) const {
  return material(vertex).diffuse * scene_->mesh.colours[vertex];
}

Eigen::Array3f SurfaceResponse::factor(std::size_t vertex, int harmonic) const {
  const float lobe = lobe_[scene_->material_of_vertex[vertex]][static_cast<std::size_t>(harmonic)];
  Eigen::Array3f factor = material(vertex).specular * lobe;
  if (harmonic == 0) factor += diffuse_factor * diffuse(vertex);
  return factor;
}

Eigen::Array3f SurfaceResponse::colour(std::size_t vertex) const {
  if (material(vertex).is_diffuse()) return diffuse(vertex);
  if ((diffuse(vertex) == 0.0f).all()) return material(vertex).specular;
  return Eigen::Array3f::Ones();
}

Eigen::Array3f SurfaceResponse::factor_before_colour(std::size_t vertex, int harmonic) const {
  if (material(vertex).is_diffuse()) return Eigen::Array3f::Constant(harmonic == 0 ? diffuse_factor : 0.0f);
  if ((diffuse(vertex) == 0.0f).all())
    return Eigen::Array3f::Constant(
        lobe_[scene_->material_of_vertex[vertex]][static_cast<std::size_t>(harmonic)]);
  return factor(vertex, harmonic);
}

}  // namespace refield::prt
