// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/weighted_fit.h"

#include "estimate/fit/select_kernels.h"

namespace refield {

WeightedFit::WeightedFit(const BoxTable& table, const SmoothSpace& smooth)
    : table_(table),
      smooth_(smooth),
      stride_(table.stride()),
      fit_(3 * stride_),
      residual_(3 * stride_),
      masked_(stride_) {}

PixelKernels WeightedFit::fit(std::span<const Box> boxes, int smooth_class, const MaskedSamples& samples,
                              const std::array<double, 3>& noise_kept) {
  const SmoothClass& smooth = smooth_.classes()[smooth_class];
  const int hats = smooth.smooth ? smooth_.hats() : 0;
  const int count = static_cast<int>(boxes.size());
  const int size = hats + count;
  columns_.resize(count * 3 * stride_);
  for (int i = 0; i < count; ++i) table_.column(boxes[i], columns_.data() + i * 3 * stride_);
  gram_.resize(static_cast<std::size_t>(size) * size);
  h_.resize(size);
  pointers_.resize(size);
  products_.resize(size);
  PixelKernels kernels;
  std::vector<float> weights(static_cast<std::size_t>(size) * 3);
  for (int c = 0; c < 3; ++c) {
    for (int i = 0; i < hats; ++i) pointers_[i] = smooth_.hat_column(i, c);
    for (int i = 0; i < count; ++i) pointers_[hats + i] = columns_.data() + (i * 3 + c) * stride_;
    for (int i = 0; i < size; ++i) {
      const float* left = pointers_[i];
      if (!samples.complete) {
        std::transform(left, left + stride_, samples.measured.data() + c * stride_, masked_.data(),
                       std::multiplies<>());
        left = masked_.data();
      }
      dots(left, pointers_.data(), i + 1, stride_, products_.data());
      if (left != pointers_[i] && !is_seen(products_[i], pointers_[i], stride_)) products_[i] = 0.0f;
      for (int k = 0; k <= i; ++k) gram_[i * size + k] = gram_[k * size + i] = products_[k];
    }
    for (int i = 0; i < hats; ++i)
      for (int k = 0; k < hats; ++k) gram_[i * size + k] += noise_kept[c] * smooth.penalty[c][i * hats + k];
    float* r = residual_.data() + c * stride_;
    std::copy_n(samples.values.data() + c * stride_, stride_, r);
    dots(r, pointers_.data(), size, stride_, products_.data());
    h_.assign(products_.begin(), products_.begin() + size);
    x_.assign(size, 1.0);
    nnls_.solve(gram_.data(), size, h_.data(), size, x_.data());
    for (int i = 0; i < size; ++i) weights[3 * i + c] = products_[i] = static_cast<float>(x_[i]);
    subtract_combination(r, pointers_.data(), products_.data(), size, stride_);
    std::transform(samples.values.data() + c * stride_, samples.values.data() + (c + 1) * stride_, r,
                   fit_.data() + c * stride_, std::minus<>());
    for (std::size_t j = 0; j < stride_; ++j) {
      if (!samples.complete) r[j] *= samples.measured[c * stride_ + j];
      kernels.squared_residual += static_cast<double>(r[j]) * r[j];
    }
    kernels.squared_samples += samples.squared[c];
  }
  kernels.smooth.assign(weights.begin(), weights.begin() + 3 * hats);
  for (int i = 0; i < count; ++i) {
    const float* w = weights.data() + 3 * (hats + i);
    if (w[0] <= 0.0f && w[1] <= 0.0f && w[2] <= 0.0f) continue;
    kernels.boxes.push_back(boxes[i]);
    kernels.weights.insert(kernels.weights.end(), w, w + 3);
  }
  return kernels;
}

double criterion_of(const PixelKernels& kernels, int measured, double search_penalty) {
  const auto parameters = std::ranges::count_if(kernels.weights, [](float w) { return w > 0.0f; });
  return information_criterion(kernels.squared_residual, kernels.squared_samples, measured,
                               static_cast<int>(parameters)) +
         search_penalty * static_cast<double>(kernels.boxes.size());
}

namespace {

/// Coarse steps end at this part of a rectangle's longer side.
constexpr int coarse_parts = 24;

/// A rectangle with a non-negative weight per channel, and the squared part of the target that it explains.
struct Explained {
  std::array<float, 3> weight{};
  std::array<double, 3> part{};

  double sum() const { return part[0] + part[1] + part[2]; }
  void set(const BoxTable& table, const Box& box, int c, const AlignedFloats& target) {
    float with_target = 0.0f, squared = 0.0f;
    table.products(box, c, target.data() + c * table.stride(), with_target, squared);
    weight[c] = squared > 0.0f ? std::max(with_target / squared, 0.0f) : 0.0f;
    part[c] = static_cast<double>(weight[c]) * with_target;
  }
};

/// The eight ways to move one edge of a rectangle by a step.
constexpr int edge_moves = 8;

struct EdgeMove {
  Box box;
  std::array<std::array<int, 2>, 2> new_corners;  // x, y
  bool is_valid;
};

EdgeMove move_edge(const Box& box, int move, int step, const LightDomain& domain) {
  EdgeMove result{box, {}, false};
  Box& moved = result.box;
  const int edge = move / 2;
  (edge == 0   ? moved.x0
   : edge == 1 ? moved.x1
   : edge == 2 ? moved.y0
               : moved.y1) += move % 2 == 0 ? -step : step;
  const int x = edge == 1 ? moved.x1 : moved.x0, y = edge == 3 ? moved.y1 : moved.y0;
  result.new_corners = {{{x, y}, edge < 2 ? std::array{x, moved.y1} : std::array{moved.x1, y}}};
  result.is_valid = moved.x0 >= 0 && moved.y0 >= 0 && moved.x1 <= domain.width && moved.y1 <= domain.height &&
                    moved.x0 < moved.x1 && moved.y0 < moved.y1;
  return result;
}

}  // namespace

std::vector<Box> refine_edges(const BoxTable& table, const PixelKernels& kernels,
                              const AlignedFloats& residual, EdgeSteps steps) {
  const bool coarse = steps == EdgeSteps::coarse;
  const int sweeps = coarse ? 1 : 2;
  const std::size_t stride = table.stride();
  std::vector<Box> boxes = kernels.boxes;
  std::vector<float> weights = kernels.weights;
  AlignedFloats rest = residual, column(3 * stride);
  const auto add = [&](const Box& box, const float* w, float sign) {
    table.column(box, column.data());
    for (int c = 0; c < 3; ++c) {
      const float factor = -sign * w[c];
      const float* one = column.data() + c * stride;
      subtract_combination(rest.data() + c * stride, &one, &factor, 1, stride);
    }
  };
  for (int sweep = 0; sweep < sweeps; ++sweep)
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      Box& box = boxes[k];
      add(box, &weights[3 * k], 1.0f);
      Explained best;
      for (int c = 0; c < 3; ++c) best.set(table, box, c, rest);
      // Coarse steps: the channel in which the rectangle explains most decides first. Reading the table is
      // what costs, and most moves end there.
      const int lead = static_cast<int>(std::ranges::max_element(best.part) - best.part.begin());
      const int side = std::max(box.x1 - box.x0, box.y1 - box.y0);
      const int finest = coarse ? std::max(side / coarse_parts, 1) : 1;
      for (int step = std::max(side / 3, 1); step >= finest; step /= 2)
        for (int move = 0; move < edge_moves; ++move) {
          if (move + 1 < edge_moves)
            if (const EdgeMove next = move_edge(box, move + 1, step, table.domain()); next.is_valid)
              for (const auto& [x, y] : next.new_corners)
                table.prefetch(x, y, coarse ? lead : 0, coarse ? lead + 1 : 3);
          const EdgeMove moved = move_edge(box, move, step, table.domain());
          if (!moved.is_valid) continue;
          Explained trial;
          trial.set(table, moved.box, lead, rest);
          if (coarse && trial.part[lead] <= best.part[lead]) continue;
          for (int c = 0; c < 3; ++c)
            if (c != lead) trial.set(table, moved.box, c, rest);
          if (trial.sum() <= best.sum()) continue;
          best = trial;
          box = moved.box;
        }
      std::ranges::copy(best.weight, weights.begin() + 3 * k);
      add(box, best.weight.data(), -1.0f);
    }
  return boxes;
}

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
  std::size_t dimmest_box = 0;
  double least_light = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k) {
    const float* w = kernels.weights.data() + 3 * k;
    const double light = static_cast<double>(kernels.boxes[k].area()) * (w[0] + w[1] + w[2]);
    if (light < least_light) {
      least_light = light;
      dimmest_box = k;
    }
  }
  return dimmest_box;
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
  Pruned best;
  best.criterion = std::numeric_limits<double>::infinity();
  for (const int smooth_class : {found_class, smooth_.class_without()}) {
    if (smooth_class == found_class && best.criterion < std::numeric_limits<double>::infinity()) break;
    std::vector<Box> boxes = all;
    while (true) {
      PixelKernels kernels = weighted.fit(boxes, smooth_class, samples, noise_kept);
      const double criterion = criterion_of(kernels, samples.count_sum(), search_penalty) +
                               smooth_.classes()[smooth_class].log_determinant;
      boxes = kernels.boxes;
      const std::size_t dimmest_box = dimmest(kernels);
      if (criterion < best.criterion) best = {std::move(kernels), smooth_class, criterion};
      if (boxes.empty()) break;
      boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(dimmest_box));
    }
  }
  return best;
}

}  // namespace refield
