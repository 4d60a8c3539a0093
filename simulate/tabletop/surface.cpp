// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/surface.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/rng.h"

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

namespace {

using Eigen::Vector3f;
using MaterialKind = MaterialDescription::Kind;

constexpr float float_pi = std::numbers::pi_v<float>;
constexpr float ray_offset = 1e-4f;  // of a metre-sized scene: above float rounding, below any visible gap

struct Frame {
  Vector3f tangent, bitangent, normal;
  explicit Frame(const Vector3f& n) : normal(n) {
    tangent = (std::abs(n.y()) < 0.9f ? Vector3f::UnitY() : Vector3f::UnitX()).cross(n).normalized();
    bitangent = n.cross(tangent);
  }
  Vector3f to_world(const Vector3f& v) const { return v.x() * tangent + v.y() * bitangent + v.z() * normal; }
  Vector3f to_local(const Vector3f& v) const { return {v.dot(tangent), v.dot(bitangent), v.dot(normal)}; }
};

float ggx(float half_cosine, float alpha) {
  const float a2 = alpha * alpha;
  const float d = half_cosine * half_cosine * (a2 - 1.0f) + 1.0f;
  return a2 / (float_pi * d * d);
}

// Smith's Λ for GGX.
float smith_lambda(float cosine, float alpha) {
  const float c2 = cosine * cosine;
  return 0.5f * (std::sqrt(1.0f + alpha * alpha * (1.0f - c2) / c2) - 1.0f);
}

// A visible microfacet normal in the local frame (Heitz 2018, listing 1).
Vector3f sample_visible_normal(const Vector3f& view, float alpha, float u, float v) {
  const Vector3f stretched = Vector3f(alpha * view.x(), alpha * view.y(), view.z()).normalized();
  const float length2 = stretched.x() * stretched.x() + stretched.y() * stretched.y();
  const Vector3f t1 = length2 > 0.0f
                          ? (Vector3f(-stretched.y(), stretched.x(), 0.0f) / std::sqrt(length2)).eval()
                          : Vector3f::UnitX().eval();
  const Vector3f t2 = stretched.cross(t1);
  const float r = std::sqrt(u), phi = 2.0f * float_pi * v;
  const float p1 = r * std::cos(phi);
  const float s = 0.5f * (1.0f + stretched.z());
  const float p2 = (1.0f - s) * std::sqrt(1.0f - p1 * p1) + s * r * std::sin(phi);
  const Vector3f n = p1 * t1 + p2 * t2 + std::sqrt(std::max(0.0f, 1.0f - p1 * p1 - p2 * p2)) * stretched;
  return Vector3f(alpha * n.x(), alpha * n.y(), std::max(0.0f, n.z())).normalized();
}

}  // namespace

bool is_specular(const MaterialDescription& material) {
  return material.kind == MaterialKind::mirror || material.kind == MaterialKind::glass;
}

Vector3f moved_off(const Vector3f& position, const Vector3f& normal) {
  return position + ray_offset * normal;
}

Vector3f reflected(const Vector3f& direction, const Vector3f& normal) {
  return direction - 2.0f * direction.dot(normal) * normal;
}

std::optional<Vector3f> refracted(const Vector3f& direction, const Vector3f& normal, float ratio) {
  const float cosine = -direction.dot(normal);
  const float k = 1.0f - ratio * ratio * (1.0f - cosine * cosine);
  if (k < 0.0f) return std::nullopt;
  return (ratio * direction + (ratio * cosine - std::sqrt(k)) * normal).normalized();
}

float dielectric_reflectance(float cosine, float ratio) {
  const float k = 1.0f - ratio * ratio * (1.0f - cosine * cosine);
  if (k <= 0.0f) return 1.0f;
  const float t = std::sqrt(k);
  const float s_polarised = (ratio * cosine - t) / (ratio * cosine + t);
  const float p_polarised = (ratio * t - cosine) / (ratio * t + cosine);
  return 0.5f * (s_polarised * s_polarised + p_polarised * p_polarised);
}

Vector3f sample_cone(const Vector3f& axis, float cosine_limit, float u, float v) {
  const float cosine = 1.0f - u * (1.0f - cosine_limit);
  const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine));
  return Frame(axis).to_world(
      {sine * std::cos(2.0f * float_pi * v), sine * std::sin(2.0f * float_pi * v), cosine});
}

Surface::Surface(const TabletopScene& scene, const Hit& hit, const Vector3f& to_viewer, float smallest_alpha)
    : material_(&scene.material_of(hit.object)), position_(hit.position), to_viewer_(to_viewer) {
  geometric_normal_ = hit.geometric_normal;
  normal_ = hit.shading_normal;
  if (geometric_normal_.dot(to_viewer) < 0.0f) {
    geometric_normal_ = -geometric_normal_;
    normal_ = -normal_;
  }
  if (normal_.dot(to_viewer) <= 1e-3f)
    normal_ = geometric_normal_;  // smooth normals turn away near silhouettes
  view_cosine_ = std::clamp(normal_.dot(to_viewer), 1e-3f, 1.0f);
  colour_ = base_colour(*material_, hit.object_position);
  if (material_->kind == MaterialKind::glossy || material_->kind == MaterialKind::metal) {
    alpha_ = std::max(smallest_alpha, static_cast<float>(material_->roughness * material_->roughness));
    const auto n = static_cast<float>(material_->index_of_refraction);
    normal_reflectance_ = material_->kind == MaterialKind::metal
                              ? colour_
                              : Rgb::Constant((n - 1) * (n - 1) / ((n + 1) * (n + 1)));
    const float coat = fresnel(view_cosine_).mean();
    coat_probability_ = material_->kind == MaterialKind::metal
                            ? 1.0f
                            : std::clamp(coat / (coat + (1.0f - coat) * colour_.mean() + 1e-6f), 0.1f, 0.9f);
  }
}

Vector3f Surface::off_surface(const Vector3f& direction) const {
  return moved_off(
      position_, direction.dot(geometric_normal_) >= 0.0f ? geometric_normal_ : (-geometric_normal_).eval());
}

// Schlick 1994.
Rgb Surface::fresnel(float cosine) const {
  const float m = 1.0f - cosine, m2 = m * m;
  return normal_reflectance_ + (1.0f - normal_reflectance_) * (m2 * m2 * m);
}

Rgb Surface::scattering(const Vector3f& to_light) const {
  const float cosine = to_light.dot(normal_);
  const float side = to_light.dot(geometric_normal_);
  if (material_->kind == MaterialKind::translucent) {
    const auto t = static_cast<float>(material_->transmission);
    return colour_ * ((side > 0.0f ? 1.0f - t : t) * std::abs(cosine) / float_pi);
  }
  if (cosine <= 0.0f || side <= 0.0f) return Rgb::Zero();
  if (material_->kind == MaterialKind::diffuse) return colour_ * (cosine / float_pi);

  const Vector3f half = (to_light + to_viewer_).normalized();
  const float smith = 1.0f / (1.0f + smith_lambda(view_cosine_, alpha_) + smith_lambda(cosine, alpha_));
  Rgb coat = fresnel(std::max(0.0f, half.dot(to_light))) *
             (ggx(half.dot(normal_), alpha_) * smith / (4.0f * view_cosine_));
  if (material_->kind == MaterialKind::metal) return coat;
  return coat + (1.0f - fresnel(cosine)) * (1.0f - fresnel(view_cosine_)) * colour_ * (cosine / float_pi);
}

float Surface::density(const Vector3f& to_light) const {
  const float cosine = to_light.dot(normal_);
  if (material_->kind == MaterialKind::translucent) {
    const auto t = static_cast<float>(material_->transmission);
    return (to_light.dot(geometric_normal_) > 0.0f ? 1.0f - t : t) * std::abs(cosine) / float_pi;
  }
  const float lambert = std::max(0.0f, cosine) / float_pi;
  if (coat_probability_ == 0.0f) return lambert;
  const Vector3f half = (to_light + to_viewer_).normalized();
  const float visible =
      ggx(half.dot(normal_), alpha_) / (4.0f * view_cosine_ * (1.0f + smith_lambda(view_cosine_, alpha_)));
  return coat_probability_ * visible + (1.0f - coat_probability_) * lambert;
}

std::optional<Surface::Sample> Surface::sample(float u, float v, float choice) const {
  const Frame frame(normal_);
  Vector3f direction;
  if (choice < coat_probability_) {
    const Vector3f facet = frame.to_world(sample_visible_normal(frame.to_local(to_viewer_), alpha_, u, v));
    direction = reflected(-to_viewer_, facet);
  } else {
    const float r = std::sqrt(u), phi = 2.0f * float_pi * v;
    const bool through = material_->kind == MaterialKind::translucent && choice < material_->transmission;
    const float z = std::sqrt(std::max(0.0f, 1.0f - u));
    direction = frame.to_world({r * std::cos(phi), r * std::sin(phi), through ? -z : z});
  }
  const Rgb scattered = scattering(direction);
  const float p = density(direction);
  if (!(p > 0.0f) || !(scattered.maxCoeff() > 0.0f)) return std::nullopt;
  return Sample{direction, scattered / p};
}

}  // namespace refield
