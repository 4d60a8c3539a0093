// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "core/light/light_map.h"

namespace refield {

inline constexpr int cube_faces = 6;

/// The domain of a cube map of R×R texels per face.
constexpr LightDomain cube_domain(int resolution) {
  return {resolution, cube_faces * resolution, Parameterisation::cube};
}

/// A cube map whose faces lie as OpenEXR defines them (attribute envmap), in the layout of cube_face_axes():
/// the same view as OpenEXR's lat-long map of the place, which is a lat-long map here too. OpenEXR puts the
/// middles of the outermost texels onto the edges of the cube, half a texel further out: that is not made up
/// for. Throws InputError unless height = 6 × width. Source: ImfEnvmap.h, "Cube map".
Image from_openexr_cube(const Image& stored);

/// Unit direction of the point (column, row) of a cube map, in texels; the centre of texel (x, y) is at
/// (x + ½, y + ½). The face is the one that row ∕ R lies in.
Eigen::Vector3d cube_direction(double column, double row, int resolution);
/// Inverse of cube_direction(), (column, row); the row stays within its face's.
Eigen::Vector2d cube_position(const Eigen::Vector3d& direction, int resolution);

/// Solid angle of texel (x, y), steradians; all together are 4π. The same for all faces, so `y` may count
/// from any face's top.
double cube_solid_angle(int x, int y, int resolution);
/// That of a rectangle of a cube map, which may reach over several faces.
double cube_solid_angle(const Box& box, int resolution);
/// Those of a face's texels, [resolution²], row by row.
std::vector<float> cube_solid_angles(int resolution);
/// The four Gauss points of the unit square, (column, row), all of weight ¼: exact for cubics of both.
inline constexpr std::array<std::array<double, 2>, 4> square_gauss_points{
    {{0.21132486540518712, 0.21132486540518712},
     {0.21132486540518712, 0.78867513459481288},
     {0.78867513459481288, 0.21132486540518712},
     {0.78867513459481288, 0.78867513459481288}}};
/// Mean direction of a texel, in the axes of its face (cube_face_axes()); not quite a unit vector. By the
/// Gauss points of the square: exact but for the fourth power of 1 ∕ R.
Eigen::Vector3d cube_mean_direction(int x, int y, int resolution);

}  // namespace refield
