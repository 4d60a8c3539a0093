// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

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

void require(bool good, const char* name, const std::string& value, const char* remedy) {
  if (!good) throw InputError(std::string("BRDF: ") + name + " " + value + ": " + remedy);
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

void Brdf::check() const {
  const auto check_colour = [](const char* name, const Eigen::Array3f& colour) {
    for (int c = 0; c < 3; ++c)
      require(colour[c] >= 0.0f && std::isfinite(colour[c]), name, std::to_string(colour[c]),
              "give a finite number that is not negative");
  };
  check_colour("diffuse", diffuse);
  check_colour("specular", specular);
  if (lobe == Lobe::phong)
    require(exponent >= 0.0f && exponent <= 1e5f, "exponent", std::to_string(exponent),
            "give a number from 0 to 100000");
  if (lobe == Lobe::ggx)
    require(roughness >= 0.01f && roughness <= 1.0f, "roughness", std::to_string(roughness),
            "give a number from 0.01 to 1");
}

}  // namespace refield::dynamic
