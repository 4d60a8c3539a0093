// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf.h"

#include <algorithm>
#include <numbers>

#include "core/base/errors.h"

namespace refield::dynamic {

namespace {

constexpr float float_pi = std::numbers::pi_v<float>;
/// Cosines below this count as the horizon: half vectors of two such directions would be lost in float.
constexpr float horizon = 1e-6f;

float phong(float exponent, const Eigen::Vector3f& in, const Eigen::Vector3f& out) {
  const float cosine = in.z() * out.z() - in.x() * out.x() - in.y() * out.y();
  return cosine > 0.0f ? (exponent + 2.0f) / (2.0f * float_pi) * std::pow(std::min(cosine, 1.0f), exponent)
                       : 0.0f;
}

Eigen::Array3f ggx(const Eigen::Array3f& specular, float roughness, const Eigen::Vector3f& in,
                   const Eigen::Vector3f& out) {
  const Eigen::Vector3f half = (in + out).normalized();
  const float squared = roughness * roughness;
  // 1 − z² as the length across: what is left of 1 − z in float would not tell narrow lobes apart.
  const float across = half.head<2>().squaredNorm();
  const float spread = across + squared * half.z() * half.z();
  const float distribution = squared / (float_pi * spread * spread);
  const auto leaving = [squared](float cosine) {
    return std::sqrt(squared + (1.0f - squared) * cosine * cosine);
  };
  const float shadowing_by_cosines =
      0.5f / (out.z() * leaving(in.z()) + in.z() * leaving(out.z()));  // G/(4 cosθ cosθ_o)
  const float grazing = std::pow(1.0f - std::clamp(in.dot(half), 0.0f, 1.0f), 5.0f);
  return (specular + (1.0f - specular) * grazing) * (distribution * shadowing_by_cosines);
}

}  // namespace

Eigen::Array3f Brdf::operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const {
  if (in.z() <= horizon || out.z() <= horizon) return Eigen::Array3f::Zero();
  Eigen::Array3f matte = diffuse / float_pi;
  switch (lobe) {
    case Lobe::none:
      return matte;
    case Lobe::phong:
      return matte + specular * phong(exponent, in, out);
    case Lobe::ggx:
      return matte + ggx(specular, roughness, in, out);
  }
  return matte;
}

}  // namespace refield::dynamic
