// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <array>

#include "core/image/image.h"

namespace refield {

/// CIE 1931 chromaticities x, y of red, green, blue and white.
using Chromaticities = std::array<Eigen::Vector2d, 4>;
const Chromaticities& rec709_chromaticities();
/// ACES primaries 1 of the Academy (S-2014-004): those of ACEScg.
const Chromaticities& acescg_chromaticities();

/// CIE XYZ of linear RGB; white has Y = 1.
Eigen::Matrix3d xyz_from_rgb(const Chromaticities& of);
/// Between whites x, y, by the Bradford transform. Source: Lam 1985; ICC.1:2010, annex E.
Eigen::Matrix3d bradford_adaptation(const Eigen::Vector2d& from, const Eigen::Vector2d& to);
/// Linear RGB of other primaries, the white adapted.
Eigen::Matrix3d rgb_from_rgb(const Chromaticities& from, const Chromaticities& to);

/// Multiplies each pixel of an image with three channels by the matrix.
void convert_colours(Image& image, const Eigen::Matrix3f& matrix);
void convert_colours(std::span<float> pixels, const Eigen::Matrix3f& matrix);

/// CIE L*a*b* under D50 of linear Rec.709, white adapted from D65. Negative channels are allowed.
Eigen::Vector3d lab_from_rec709(const Eigen::Vector3d& linear);
Eigen::Vector3d rec709_from_lab(const Eigen::Vector3d& lab);

/// CIEDE2000 colour difference of two L*a*b* colours. Source: Sharma, Wu and Dalal, "The CIEDE2000
/// Color-Difference Formula: Implementation Notes, Supplementary Test Data, and Mathematical Observations",
/// 2005.
double delta_e_2000(const Eigen::Vector3d& lab, const Eigen::Vector3d& other);

}  // namespace refield
