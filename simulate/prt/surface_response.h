// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "simulate/prt/prt_scene.h"

namespace refield::prt {

/// Band factors λ_l, l < order, of Material's lobe (n + 2)/2π · tⁿ over t > 0: what it leaves of band l when
/// it averages light around a direction, 2π ∫ lobe(t) P_l(t) dt (Funk and Hecke). In closed form:
/// λ_0 = (n + 2)/(n + 1), λ_1 = 1, λ_l = λ_(l−2) (n − l + 2)/(n + l + 1).
std::vector<double> lobe_factors(double exponent, int order);

/// How the vertices of a scene reflect harmonics of the light that arrives at them times its cosine, I_i,
/// over the mirrored line of sight R: radiance(R) = Σ_i response_i I_i y_i(R). A lobe takes the harmonics one
/// by one, a diffuse surface the mean: kd/π · I_0/y_00, as a constant over R the coefficient 4 kd I_0.
class SurfaceResponse {
 public:
  SurfaceResponse(const Scene& scene, int order);

  /// 1 where the whole scene is diffuse (I_0 alone matters), else order².
  int outputs() const { return outputs_; }
  /// Whether all vertices reflect the three channels alike.
  bool is_grey() const { return grey_; }
  /// Factor of harmonic i at a vertex, colours included.
  Eigen::Array3f factor(std::size_t vertex, int harmonic) const;
  /// What a field multiplies a vertex by last: its diffuse or specular reflectance, white where it has both.
  Eigen::Array3f colour(std::size_t vertex) const;
  /// Factor without colour().
  Eigen::Array3f factor_before_colour(std::size_t vertex, int harmonic) const;

 private:
  const Material& material(std::size_t vertex) const {
    return scene_->materials[scene_->material_of_vertex[vertex]];
  }
  Eigen::Array3f diffuse(std::size_t vertex) const;

  const Scene* scene_;
  int outputs_ = 1;
  bool grey_ = true;
  std::vector<std::vector<float>> lobe_;  // [materials][order²]
};

}  // namespace refield::prt
