// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "simulate/tabletop/scene.h"

namespace refield {

/// A field that darkens towards its corners: 1 − loss · (distance from the middle / distance of the
/// corners)².
struct Falloff {
  int width;
  int height;
  double loss;

  /// At a place from (0, 0) in one corner to (1, 1) in the opposite one.
  double at_share(double u, double v) const {
    const double dx = (2.0 * u - 1.0) * width;
    const double dy = (2.0 * v - 1.0) * height;
    return 1.0 - loss * (dx * dx + dy * dy) /
                     (static_cast<double>(width) * width + static_cast<double>(height) * height);
  }
  /// At the centre of a pixel.
  double at(int x, int y) const { return at_share((x + 0.5) / width, (y + 0.5) / height); }
};

/// Base colour of a material at a point of the object's own frame: textures are solid, carved out of space.
Rgb base_colour(const MaterialDescription& material, const Eigen::Vector3f& position);

/// Smooth lattice noise in [0, 1], one feature a unit (value noise; Perlin's quintic fade).
float value_noise(const Eigen::Vector3f& position);

/// Sum of octaves of value noise with halving amplitudes, in [0, 1]: about 1/f.
float fractal_noise(const Eigen::Vector3f& position, int octaves);

/// Whether light leaves a material in one or two exact directions only.
bool is_specular(const MaterialDescription& material);

/// A point on a surface that is not specular, seen from the direction `to_viewer`.
/// Reflection: Lambert (diffuse, translucent), and GGX with the height-correlated Smith shadowing term
/// (glossy, metal; Walter et al. 2007, Heitz 2014). The Lambertian base of a glossy coat gets what both
/// Fresnel transmissions leave (after Ashikhmin and Shirley 2000), so that no more light leaves than arrives.
class Surface {
 public:
  /// `smallest_alpha` roughens narrow lobes. Where light has been scattered before, that costs no visible
  /// detail and saves rare bright samples (path space regularisation; Kaplanyan and Dachsbacher 2013).
  Surface(const TabletopScene& scene, const Hit& hit, const Eigen::Vector3f& to_viewer,
          float smallest_alpha = 0.0f);

  bool is_translucent() const { return material_->kind == MaterialDescription::Kind::translucent; }

  const Eigen::Vector3f& position() const { return position_; }
  const Rgb& colour() const { return colour_; }

  /// Start of a ray that leaves in `direction`: a little off the surface on the right side.
  Eigen::Vector3f off_surface(const Eigen::Vector3f& direction) const;

  /// Reflected (or transmitted) radiance for unit radiance and unit solid angle from the unit direction
  /// `to_light`: f(to_light, to_viewer) · |cos θ|, per channel, 1/sr.
  Rgb scattering(const Eigen::Vector3f& to_light) const;

  struct Sample {
    Eigen::Vector3f direction;
    Rgb weight;  ///< scattering / probability density
  };
  /// A direction drawn roughly in proportion to the scattering, from three uniform numbers in [0, 1): two for
  /// the direction, one for the choice between coat and base, or between the two sides of a sheet. None when
  /// the draw falls below the surface.
  std::optional<Sample> sample(float u, float v, float choice) const;

 private:
  float density(const Eigen::Vector3f& to_light) const;
  Rgb fresnel(float cosine) const;

  const MaterialDescription* material_;
  Eigen::Vector3f position_, normal_, geometric_normal_, to_viewer_;  // both normals on the viewer's side
  Rgb colour_, normal_reflectance_;
  float alpha_ = 1.0f;
  float coat_probability_ = 0.0f;
  float view_cosine_ = 1.0f;
};

/// Unpolarised reflectance of a smooth dielectric (Fresnel). `cosine` of the angle of incidence, > 0; `ratio`
/// = index on the incident side / index on the other. 1 beyond the critical angle.
float dielectric_reflectance(float cosine, float ratio);

/// Refracted direction (Snell), or none beyond the critical angle. `direction` unit, towards the surface;
/// `normal` unit, on the incident side.
std::optional<Eigen::Vector3f> refracted(const Eigen::Vector3f& direction, const Eigen::Vector3f& normal,
                                         float ratio);

/// Mirror direction of a unit direction that points towards the surface.
Eigen::Vector3f reflected(const Eigen::Vector3f& direction, const Eigen::Vector3f& normal);

/// A point moved off its surface along `normal` by a length safe in float.
Eigen::Vector3f moved_off(const Eigen::Vector3f& position, const Eigen::Vector3f& normal);

/// Uniform direction within a cone; `cosine_limit` of its half angle.
Eigen::Vector3f sample_cone(const Eigen::Vector3f& axis, float cosine_limit, float u, float v);

}  // namespace refield
