// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/error_evidence.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/run_context.h"

namespace refield {

namespace {
/// An image that determines a kernel nearly alone (h near 1) tells nothing about it: its residual grows no
/// further than twentyfold.
constexpr float least_freedom = 0.05f;
}  // namespace

double ErrorEvaluator::leave_one_out(const PixelKernels& kernels, KernelCache& cache,
                                     const MaskedSamples& samples, float* residuals) {
  if (kernels.texel_prior >= 0) return texels_->of_all()->leave_one_out(kernels, samples, residuals);
  const std::size_t count = kernels.boxes.size();
  const int hats = static_cast<int>(kernels.smooth.size()) / 3;
  orthonormal_.resize(std::max(count, std::size_t{1}) * stride_);
  vector_.resize(stride_);
  pointers_.resize(count + hats + 1);
  coefficients_.resize(pointers_.size());
  std::vector<std::array<const float*, 3>> columns;
  for (const Box& box : kernels.boxes) columns.push_back(cache.column(box));
  double squared = 0.0;
  for (int c = 0; c < 3; ++c) {
    float* residual = residuals + c * stride_;
    const float* measured = samples.complete ? nullptr : samples.measured.data() + c * stride_;
    std::copy_n(samples.values.data() + c * stride_, stride_, residual);
    AlignedFloats& leverage = vector_;
    std::vector<float>& weight = coefficients_;
    for (std::size_t k = 0; k < count; ++k) {
      pointers_[k] = columns[k][c];
      weight[k] = kernels.weights[3 * k + c];
    }
    for (int h = 0; h < hats; ++h) {
      pointers_[count + h] = cache.smooth().hat_column(h, c);
      weight[count + h] = kernels.smooth[3 * h + c];
    }
    subtract_combination(residual, pointers_.data(), weight.data(), count + hats, stride_);
    std::size_t rank = 0;
    for (std::size_t k = 0; k < count; ++k) {
      if (!(kernels.weights[3 * k + c] > 0.0f)) continue;
      const float* column = columns[k][c];
      float* q = orthonormal_.data() + rank * stride_;
      if (measured)
        std::transform(column, column + stride_, measured, q, std::multiplies<>());
      else
        std::copy_n(column, stride_, q);
      for (std::size_t i = 0; i < rank; ++i) pointers_[i] = orthonormal_.data() + i * stride_;
      if (orthonormalise(q, pointers_.data(), rank, stride_, coefficients_.data()) > 0.0f) ++rank;
    }
    leverage.assign(stride_, 0.0f);
    for (std::size_t i = 0; i < rank; ++i) {
      const float* q = orthonormal_.data() + i * stride_;
      for (std::size_t j = 0; j < stride_; ++j) leverage[j] += q[j] * q[j];
    }
    for (std::size_t j = 0; j < stride_; ++j) {
      float r = residual[j] / std::max(1.0f - leverage[j], least_freedom);
      if (measured) r *= measured[j];
      residual[j] = r;
      squared += static_cast<double>(r) * r;
    }
  }
  return squared;
}

ErrorEvaluator::Part::Part(const BoxTable& all, std::vector<int> seen_images, const EstimateOptions& options,
                           TexelRegressions* texels)
    : seen(std::move(seen_images)),
      table(all.subset(seen)),
      model(table, options, texels ? texels->of_part(seen) : nullptr) {}

ErrorEvaluator::Part& ErrorEvaluator::part(int fold, int folds, bool alone) {
  auto& found = parts_[{fold, folds, alone ? 1 : 0}];
  if (!found) {
    std::vector<int> seen;
    for (int j = 0; j < images_; ++j)
      if ((j % folds == fold) == alone) seen.push_back(j);
    found = std::make_unique<Part>(table_, std::move(seen), options_, texels_);
  }
  return *found;
}

std::vector<double> ErrorEvaluator::cross_validate(std::span<const PixelSamples> block, int width, int folds,
                                                   const RunContext& run,
                                                   std::span<const PixelSamples> observed) {
  folds = std::min(folds, images_);
  std::vector<double> squared(block.size(), 0.0);
  for (int fold = 0; fold < folds; ++fold)
    add_errors_on_unseen(part(fold, folds, false), block, observed.empty() ? block : observed, width, squared,
                         run);
  return squared;
}

std::vector<double> ErrorEvaluator::validate_folds_alone(std::span<const PixelSamples> block, int width,
                                                         int folds, const RunContext& run,
                                                         std::span<const PixelSamples> observed) {
  folds = std::min(folds, images_);
  std::vector<double> squared(block.size(), 0.0);
  for (int fold = 0; fold < folds; ++fold)
    add_errors_on_unseen(part(fold, folds, true), block, observed.empty() ? block : observed, width, squared,
                         run);
  for (double& each : squared) each /= std::max(folds - 1, 1);
  return squared;
}

void ErrorEvaluator::add_errors_on_unseen(Part& part, std::span<const PixelSamples> block,
                                          std::span<const PixelSamples> observed, int width,
                                          std::vector<double>& squared, const RunContext& run) {
  run.throw_if_stopped();
  const std::size_t stride = part.table.stride();
  std::vector<char> is_seen(images_, 0);
  for (const int j : part.seen) is_seen[j] = 1;
  std::vector<AlignedFloats> values(block.size());
  std::vector<PixelSamples> seen(block.size(), PixelSamples{});
  for (std::size_t p = 0; p < block.size(); ++p) {
    if (block[p][0] == nullptr) continue;
    values[p].assign(3 * stride, 0.0f);
    for (int c = 0; c < 3; ++c) {
      float* kept = values[p].data() + c * stride;
      seen[p][c] = kept;
      for (const int j : part.seen) *kept++ = block[p][c][j];
    }
  }
  const auto fitted = part.model.fit(seen, width, {}, run);
  part.model.cache().keep_within(part_cache_bytes);
  for (std::size_t p = 0; p < block.size(); ++p) {
    if (block[p][0] == nullptr) continue;
    predict(fitted[p]);
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < images_; ++j) {
        const float b = observed[p][c][j];
        if (is_seen[j] || std::isnan(b)) continue;
        const double error = static_cast<double>(predicted_[c * stride_ + j]) - b;
        squared[p] += error * error;
      }
  }
}

void ErrorEvaluator::set_residual(const PixelSamples& observed, PixelKernels& kernels) {
  predict(kernels);
  kernels.squared_residual = kernels.squared_samples = 0.0;
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < images_; ++j) {
      const double b = observed[c][j];
      const double error = predicted_[c * stride_ + j] - b;
      kernels.squared_residual += error * error;
      kernels.squared_samples += b * b;
    }
}

void ErrorEvaluator::predict(const PixelKernels& kernels) {
  predicted_.assign(3 * stride_, 0.0f);
  column_.resize(3 * stride_);
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k) {
    table_.column(kernels.boxes[k], column_.data());
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < images_; ++j)
        predicted_[c * stride_ + j] += kernels.weights[3 * k + c] * column_[c * stride_ + j];
  }
  for (std::size_t h = 0; h < kernels.smooth.size() / 3; ++h)
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < images_; ++j)
        predicted_[c * stride_ + j] +=
            kernels.smooth[3 * h + c] * static_cast<float>(table_.hat_sums(static_cast<int>(h), c)[j]);
}

}  // namespace refield
