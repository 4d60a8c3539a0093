// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>

namespace refield {

/// A pinhole camera in the axes of core/mesh.h (left-handed: +X right, +Y up, +Z ahead).
struct PinholeCamera {
  Eigen::Vector3f position = {0.0f, 0.0f, -3.0f};
  Eigen::Vector3f target = {0.0f, 0.0f, 0.0f};
  Eigen::Vector3f up = {0.0f, 1.0f, 0.0f};
  float vertical_field_of_view_degrees = 35.0f;
  int width = 640;  ///< pixels
  int height = 480;

  /// Unit, as rows: to the right, above, ahead.
  Eigen::Matrix3f axes() const;
  /// Unit direction through a point of the image, in pixels from its top left corner; centres lie at +0.5.
  Eigen::Vector3f direction(float x, float y) const;
  /// Where in the image a point is seen, in the same pixels, whatever hides it; nothing where it lies behind.
  std::optional<Eigen::Vector2f> image_point(const Eigen::Vector3f& point) const;
  /// Throws InputError for an empty image, a field of view outside (0, 180) degrees, a target at the camera
  /// or an `up` along the view.
  void check() const;
};

}  // namespace refield
