// SPDX-License-Identifier: Apache-2.0
#include "core/field_statistics.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

namespace refield {

namespace {

/// The number of leading values that reach `share` of the total. `energies` fall.
std::uint64_t count_for_share(const std::vector<float>& energies, double total, double share) {
  double sum = 0.0;
  std::uint64_t count = 0;
  while (count < energies.size() && sum < share * total) sum += energies[count++];
  return count;
}

}  // namespace

KernelStatistics kernel_statistics(const ReflectanceField& field, int kernels_a_pixel) {
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
  statistics.kernels = statistics.pixels * std::max<std::uint64_t>(most, std::max(kernels_a_pixel, 0));
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
