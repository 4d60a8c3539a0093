// SPDX-License-Identifier: Apache-2.0
#include "core/field/field_statistics.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string>

#include "core/base/errors.h"

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

namespace {

/// The number of leading values that reach `share` of the total. `energies` fall.
std::uint64_t count_for_share(const std::vector<float>& energies, double total, double share) {
  double sum = 0.0;
  std::uint64_t count = 0;
  while (count < energies.size() && sum < share * total) sum += energies[count++];
  return count;
}

}  // namespace

KernelStatistics kernel_statistics(const ReflectanceField& field, int kernels_per_pixel) {
  const SparseTransfer& transfer = field.transfer;
  KernelStatistics statistics;
  statistics.stored = transfer.entries();
  statistics.distinct_boxes = field.basis.boxes.size();
  for (std::size_t row = 0; row < transfer.rows(); ++row) {
    const std::uint64_t entries = transfer.row_start[row + 1] - transfer.row_start[row];
    if (entries >= statistics.histogram.size()) statistics.histogram.resize(entries + 1);
    ++statistics.histogram[entries];
    if (entries > 0) ++statistics.pixels;
  }
  if (statistics.pixels == 0) return statistics;
  const std::uint64_t most = statistics.histogram.size() - 1;
  statistics.kernels = statistics.pixels * std::max<std::uint64_t>(most, std::max(kernels_per_pixel, 0));
  statistics.mean_stored = static_cast<double>(statistics.stored) / static_cast<double>(statistics.pixels);

  std::vector<double> areas(field.basis.size());
  for (std::size_t k = 0; k < areas.size(); ++k) areas[k] = field.basis.area(k);
  std::vector<float> energies(transfer.entries());
  for (std::size_t e = 0; e < energies.size(); ++e) {
    const float* weight = transfer.weight.data() + 3 * e;
    energies[e] = (std::abs(weight[0]) + std::abs(weight[1]) + std::abs(weight[2])) *
                  static_cast<float>(areas[transfer.column[e]]);
  }
  tbb::parallel_sort(energies.begin(), energies.end(), std::greater<>());
  const double total = std::accumulate(energies.begin(), energies.end(), 0.0);
  const auto share = [&](std::uint64_t count) {
    return static_cast<double>(count) / static_cast<double>(statistics.kernels);
  };
  statistics.nonzero_share =
      share(std::ranges::count_if(energies, [](float energy) { return energy > 0.0f; }));
  statistics.share_of_99_percent = share(count_for_share(energies, total, 0.99));
  statistics.share_of_95_percent = share(count_for_share(energies, total, 0.95));
  return statistics;
}

}  // namespace refield
