// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/pictures.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/image/tone_map.h"
#include "relight/mesh/mesh_view.h"

namespace refield::prt_chart {

namespace {

constexpr int picture_width = 192;

PinholeCamera small_camera(const FieldOutline& field) {
  PinholeCamera camera = standard_camera(field);
  camera.height = std::max(1, camera.height * picture_width / camera.width);
  camera.width = picture_width;
  return camera;
}

Image picture(const MeshRenderer& view, const std::vector<Eigen::Array3f>& shading) {
  Image outputs(output_image_width, output_image_height(shading.size()), 3);
  for (std::size_t v = 0; v < shading.size(); ++v)
    std::copy_n(shading[v].data(), 3, outputs.values.data() + 3 * pixel_of_output(v));
  return view.show(outputs);
}

/// Copies a picture of `channels` levels a pixel, of which three count, to column and row of the sheet.
void place(const std::vector<std::uint8_t>& levels, std::size_t channels, const PinholeCamera& camera,
           int column, int row, ScreenImage& sheet) {
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const auto from = channels * (static_cast<std::size_t>(y) * camera.width + x);
      const auto to = 3 * (static_cast<std::size_t>(row * camera.height + y) * sheet.width +
                           static_cast<std::size_t>(column * camera.width + x));
      std::copy_n(levels.data() + from, 3, sheet.levels.data() + to);
    }
}

/// Peers of one method stand next to each other.
std::vector<std::vector<const Peer*>> by_method(const std::vector<Peer>& peers) {
  std::vector<std::vector<const Peer*>> methods;
  for (const Peer& peer : peers) {
    if (methods.empty() || methods.back().front()->method != peer.method) methods.emplace_back();
    methods.back().push_back(&peer);
  }
  return methods;
}

}  // namespace

void write_comparison(const std::filesystem::path& path, const prt::Scene& scene,
                      const std::vector<Eigen::Array3f>& exact, const std::vector<Peer>& peers) {
  FieldOutline field;
  field.mesh = OutputMesh{scene.mesh, 0, scene.camera};
  field.mesh->colours = prt::diffuse_reflectance(scene);
  const MeshRenderer view(field, small_camera(field));
  const Image reference = picture(view, exact);
  const double bright = std::max(1e-30, quantile(reference.values, 0.99));
  const LevelTable tones(ToneMapping{0.9 / bright});
  const LevelTable differences = linear_levels(brightest_difference * bright);

  const auto methods = by_method(peers);
  const auto columns = 1 + std::ranges::max(methods, {}, [](const auto& row) { return row.size(); }).size();
  ScreenImage sheet{static_cast<int>(columns) * view.camera().width,
                    static_cast<int>(2 * methods.size()) * view.camera().height,
                    3,
                    {}};
  sheet.levels.resize(static_cast<std::size_t>(sheet.width) * sheet.height * 3);
  const auto show = [&](const Image& shown, int column, int row) {
    std::vector<std::uint8_t> levels;
    for (const float value : shown.values) levels.push_back(tones(value));
    place(levels, 3, view.camera(), column, row, sheet);
    Image difference = shown;
    for (std::size_t i = 0; i < difference.values.size(); ++i)
      difference.values[i] = std::abs(shown.values[i] - reference.values[i]);
    std::vector<std::uint8_t> rgba(difference.values.size() / 3 * 4);
    false_colour_rgba(difference, differences, rgba);
    place(rgba, 4, view.camera(), column, row + 1, sheet);
  };
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const int row = static_cast<int>(2 * m);
    show(reference, 0, row);
    for (std::size_t i = 0; i < methods[m].size(); ++i)
      show(picture(view, methods[m][i]->shading.front()), static_cast<int>(i) + 1, row);
  }
  write_png(path, sheet);
}

}  // namespace refield::prt_chart
