// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/light/light_map.h"

namespace refield::peers {

/// A scene photographed under one cell of the light map at a time: transport that is constant over each cell.
struct CellModel {
  LightDomain domain;
  int width = 0;
  int height = 0;
  std::vector<Box> cells;
  Eigen::MatrixXf weights;  ///< [cells × (3 · pixels)], of the sum of the texels in a cell

  Image relight(const LightMap& light) const;
  double bytes_per_pixel() const;
};

/// A grid of at most `count` cells that covers a light map: as many as can be with sides no more unequal than
/// 1 : 2, and of such grids the one with the squarest cells.
std::vector<Box> light_cells(const LightDomain& domain, int count);

/// Light of radiance 1 in one cell, 0 elsewhere.
LightMap cell_light(const LightDomain& domain, const Box& cell);

/// The model from a photograph under each cell_light(), [cells]. Source: Debevec et al. 2000, section 3.1,
/// with a flat light map in place of directions. Throws InputError when numbers or sizes do not fit.
CellModel fit_cells(const LightDomain& domain, std::vector<Box> cells, std::span<const Image> photographs);

}  // namespace refield::peers
