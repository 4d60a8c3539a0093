// SPDX-License-Identifier: Apache-2.0
#include "simulate/textures.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/rng.h"

namespace refield {

namespace {

constexpr int texture_octaves = 5;
constexpr int rings_per_scale = 8;

float lattice_value(int x, int y, int z) {
  return static_cast<float>(
      Rng(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), static_cast<std::uint32_t>(z))
          .uniform());
}

}  // namespace

float value_noise(const Eigen::Vector3f& p) {
  const Eigen::Vector3f base = p.array().floor();
  const Eigen::Vector3i i = base.cast<int>();
  const Eigen::Array3f t = (p - base).array();
  const Eigen::Array3f s = t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f);
  float sum = 0.0f;
  for (int corner = 0; corner < 8; ++corner) {
    const int a = corner & 1, b = corner >> 1 & 1, c = corner >> 2;
    sum += (a ? s[0] : 1 - s[0]) * (b ? s[1] : 1 - s[1]) * (c ? s[2] : 1 - s[2]) *
           lattice_value(i.x() + a, i.y() + b, i.z() + c);
  }
  return sum;
}

float fractal_noise(const Eigen::Vector3f& position, int octaves) {
  float sum = 0.0f, amplitude = 0.5f, total = 0.0f;
  Eigen::Vector3f p = position;
  for (int k = 0; k < octaves; ++k, amplitude *= 0.5f) {
    sum += amplitude * value_noise(p);
    total += amplitude;
    p = 2.0f * p + Eigen::Vector3f(17.3f, 5.1f, 9.7f);  // octaves' lattices do not line up
  }
  return sum / total;
}

Rgb base_colour(const MaterialDescription& material, const Eigen::Vector3f& position) {
  const TextureDescription& texture = material.texture;
  const Eigen::Vector3f p = position / static_cast<float>(texture.scale_m);
  float share = 0.0f;  // of the second colour
  switch (texture.kind) {
    case TextureDescription::Kind::plain:
      return material.colour;
    case TextureDescription::Kind::checker: {
      // Half a check up: a face at height 0 does not flicker between two layers of checks.
      const int sum = static_cast<int>(std::floor(p.x())) + static_cast<int>(std::floor(p.y() + 0.5f)) +
                      static_cast<int>(std::floor(p.z()));
      share = static_cast<float>(sum & 1);
      break;
    }
    case TextureDescription::Kind::noise: {
      const float v = fractal_noise(p, texture_octaves);
      share = std::clamp(2.5f * v - 0.75f, 0.0f, 1.0f);
      break;
    }
    case TextureDescription::Kind::wood: {
      // Rings about a trunk along x, wavy by noise, with fine fibres.
      const Eigen::Vector3f wavy = p + 0.35f * Eigen::Vector3f(0.0f, value_noise(p), value_noise(p * 0.9f));
      const float radius = std::hypot(wavy.y() + 0.8f, wavy.z() + 0.2f * wavy.x());
      const float ring = radius * rings_per_scale - std::floor(radius * rings_per_scale);
      const float fibre = value_noise(Eigen::Vector3f(p.x() * 6.0f, p.y() * 90.0f, p.z() * 90.0f));
      share = std::clamp(0.75f * ring * ring + 0.35f * (fibre - 0.3f), 0.0f, 1.0f);
      break;
    }
  }
  return (1.0f - share) * material.colour + share * texture.second_colour;
}

}  // namespace refield
