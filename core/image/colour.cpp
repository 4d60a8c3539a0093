// SPDX-License-Identifier: Apache-2.0
#include "core/image/colour.h"

#include <Eigen/LU>

#include <cmath>
#include <numbers>

namespace refield {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

Vector3d xyz_of_white(const Vector2d& xy) {
  return {xy.x() / xy.y(), 1.0, (1.0 - xy.x() - xy.y()) / xy.y()};
}

const Vector2d& d50() {
  static const Vector2d xy(0.3457, 0.3585);
  return xy;
}

// CIE 15:2004, section 8.2.1.
constexpr double lab_linear_part = 216.0 / 24389.0;
constexpr double lab_slope = 24389.0 / 27.0 / 116.0;

double lab_curve(double t) {
  return t > lab_linear_part ? std::cbrt(t) : lab_slope * t + 16.0 / 116.0;
}

double inverse_lab_curve(double f) {
  const double t = f * f * f;
  return t > lab_linear_part ? t : (f - 16.0 / 116.0) / lab_slope;
}

const Matrix3d& xyz_d50_from_rec709() {
  static const Matrix3d matrix =
      bradford_adaptation(rec709_chromaticities()[3], d50()) * xyz_from_rgb(rec709_chromaticities());
  return matrix;
}

double degrees(double radians) {
  return radians * 180.0 / std::numbers::pi;
}

double cos_degrees(double angle) {
  return std::cos(angle * std::numbers::pi / 180.0);
}

double hue_degrees(double a, double b) {
  if (a == 0.0 && b == 0.0) return 0.0;
  const double hue = degrees(std::atan2(b, a));
  return hue < 0.0 ? hue + 360.0 : hue;
}

/// √(c⁷ / (c⁷ + 25⁷))
double share_of_high_chroma(double c) {
  const double c7 = std::pow(c, 7.0);
  return std::sqrt(c7 / (c7 + std::pow(25.0, 7.0)));
}

}  // namespace

std::string_view v0_2::name_of(ColourSpace space) {
  return space == ColourSpace::rec709 ? "linear Rec.709" : "camera RGB";
}

const Chromaticities& rec709_chromaticities() {
  static const Chromaticities xy = {Vector2d(0.64, 0.33), Vector2d(0.30, 0.60), Vector2d(0.15, 0.06),
                                    Vector2d(0.3127, 0.3290)};
  return xy;
}

const Chromaticities& acescg_chromaticities() {
  static const Chromaticities xy = {Vector2d(0.713, 0.293), Vector2d(0.165, 0.830), Vector2d(0.128, 0.044),
                                    Vector2d(0.32168, 0.33767)};
  return xy;
}

Matrix3d xyz_from_rgb(const Chromaticities& of) {
  Matrix3d primaries;
  for (int c = 0; c < 3; ++c) primaries.col(c) = xyz_of_white(of[c]) * of[c].y();
  const Vector3d strengths = primaries.inverse() * xyz_of_white(of[3]);
  return primaries * strengths.asDiagonal();
}

Matrix3d bradford_adaptation(const Vector2d& from, const Vector2d& to) {
  Matrix3d cones;
  cones << 0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296;
  const Vector3d gain = (cones * xyz_of_white(to)).cwiseQuotient(cones * xyz_of_white(from));
  return cones.inverse() * gain.asDiagonal() * cones;
}

Matrix3d rgb_from_rgb(const Chromaticities& from, const Chromaticities& to) {
  return xyz_from_rgb(to).inverse() * bradford_adaptation(from[3], to[3]) * xyz_from_rgb(from);
}

void convert_colours(Image& image, const Eigen::Matrix3f& matrix) {
  convert_colours(image.values, matrix);
}

void convert_colours(std::span<float> pixels, const Eigen::Matrix3f& matrix) {
  for (std::size_t i = 0; i < pixels.size(); i += 3) {
    Eigen::Map<Eigen::Vector3f> pixel(&pixels[i]);
    pixel = (matrix * pixel).eval();
  }
}

Vector3d lab_from_rec709(const Vector3d& linear) {
  const Vector3d xyz = (xyz_d50_from_rec709() * linear).cwiseQuotient(xyz_of_white(d50()));
  const double y = lab_curve(xyz.y());
  return {116.0 * y - 16.0, 500.0 * (lab_curve(xyz.x()) - y), 200.0 * (y - lab_curve(xyz.z()))};
}

Vector3d rec709_from_lab(const Vector3d& lab) {
  const double y = (lab[0] + 16.0) / 116.0;
  const Vector3d xyz(inverse_lab_curve(y + lab[1] / 500.0), inverse_lab_curve(y),
                     inverse_lab_curve(y - lab[2] / 200.0));
  return xyz_d50_from_rec709().inverse() * xyz.cwiseProduct(xyz_of_white(d50()));
}

double delta_e_2000(const Vector3d& lab, const Vector3d& other) {
  // Names and numbers of equations as in the source.
  const double c_mean = 0.5 * (std::hypot(lab[1], lab[2]) + std::hypot(other[1], other[2]));
  const double g = 0.5 * (1.0 - share_of_high_chroma(c_mean));                // eq. 4
  const double a1 = (1.0 + g) * lab[1], a2 = (1.0 + g) * other[1];            // eq. 5
  const double c1 = std::hypot(a1, lab[2]), c2 = std::hypot(a2, other[2]);    // eq. 6
  const double h1 = hue_degrees(a1, lab[2]), h2 = hue_degrees(a2, other[2]);  // eq. 7
  const bool is_grey = c1 * c2 == 0.0;
  double dh = is_grey ? 0.0 : h2 - h1;  // eq. 10
  if (dh > 180.0) dh -= 360.0;
  if (dh < -180.0) dh += 360.0;
  const double dH = 2.0 * std::sqrt(c1 * c2) * std::sin(0.5 * dh * std::numbers::pi / 180.0);  // eq. 11
  const double l = 0.5 * (lab[0] + other[0]), c = 0.5 * (c1 + c2);                             // eqs. 12, 13
  double h = is_grey ? h1 + h2 : 0.5 * (h1 + h2);                                              // eq. 14
  if (!is_grey && std::abs(h1 - h2) > 180.0) h += h1 + h2 < 360.0 ? 180.0 : -180.0;
  const double t = 1.0 - 0.17 * cos_degrees(h - 30.0) + 0.24 * cos_degrees(2.0 * h) +
                   0.32 * cos_degrees(3.0 * h + 6.0) - 0.20 * cos_degrees(4.0 * h - 63.0);  // eq. 15
  const double turn = 60.0 * std::exp(-std::pow((h - 275.0) / 25.0, 2.0));  // 2 Δθ, eqs. 16, 21
  const double r_t = -std::sin(turn * std::numbers::pi / 180.0) * 2.0 * share_of_high_chroma(c);
  const double s_l = 1.0 + 0.015 * std::pow(l - 50.0, 2.0) / std::sqrt(20.0 + std::pow(l - 50.0, 2.0));
  const double dl = (other[0] - lab[0]) / s_l, dc = (c2 - c1) / (1.0 + 0.045 * c),
               dhs = dH / (1.0 + 0.015 * c * t);                     // eqs. 18–20
  return std::sqrt(dl * dl + dc * dc + dhs * dhs + r_t * dc * dhs);  // eq. 22
}

}  // namespace refield
