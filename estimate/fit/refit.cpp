// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/refit.h"

#include "core/base/run_context.h"

namespace refield {

namespace {

/// Gram matrix of the columns of one channel; `first` yields the i-th column as the left factor (perhaps
/// masked).
template <class LeftColumn>
void fill_gram(const std::vector<const float*>& columns, std::size_t stride, LeftColumn left,
               std::vector<double>& gram) {
  const std::size_t count = columns.size();
  std::vector<float> products(count);
  gram.resize(count * count);
  for (std::size_t i = 0; i < count; ++i) {
    const float* masked = left(i);
    dots(masked, columns.data(), i + 1, stride, products.data());
    if (masked != columns[i] && !is_seen(products[i], columns[i], stride)) products[i] = 0.0f;
    for (std::size_t k = 0; k <= i; ++k) gram[i * count + k] = gram[k * count + i] = products[k];
  }
}

}  // namespace

KernelSet prepare_kernel_set(std::span<const Box> boxes, KernelCache& cache) {
  KernelSet set;
  set.boxes.assign(boxes.begin(), boxes.end());
  for (int c = 0; c < 3; ++c) {
    auto& columns = set.columns[c];
    for (const Box& box : boxes) columns.push_back(cache.column(box, c));
    fill_gram(
        columns, cache.table().stride(), [&](std::size_t i) { return columns[i]; }, set.gram[c]);
  }
  return set;
}

const double* WeightFitter::masked_gram(const KernelSet& set, const MaskedSamples& samples, int channel) {
  if (samples.complete) return set.gram[channel].data();
  scratch_.resize(stride_);
  const float* measured = samples.measured.data() + channel * stride_;
  fill_gram(
      pointers_, stride_,
      [&](std::size_t i) {
        std::transform(pointers_[i], pointers_[i] + stride_, measured, scratch_.data(), std::multiplies<>());
        return scratch_.data();
      },
      gram_);
  return gram_.data();
}

double WeightFitter::try_set(const KernelSet& set, const MaskedSamples& samples, std::span<const float> start,
                             double give_up_above) {
  const std::size_t count = set.boxes.size();
  products_.resize(count);
  h_.resize(count);
  x_.resize(count);
  weights_.assign(3 * count, 0.0);
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    pointers_ = set.columns[c];
    dots(samples.values.data() + c * stride_, pointers_.data(), count, stride_, products_.data());
    for (std::size_t k = 0; k < count; ++k) {
      h_[k] = products_[k];
      x_[k] = start[3 * k + c];
    }
    const double* G = masked_gram(set, samples, c);
    nnls_.solve(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data());
    residual += squared_residual(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data(),
                                 samples.squared[c]);
    if (residual >= give_up_above) return residual;
    for (std::size_t k = 0; k < count; ++k) weights_[3 * k + c] = x_[k];
  }
  return residual;
}

PixelKernels WeightFitter::fit(const KernelSet& set, const MaskedSamples& samples,
                               std::span<const float> start) {
  try_set(set, samples, start, std::numeric_limits<double>::infinity());
  const std::size_t count = set.boxes.size();
  AlignedFloats residual(stride_);
  std::vector<float> minus(count);
  PixelKernels kernels;
  for (int c = 0; c < 3; ++c) {
    pointers_ = set.columns[c];
    const double* G = masked_gram(set, samples, c);
    const auto compute_residual = [&] {
      std::copy_n(samples.values.data() + c * stride_, stride_, residual.data());
      for (std::size_t k = 0; k < count; ++k) minus[k] = static_cast<float>(weights_[3 * k + c]);
      subtract_combination(residual.data(), pointers_.data(), minus.data(), count, stride_);
      if (!samples.complete)
        std::transform(residual.begin(), residual.end(), samples.measured.data() + c * stride_,
                       residual.begin(), std::multiplies<>());
    };
    compute_residual();
    dots(residual.data(), pointers_.data(), count, stride_, products_.data());
    for (std::size_t k = 0; k < count; ++k) x_[k] = minus[k];
    for (std::size_t k = 0; k < count; ++k) {
      h_[k] = products_[k];
      for (std::size_t l = 0; l < count; ++l) h_[k] += G[k * count + l] * x_[l];
    }
    nnls_.solve(G, static_cast<int>(count), h_.data(), static_cast<int>(count), x_.data());
    for (std::size_t k = 0; k < count; ++k) weights_[3 * k + c] = x_[k];
    compute_residual();
    for (int j = 0; j < images_; ++j)
      kernels.squared_residual += static_cast<double>(residual[j]) * residual[j];
    kernels.squared_samples += samples.squared[c];
  }
  for (std::size_t k = 0; k < count; ++k) {
    const double* w = weights_.data() + 3 * k;
    if (w[0] <= 0.0 && w[1] <= 0.0 && w[2] <= 0.0) continue;
    kernels.boxes.push_back(set.boxes[k]);
    for (int c = 0; c < 3; ++c) kernels.weights.push_back(static_cast<float>(w[c]));
  }
  return kernels;
}

namespace {

/// A neighbour's set must be better by more than the rounding of the two residuals, which come from float32
/// Gram matrices: as a share of the squared samples.
constexpr double clear_gain = 2e-7;

}  // namespace

std::vector<PixelKernels> correct_tile(const PixelAccess& grid, const PixelTile& tile, KernelCache& cache,
                                       WeightFitter& fitter, const RunContext& run) {
  const PixelTile reach = {std::max(tile.x0 - 1, 0), std::max(tile.y0 - 1, grid.first_row),
                           std::min(tile.x1 + 1, grid.width), std::min(tile.y1 + 1, grid.last_row)};
  const int reach_width = reach.x1 - reach.x0;
  std::vector<KernelSet> sets(static_cast<std::size_t>(reach_width) * (reach.y1 - reach.y0));
  const auto set_at = [&](int x, int y) -> KernelSet& {
    return sets[static_cast<std::size_t>(y - reach.y0) * reach_width + (x - reach.x0)];
  };
  for (int y = reach.y0; y < reach.y1; ++y)
    for (int x = reach.x0; x < reach.x1; ++x)
      if (grid.active(x, y)) set_at(x, y) = prepare_kernel_set(grid.kernels(x, y).boxes, cache);

  std::vector<PixelKernels> corrected;
  MaskedSamples samples;
  PixelKernels trial;
  for (int y = tile.y0; y < tile.y1; ++y) {
    run.throw_if_stopped();
    for (int x = tile.x0; x < tile.x1; ++x) {
      corrected.emplace_back();
      if (!grid.active(x, y)) continue;
      PixelKernels& best = corrected.back();
      best = grid.kernels(x, y);
      samples.assign(grid.samples(x, y), cache.table().stride(), cache.table().images());
      const std::vector<Box>& own_boxes = grid.kernels(x, y).boxes;
      for (int ny = std::max(y - 1, reach.y0); ny < std::min(y + 2, reach.y1); ++ny)
        for (int nx = std::max(x - 1, reach.x0); nx < std::min(x + 2, reach.x1); ++nx) {
          if ((nx == x && ny == y) || !grid.active(nx, ny)) continue;
          const KernelSet& set = set_at(nx, ny);
          if (set.boxes.empty() || set.boxes == own_boxes) continue;
          const double give_up_above = best.squared_residual - clear_gain * samples.squared_sum();
          trial.squared_residual = fitter.try_set(set, samples, grid.kernels(nx, ny).weights, give_up_above);
          if (trial.squared_residual >= give_up_above) continue;
          trial.weights.assign(fitter.weights().begin(), fitter.weights().end());
          best.boxes = set.boxes;
          best.weights = trial.weights;
          best.squared_residual = trial.squared_residual;
        }
    }
  }
  return corrected;
}

}  // namespace refield
