// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/image_io.h"

namespace refield {

/// The chart of 24 patches in four rows of six, from dark skin at the top left to black at the bottom right.
inline constexpr int chart_columns = 6;
inline constexpr int chart_rows = 4;
inline constexpr int chart_patches = chart_columns * chart_rows;

std::string_view chart_patch_name(int patch);

/// CIE L*a*b* of the patches under D50, 2° observer. Source: X-Rite, "New color specifications for
/// ColorChecker SG and Classic Charts", 2016: charts made since November 2014. Earlier
/// ones differ by CIEDE2000 0.8 in the mean; the fit to one has errors of 0.5 (median) and 1.3 (largest).
const std::array<Eigen::Vector3d, chart_patches>& chart_lab();

/// A chart as a photograph shows it.
struct ColourChart {
  /// Column, row and 1, counted from the centre of the first patch, to pixels (y down, centres at +0.5).
  Eigen::Matrix3d image_from_chart = Eigen::Matrix3d::Identity();
  /// Mean of the middle of each patch, the camera's channels.
  std::array<Eigen::Vector3d, chart_patches> camera;

  /// Image of a point of the chart, pixels.
  Eigen::Vector2d point(double column, double row) const;
};

/// Finds a chart in a scene-linear photograph and reads its patches. Any rotation, tilts up to 40°; the chart
/// must be some 60 pixels wide or more. Patches show as flat quadrilaterals; those that lie on one grid
/// give its homography; of the ways that the grid can lie on 6 × 4 patches, the one counts whose colours fit
/// best. Throws InputError that begins with `name` where no chart is found, where it is seen mirrored, and
/// naming the patches that are covered, clipped or outside of the picture.
ColourChart find_colour_chart(const Photograph& photograph, const std::string& name);

/// The matrix that brings the camera's channels to linear Rec.709, and what is left of the colour errors.
struct ColourFit {
  /// The light on the chart becomes white. Scaled so that a grey surface keeps the value of its green.
  Eigen::Matrix3d rec709_from_camera = Eigen::Matrix3d::Identity();
  std::array<double, chart_patches> delta_e{};  ///< CIEDE2000 of each patch
  /// Largest brightness over smallest on the chart, minus 1: the light falls off linearly across it, which is
  /// estimated together with the matrix and does not count as an error.
  double light_change = 0.0;

  double median_delta_e() const;
  double largest_delta_e() const;
  /// Index of the patch with largest_delta_e().
  int worst_patch() const;
};

/// Least squares in L*a*b*, chroma weighted as in CIE94, over the matrix and the fall-off. Throws InputError
/// that begins with `name` where the colours are not those of the chart.
ColourFit fit_colour(const ColourChart& chart, const std::string& name);

}  // namespace refield
