// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace refield {

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
