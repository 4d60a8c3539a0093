// SPDX-License-Identifier: Apache-2.0
#include "core/field/field_statistics.h"

#include <bit>
#include <cmath>
#include <numeric>

namespace refield {

namespace {

void require_pixel(std::size_t pixel, std::size_t pixels) {
  if (pixel >= pixels) throw InputError("the field has ", pixels, " pixels; there is no pixel ", pixel);
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

/// How many energies there are of each size, and their sums, in steps of 0.05 %: a field may have more of
/// them than memory holds.
class EnergyHistogram {
 public:
  void add(float energy) {
    Step& step = steps_[std::bit_cast<std::uint32_t>(energy) >> bits_within_a_step];
    ++step.count;
    step.sum += energy;
  }
  double total() const {
    return std::accumulate(steps_.begin(), steps_.end(), 0.0,
                           [](double sum, const Step& step) { return sum + step.sum; });
  }
  /// How many of the largest reach `share` of the total; within a step all count as equal.
  std::uint64_t count_for_share(double share) const {
    const double target = share * total();
    double sum = 0.0;
    std::uint64_t count = 0;
    for (auto step = steps_.rbegin(); step != steps_.rend() && sum < target; ++step) {
      if (step->count == 0) continue;
      const double each = step->sum / static_cast<double>(step->count);
      const double needed = each > 0.0 ? std::ceil((target - sum) / each) : 0.0;
      count += std::min(step->count, static_cast<std::uint64_t>(std::max(needed, 0.0)));
      sum += step->sum;
    }
    return count;
  }

 private:
  // Floats that are not negative rise with their bits. The sign is left out.
  static constexpr int bits_within_a_step = 12;
  struct Step {
    std::uint64_t count = 0;
    double sum = 0.0;
  };
  std::vector<Step> steps_ = std::vector<Step>(std::size_t{1} << (31 - bits_within_a_step));
};

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
  const std::uint64_t max_kernels = statistics.histogram.size() - 1;
  statistics.kernels =
      statistics.pixels * std::max<std::uint64_t>(max_kernels, std::max(kernels_per_pixel, 0));
  statistics.mean_stored = static_cast<double>(statistics.stored) / static_cast<double>(statistics.pixels);

  std::vector<double> areas(field.basis.size());
  for (std::size_t k = 0; k < areas.size(); ++k) areas[k] = field.basis.area(k);
  EnergyHistogram energies;
  std::uint64_t nonzero = 0;
  for (std::size_t row = 0; row < transfer.rows(); ++row) {
    for (auto e = transfer.row_start[row]; e < transfer.row_start[row + 1]; ++e) {
      const float* weight = transfer.weight.data() + 3 * e;
      const float energy = (std::abs(weight[0]) + std::abs(weight[1]) + std::abs(weight[2])) *
                           static_cast<float>(areas[transfer.column[e]]);
      nonzero += energy > 0.0f ? 1 : 0;
      energies.add(energy);
    }
    constexpr std::size_t stretch = 1 << 18;
    if ((row + 1) % stretch == 0) transfer.pass_by_rows(row + 1 - stretch, row + 1);
  }
  const auto share = [&](std::uint64_t count) {
    return static_cast<double>(count) / static_cast<double>(statistics.kernels);
  };
  statistics.nonzero_share = share(nonzero);
  statistics.share_of_99_percent = share(energies.count_for_share(0.99));
  statistics.share_of_95_percent = share(energies.count_for_share(0.95));
  return statistics;
}

}  // namespace refield
