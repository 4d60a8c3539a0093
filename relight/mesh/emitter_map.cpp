// SPDX-License-Identifier: Apache-2.0
#include "relight/mesh/emitter_map.h"

#include <tbb/parallel_for.h>

#include "core/field/mesh.h"
#include "core/light/cube_map.h"
#include "relight/mesh/mesh_raster.h"

namespace refield {

namespace {

constexpr int pixels_of_side = 4;  // of a texel
constexpr int samples_of_pixel = 4;

PinholeCamera face_camera(int face, const Eigen::Vector3f& middle, int side) {
  const Eigen::Matrix3f axes = cube_face_axes(face).cast<float>();
  PinholeCamera camera;
  camera.position = middle;
  camera.target = middle + axes.row(2).transpose();
  camera.up = axes.row(1).transpose();
  camera.vertical_field_of_view_degrees = 90.0f;
  camera.width = camera.height = side;
  return camera;
}

Eigen::Array3f radiance(const Mesh& emitters, const SeenPoint& point) {
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (std::size_t k = 0; k < 3; ++k)
    sum += point.share[k] * emitters.colours[emitters.triangles[point.triangle][k]];
  return sum;
}

}  // namespace

LightMap emitter_map(const Mesh& emitters, const Eigen::Vector3f& middle, int resolution) {
  LightMap map{Image(resolution, cube_faces * resolution, 3), Parameterisation::cube};
  const int side = resolution * pixels_of_side;
  const std::vector<float> fine = cube_solid_angles(side), coarse = cube_solid_angles(resolution);
  tbb::parallel_for(0, cube_faces, [&](int face) {
    const std::vector<SeenPoint> seen =
        rasterise(emitters, face_camera(face, middle, side), samples_of_pixel);
    for (std::size_t k = 0; k < seen.size(); ++k) {
      if (seen[k].triangle == SeenPoint::nothing) continue;
      const std::size_t pixel = k / samples_of_pixel;
      const int x = static_cast<int>(pixel) % side / pixels_of_side,
                y = static_cast<int>(pixel) / side / pixels_of_side;
      const float share =
          fine[pixel] / (samples_of_pixel * coarse[static_cast<std::size_t>(y) * resolution + x]);
      const Eigen::Array3f light = share * radiance(emitters, seen[k]);
      for (int c = 0; c < 3; ++c) map.radiance.at(x, face * resolution + y, c) += light[c];
    }
  });
  return map;
}

}  // namespace refield
