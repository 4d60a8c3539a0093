// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/basis_pictures.h"

#include <algorithm>

#include "bench/studies/dynamic/fixed_basis.h"
#include "bench/studies/dynamic/picture_grid.h"
#include "relight/mesh/mesh_view.h"

namespace refield::dynamic_chart {

namespace {

/// From before and above, so that floors are seen, too.
PinholeCamera camera_of(const Mesh& mesh) {
  PinholeCamera camera = framing_camera(mesh, 130, 110);
  const float distance = (camera.position - camera.target).norm();
  camera.position = camera.target + distance * Eigen::Vector3f(0.0f, 0.7f, -0.75f);
  return camera;
}

/// Grey levels of all vertices, in the order of outputs.
Image outputs_of(const Eigen::VectorXf& values) {
  const auto count = static_cast<std::size_t>(values.size());
  Image outputs(output_image_width, output_image_height(count), 3);
  for (std::size_t v = 0; v < count; ++v)
    for (std::size_t c = 0; c < 3; ++c)
      outputs.values[3 * pixel_of_output(v) + c] = std::max(0.0f, values[static_cast<Eigen::Index>(v)]);
  return outputs;
}

/// Left out where they hide nothing that the others show.
bool is_charted(const StudyBasis& basis) {
  return basis.name != "principal, near";
}

}  // namespace

Image basis_picture(const StudySurface& surface, const std::vector<StudyBasis>& bases,
                    const Eigen::MatrixXf& light) {
  FieldOutline field;
  field.mesh = OutputMesh{surface.mesh};
  field.mesh->colours.assign(field.mesh->positions.size(), Eigen::Array3f::Ones());
  const MeshRenderer view(field, camera_of(surface.mesh));
  const Eigen::VectorXf areas = dynamic::areas_of(surface.mesh);
  // As bright as a picture can be without losing more than its brightest spots.
  std::vector<float> levels(light.col(0).data(), light.col(0).data() + light.rows());
  const auto bright = levels.begin() + static_cast<std::ptrdiff_t>(levels.size() * 98 / 100);
  std::ranges::nth_element(levels, bright);
  const Eigen::VectorXf exact = light.col(0) * (0.9f / std::max(*bright, 1e-30f));
  std::vector<Image> pictures;
  for (const StudyBasis& basis : bases) {
    if (!is_charted(basis)) continue;
    pictures.push_back(view.show(outputs_of(exact)));
    for (const int functions : {4, 8, 16}) {
      const auto some = dynamic::surface_basis(
          basis.functions.leftCols(std::min<Eigen::Index>(functions, basis.functions.cols())), areas);
      pictures.push_back(view.show(outputs_of(some.functions * (some.to_weights * exact))));
    }
  }
  return picture_grid(pictures, 4);
}

}  // namespace refield::dynamic_chart
