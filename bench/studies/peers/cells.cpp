// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/base/errors.h"
#include "core/light/summed_area_table.h"

namespace refield::peers {

namespace {

constexpr double max_oblong = 1.0;  // octaves: a cell is at most twice as long as wide

}  // namespace

std::vector<Box> light_cells(const LightDomain& domain, int count) {
  int columns = 1, rows = 1;
  double best_oblong = max_oblong;
  for (int across = 1; across <= std::min(count, domain.width); ++across) {
    const int down = std::min(count / across, domain.height);
    const double oblong = std::abs(
        std::log2(static_cast<double>(domain.width) * down / (static_cast<double>(domain.height) * across)));
    const bool more = across * down > columns * rows && oblong <= max_oblong;
    const bool squarer = across * down == columns * rows && oblong < best_oblong;
    if (!more && !squarer) continue;
    columns = across;
    rows = down;
    best_oblong = oblong;
  }
  std::vector<Box> cells;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      cells.push_back({i * domain.width / columns, j * domain.height / rows, (i + 1) * domain.width / columns,
                       (j + 1) * domain.height / rows});
  return cells;
}

LightMap cell_light(const LightDomain& domain, const Box& cell) {
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int y = cell.y0; y < cell.y1; ++y)
    std::fill_n(light.radiance.row(y).begin() + 3 * cell.x0, 3 * cell.width(), 1.0f);
  return light;
}

CellModel fit_cells(const LightDomain& domain, std::vector<Box> cells, std::span<const Image> photographs) {
  if (cells.size() != photographs.size() || cells.empty())
    throw InputError(std::to_string(cells.size()) + " cells of light need as many photographs, not " +
                     std::to_string(photographs.size()));
  const Image& first = photographs.front();
  CellModel model{domain, first.width, first.height, std::move(cells), {}};
  model.weights.resize(static_cast<Eigen::Index>(photographs.size()),
                       static_cast<Eigen::Index>(first.values.size()));
  for (std::size_t k = 0; k < photographs.size(); ++k) {
    if (!photographs[k].same_shape(first) || first.channels != 3)
      throw InputError("photographs under single cells differ in size");
    model.weights.row(static_cast<Eigen::Index>(k)) =
        Eigen::Map<const Eigen::RowVectorXf>(photographs[k].values.data(), model.weights.cols()) /
        static_cast<float>(model.cells[k].area());
  }
  return model;
}

Image CellModel::relight(const LightMap& light) const {
  if (light.domain() != domain)
    throw InputError("the light map does not have the size that the model was fitted to");
  const SummedAreaTable table(light.radiance);
  Eigen::MatrixXf sums(static_cast<Eigen::Index>(cells.size()), 3);
  for (std::size_t k = 0; k < cells.size(); ++k) {
    const auto sum = table.sum(cells[k]);
    for (int c = 0; c < 3; ++c) sums(static_cast<Eigen::Index>(k), c) = static_cast<float>(sum[c]);
  }
  Image image(width, height, 3);
  tbb::parallel_for(tbb::blocked_range<Eigen::Index>(0, weights.cols(), 1024), [&](const auto& range) {
    for (Eigen::Index i = range.begin(); i != range.end(); ++i)
      image.values[static_cast<std::size_t>(i)] = std::max(0.0f, weights.col(i).dot(sums.col(i % 3)));
  });
  return image;
}

double CellModel::bytes_per_pixel() const {
  return 3.0 * static_cast<double>(weights.rows()) * sizeof(float);
}

}  // namespace refield::peers
