// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace refield {

/// A pinhole camera in the axes of core/field/mesh.h (left-handed: +X right, +Y up, +Z ahead).
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

/// Triangles that share vertices, in the axes of light directions (cube_face_axes(): +X right, +Y up, +Z
/// ahead, left-handed). Files of meshes are right-handed: who reads one negates z and turns triangles around.
struct Mesh {
  std::vector<Eigen::Vector3f> positions;  ///< [vertices]
  std::vector<Eigen::Vector3f> normals;    ///< [vertices], unit
  /// [vertices], linear RGB in [0, 1]: what a vertex' light is multiplied by last (diffuse or specular
  /// reflectance).
  std::vector<Eigen::Array3f> colours;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< (p1 − p0) × (p2 − p0) points to the front

  bool empty() const { return positions.empty(); }
};

/// Outputs of a field over a mesh stand in an image, as pixels of a captured one do, so that 16 successive
/// outputs make a group of 4×4 pixels and 256 a tile of 16×16 (transfer_tiles.h): successive vertices should
/// be neighbours that look alike. This many pixels wide, as high as needed; pixels beyond the last output
/// are dark.
inline constexpr int output_image_width = 64;
int output_image_height(std::size_t outputs);
/// Row-major number of the pixel that holds an output.
std::size_t pixel_of_output(std::size_t output);

}  // namespace refield
