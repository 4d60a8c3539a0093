// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/gap_filling.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "estimate/fit/select_kernels.h"

namespace refield {

namespace {
/// How samples that were not measured are estimated.
EstimateOptions gap_options() {
  EstimateOptions options;
  options.mode = EstimateMode::refined;
  options.kernels = 12;
  return options;
}

/// The rectangle that brings least light.
std::size_t dimmest(const PixelKernels& kernels) {
  std::size_t least = 0;
  double least_light = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k) {
    const float* w = kernels.weights.data() + 3 * k;
    const double light = static_cast<double>(kernels.boxes[k].area()) * (w[0] + w[1] + w[2]);
    if (light < least_light) {
      least_light = light;
      least = k;
    }
  }
  return least;
}
}  // namespace

GapFiller::GapFiller(KernelCache& cache)
    : cache_(cache), smooth_(cache.smooth()), fitter_(cache, gap_options()) {}

std::vector<Box> GapFiller::estimate(const PixelSamples& pixel, const MaskedSamples& samples,
                                     AlignedFloats& values) {
  const std::size_t stride = smooth_.stride();
  const PixelKernels guess = fitter_.fit(pixel);
  AlignedFloats estimated(3 * stride, 0.0f);
  for (int c = 0; c < 3; ++c)
    for (std::size_t k = 0; k < guess.boxes.size(); ++k) {
      const float* column = cache_.column(guess.boxes[k], c);
      const float minus_weight = -guess.weights[3 * k + c];
      subtract_combination(estimated.data() + c * stride, &column, &minus_weight, 1, stride);
    }
  fill_in(samples, estimated, values);
  return guess.boxes;
}

void GapFiller::fill_in(const MaskedSamples& samples, const AlignedFloats& predicted,
                        AlignedFloats& values) const {
  const std::size_t stride = smooth_.stride();
  const int images = cache_.table().images();
  for (int c = 0; c < 3; ++c) {
    float* b = values.data() + c * smooth_.extent();
    for (int j = 0; j < images; ++j)
      if (samples.measured[c * stride + j] == 0.0f) b[j] = predicted[c * stride + j];
    smooth_.extend(b, c);
  }
}

GapFiller::Pruned GapFiller::prune(const std::vector<Box>& all, int found_class, const MaskedSamples& samples,
                                   double search_penalty, const std::array<double, 3>& noise_kept,
                                   WeightedFit& weighted) const {
  const double squared = samples.squared_sum();
  const int measured = samples.count_sum();
  Pruned best;
  best.criterion = std::numeric_limits<double>::infinity();
  for (const int smooth_class : {found_class, smooth_.class_without()}) {
    if (smooth_class == found_class && best.criterion < std::numeric_limits<double>::infinity()) break;
    std::vector<Box> boxes = all;
    while (true) {
      PixelKernels kernels = weighted.fit(boxes, smooth_class, samples, noise_kept);
      const auto parameters = std::ranges::count_if(kernels.weights, [](float w) { return w > 0.0f; });
      const double criterion =
          information_criterion(kernels.squared_residual, squared, measured, static_cast<int>(parameters)) +
          search_penalty * static_cast<double>(kernels.boxes.size()) +
          smooth_.classes()[smooth_class].log_determinant;
      boxes = kernels.boxes;
      const std::size_t least = dimmest(kernels);
      if (criterion < best.criterion) best = {std::move(kernels), smooth_class, criterion};
      if (boxes.empty()) break;
      boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(least));
    }
  }
  return best;
}

}  // namespace refield
