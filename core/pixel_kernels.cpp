// SPDX-License-Identifier: Apache-2.0
#include "core/pixel_kernels.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/errors.h"

namespace refield {

namespace {

void require_pixel(std::size_t pixel, std::size_t pixels) {
  if (pixel >= pixels)
    throw InputError("the field has " + std::to_string(pixels) + " pixels; there is no pixel " +
                     std::to_string(pixel));
}

std::optional<std::uint32_t> hat_of(const LightBasis& basis, std::uint32_t kernel) {
  return basis.is_smooth(kernel) ? std::optional(kernel) : std::nullopt;
}

/// Fills in the shares of energy, and sorts by them.
std::vector<PixelKernel> ranked(std::vector<PixelKernel> kernels, const LightBasis& basis) {
  double total = 0.0;
  for (PixelKernel& kernel : kernels) {
    const auto& w = kernel.weight;
    const double area = kernel.hat ? basis.area(*kernel.hat) : static_cast<double>(kernel.support.area());
    total += kernel.energy_share =
        (std::abs(static_cast<double>(w[0])) + std::abs(w[1]) + std::abs(w[2])) * area;
  }
  if (total > 0.0)
    for (PixelKernel& kernel : kernels) kernel.energy_share /= total;
  std::ranges::stable_sort(kernels, std::ranges::greater(), &PixelKernel::energy_share);
  return kernels;
}

template <class Weight>
std::vector<PixelKernel> kernels_in_tiles(const TiledTransfer<Weight>& tiles, const LightBasis& basis,
                                          std::size_t pixel) {
  const auto width = static_cast<std::size_t>(tiles.width);
  require_pixel(pixel, width * static_cast<std::size_t>(tiles.height));
  const int x = static_cast<int>(pixel % width), y = static_cast<int>(pixel / width);
  const Tile<Weight> tile = tiles.tile(y / tile_side_px * tiles.tiles_across() + x / tile_side_px);
  std::vector<PixelKernel> kernels;
  for_each_weight(tile, [&](std::size_t k, std::size_t at, const std::array<float, 3>& weight) {
    if (column_of_tile(at) != x % tile_side_px || row_of_tile(at) != y % tile_side_px) return;
    const SmallBox& box = tile.support[k];
    const auto hat = k < tile.common.size() ? hat_of(basis, tiles.common[tile.common[k]]) : std::nullopt;
    kernels.push_back({hat, {box.x0, box.y0, box.x1, box.y1}, weight, 0.0});
  });
  return ranked(std::move(kernels), basis);
}

}  // namespace

std::vector<PixelKernel> kernels_of_pixel(const ReflectanceField& field, std::size_t pixel) {
  const SparseTransfer& transfer = field.transfer;
  require_pixel(pixel, transfer.rows());
  std::vector<PixelKernel> kernels;
  for (std::uint64_t e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e) {
    const std::uint32_t kernel = transfer.column[e];
    const float* w = transfer.weight.data() + 3 * e;
    kernels.push_back({hat_of(field.basis, kernel), field.basis.support(kernel), {w[0], w[1], w[2]}, 0.0});
  }
  return ranked(std::move(kernels), field.basis);
}

std::vector<PixelKernel> kernels_of_pixel(const TransferTiles& tiles, const LightBasis& basis,
                                          std::size_t pixel) {
  return std::visit([&](const auto& transfer) { return kernels_in_tiles(transfer, basis, pixel); }, tiles);
}

Image kernel_density(const LightBasis& basis, std::span<const PixelKernel> kernels) {
  Image density(basis.domain.width, basis.domain.height, 1);
  for (const PixelKernel& entry : kernels) {
    const float weight = (entry.weight[0] + entry.weight[1] + entry.weight[2]) / 3.0f;
    for (int y = entry.support.y0; y < entry.support.y1; ++y)
      for (int x = entry.support.x0; x < entry.support.x1; ++x)
        density.at(x, y, 0) += entry.hat ? weight * basis.value(*entry.hat, x, y) : weight;
  }
  return density;
}

Image kernel_density(const ReflectanceField& field, std::size_t pixel) {
  return kernel_density(field.basis, kernels_of_pixel(field, pixel));
}

}  // namespace refield
