// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/error_evidence.h"

#include "core/base/linear_algebra.h"
#include "core/base/run_context.h"
#include "estimate/fit/texel_regression.h"

namespace refield {

namespace {
/// An image that determines a kernel nearly alone (h near 1) tells nothing about it: its residual grows no
/// further than twentyfold.
constexpr float least_freedom = 0.05f;

/// Prior of what a field misses, in widths of the light map. On four sets, errors relative to those under
/// natural light change by less than a fifth within lengths of 0.06 to 0.5.
constexpr double error_length = 0.125, error_independent = 0.1;
constexpr int max_grid_cells = 192;

/// The light map in about square rectangles, max_grid_cells at most.
std::vector<Box> error_grid(const LightDomain& domain) {
  int side = 1;
  const auto parts = [&](int texels) { return (texels + side - 1) / side; };
  while (static_cast<std::int64_t>(parts(domain.width)) * parts(domain.height) > max_grid_cells) ++side;
  std::vector<Box> cells;
  for (int y = 0; y < domain.height; y += side)
    for (int x = 0; x < domain.width; x += side)
      cells.push_back({x, y, std::min(x + side, domain.width), std::min(y + side, domain.height)});
  return cells;
}
}  // namespace

LightErrorModel light_error_model(const BoxTable& table, std::vector<Box> cells) {
  LightErrorModel model;
  const bool are_cells = !cells.empty();
  if (!are_cells) cells = error_grid(table.domain());
  const std::vector<CellPrior> priors =
      are_cells ? std::vector<CellPrior>(cell_priors().begin(), cell_priors().end())
                : std::vector<CellPrior>{{error_length, error_independent}};
  const auto count = static_cast<Eigen::Index>(cells.size());
  const int images = table.images();
  const std::vector<std::vector<int>> members = members_of(table.light_groups());
  const std::array<Eigen::MatrixXd, 3> lights = lights_of(table, cells);
  const Eigen::MatrixXd grey = (lights[0] + lights[1] + lights[2]) / 3.0;
  // Channels need not be equally bright, and what is left out of a channel is its colour, too.
  std::array<double, 3> brightness{};
  std::array<Eigen::MatrixXd, 3> colours;
  for (std::size_t c = 0; c < 3; ++c) {
    brightness[c] = lights[c].sum() / grey.sum();
    colours[c] = brightness[c] > 0.0 ? Eigen::MatrixXd(lights[c] / brightness[c] - grey) : 0.0 * grey;
  }
  // What an image tells of a pixel's reflectance function. The regression on cells has a weight per channel;
  // under natural light, whose colours vary together, each channel tells about as much as their mean. Of
  // rectangles, which the channels share, each channel is a sample of its own.
  std::vector<Eigen::MatrixXd> told;
  if (are_cells)
    told = {grey};
  else
    for (const Eigen::MatrixXd& colour : colours) told.emplace_back(grey + colour);
  const double mean_square_brightness =
      (brightness[0] * brightness[0] + brightness[1] * brightness[1] + brightness[2] * brightness[2]) / 3.0;
  for (const CellPrior& prior : priors) {
    // With F Fᵀ the prior covariance and L F = V diag(√v) Uᵀ, the covariance given samples with noise λ is
    // F U diag(λ / (v + λ)) Uᵀ Fᵀ.
    Eigen::MatrixXd directions = weight_covariance(prior.length, prior.independent, cells, table.domain())
                                     .llt()
                                     .matrixL()
                                     .toDenseMatrix();
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(count, count);
    for (const Eigen::MatrixXd& light : told) {
      const Eigen::MatrixXd effects = light * directions;
      gram += effects.transpose() * effects;
    }
    const auto samples = static_cast<Eigen::Index>(told.size());
    const double scale = images * static_cast<double>(samples) / gram.trace();
    const SymmetricEigen solver = symmetric_eigen(scale * gram);
    const Eigen::ArrayXd values = solver.values.array().max(0.0);
    directions *= std::sqrt(scale) * solver.vectors;
    std::vector<Eigen::MatrixXd> effects;
    for (const Eigen::MatrixXd& light : told) effects.emplace_back(light * directions);
    Eigen::ArrayXd of_colours = Eigen::ArrayXd::Zero(count);  // mean over images and channels
    if (are_cells)
      for (const Eigen::MatrixXd& colour : colours)
        of_colours += (colour * directions).colwise().squaredNorm().transpose().array() / (3.0 * images);
    const int levels = are_cells ? cell_noise_levels : static_cast<int>(light_noise_ratios.size());
    for (int level = 0; level < levels; ++level) {
      const double lambda = are_cells ? cell_noise_ratio(level) : light_noise_ratios[level];
      const Eigen::ArrayXd unknown = lambda / (values + lambda);
      // The samples of the images of one light, of covariance P given all images, have P (I − P / λ)⁻¹ given
      // the others.
      double left_out = (of_colours * unknown).sum();
      for (const std::vector<int>& images_of_light : members) {
        Eigen::MatrixXd rows(samples * std::ssize(images_of_light), count);
        for (Eigen::Index s = 0; s < samples; ++s)
          rows.middleRows(s * std::ssize(images_of_light), std::ssize(images_of_light)) =
              effects[s](images_of_light, Eigen::all);
        const Eigen::MatrixXd given = rows * unknown.matrix().asDiagonal() * rows.transpose();
        const Eigen::ArrayXd along = symmetric_eigenvalues(given).array();
        left_out += (along / (1.0 - along / lambda).max(1e-12)).sum() / static_cast<double>(samples * images);
      }
      // 1 for the training lights if each is left out.
      const double factor = 1.0 / (mean_square_brightness * left_out * table.unit() * table.unit());
      for (Eigen::Index k = 0; k < count; ++k)
        model.variances.push_back(static_cast<float>(factor * unknown(k)));
    }
    for (Eigen::Index k = 0; k < count; ++k)
      for (Eigen::Index i = 0; i < count; ++i)
        model.directions.push_back(static_cast<float>(directions(i, k)));
  }
  // Lights that determine nothing, or of a unit beyond single precision.
  const auto is_finite = [](float value) { return std::isfinite(value); };
  if (!std::ranges::all_of(model.directions, is_finite) || !std::ranges::all_of(model.variances, is_finite))
    return {};
  model.cells = std::move(cells);
  return model;
}

double share_of_cross_validation(const BoxTable& table) {
  return 1.0 - 0.5 * count_of(table.light_groups()) / table.images();
}

bool is_error_known(const BoxTable& table, const TexelRegression* texels) {
  return count_of(table.light_groups()) >= min_lights_for_errors &&
         !(texels && texels->is_of_single_lights());
}

double ErrorEvaluator::leave_one_out(const PixelKernels& kernels, KernelCache& cache,
                                     const MaskedSamples& samples, float* residuals) {
  if (kernels.is_on_cells) return texels_->of_all()->leave_one_out(kernels, samples, residuals);
  if (!kernels.leverage.empty()) return leave_images_out(kernels, samples, residuals);
  const std::size_t count = kernels.boxes.size();
  const int hats = static_cast<int>(kernels.smooth.size()) / 3;
  orthonormal_.resize(std::max(count, std::size_t{1}) * stride_);
  vector_.resize(stride_);
  pointers_.resize(count + hats + 1);
  coefficients_.resize(pointers_.size());
  std::vector<std::array<const float*, 3>> columns;
  for (const Box& box : kernels.boxes) columns.push_back(cache.column(box));
  const std::span<const float> weights = table_.image_weights();
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
    std::vector<float> left_out(stride_);
    for (std::size_t j = 0; j < stride_; ++j)
      left_out[j] = residual[j] / std::max(1.0f - leverage[j], least_freedom);
    // Columns are parallel there, so that the block of the projection is √h √hᵀ.
    for (const auto& group : repeats_) {
      float sum = 0.0f, with_residual = 0.0f;
      for (const int j : group) {
        sum += leverage[j];
        with_residual += std::sqrt(leverage[j]) * residual[j];
      }
      for (const int j : group)
        left_out[j] =
            residual[j] + std::sqrt(leverage[j]) * with_residual / std::max(1.0f - sum, least_freedom);
    }
    for (std::size_t j = 0; j < stride_; ++j) {
      float r = left_out[j];
      if (measured) r *= measured[j];
      if (j < weights.size()) r /= weights[j];
      residual[j] = r;
      squared += static_cast<double>(r) * r;
    }
  }
  return squared;
}

double ErrorEvaluator::leave_images_out(const PixelKernels& kernels, const MaskedSamples& samples,
                                        float* residuals) {
  predict(kernels);
  double squared = 0.0;
  for (const std::vector<int>& group : members_of(table_.light_groups())) {
    // Rows of one light are parallel: an image's part of the group is s² of the sum of their blocks.
    Eigen::MatrixXd block = Eigen::MatrixXd::Zero(3, 3);
    for (const int j : group)
      block += Eigen::Map<const Eigen::Matrix3f>(&kernels.leverage[9 * j]).cast<double>();
    const double trace = block.trace();
    const auto share = [&](int j) {
      const float* own = &kernels.leverage[9 * j];
      return trace > 0.0 ? std::sqrt((own[0] + own[4] + own[8]) / trace) : 0.0;
    };
    const auto residual = [&](int j, int c) {
      return static_cast<double>(samples.values[c * stride_ + j]) - predicted_[c * stride_ + j];
    };
    Eigen::Vector3d together = Eigen::Vector3d::Zero();
    for (const int j : group)
      for (int c = 0; c < 3; ++c) together[c] += share(j) * residual(j, c);
    const SymmetricEigen eigen = symmetric_eigen(0.5 * (block + block.transpose()));
    const Eigen::Array3d gain = eigen.values.array() / (1.0 - eigen.values.array()).max(least_freedom);
    const Eigen::Vector3d followed =
        eigen.vectors * (gain * (eigen.vectors.transpose() * together).array()).matrix();
    for (const int j : group)
      for (int c = 0; c < 3; ++c) {
        const double left_out = (residual(j, c) + share(j) * followed[c]) / table_.image_weights()[j];
        residuals[c * stride_ + j] = static_cast<float>(left_out);
        squared += left_out * left_out;
      }
  }
  for (int c = 0; c < 3; ++c)
    std::fill(residuals + c * stride_ + images_, residuals + (c + 1) * stride_, 0.0f);
  return squared;
}

std::optional<double> ErrorEvaluator::expected_error(const PixelKernels& kernels,
                                                     const MaskedSamples& samples) {
  if (kernels.light_class < 0) return std::nullopt;
  return texels_->of_all()->expected_error(kernels, samples);
}

ErrorEvaluator::Part::Part(const BoxTable& all, std::vector<int> seen_images, const EstimateOptions& options,
                           double mean_square, TexelRegressions* texels)
    : seen(std::move(seen_images)),
      table(all.subset(seen)),
      model(table, options, mean_square, texels ? texels->of_part(seen) : nullptr) {}

ErrorEvaluator::Part& ErrorEvaluator::part(int fold, int folds, bool alone) {
  auto& found = parts_[{fold, folds, alone ? 1 : 0}];
  if (!found) {
    const std::span<const int> group = table_.light_groups();
    std::vector<int> seen;
    for (int j = 0; j < images_; ++j)
      if ((group[j] % folds == fold) == alone) seen.push_back(j);
    found = std::make_unique<Part>(table_, std::move(seen), options_, mean_square_, texels_);
  }
  return *found;
}

std::vector<double> ErrorEvaluator::cross_validate(std::span<const PixelSamples> block, int width, int folds,
                                                   const RunContext& run,
                                                   std::span<const PixelSamples> observed) {
  folds = std::min(folds, count_of(table_.light_groups()));
  std::vector<double> squared(block.size(), 0.0);
  for (int fold = 0; fold < folds; ++fold)
    add_errors_on_unseen(part(fold, folds, false), block, observed.empty() ? block : observed, width, squared,
                         run);
  return squared;
}

std::vector<double> ErrorEvaluator::validate_folds_alone(std::span<const PixelSamples> block, int width,
                                                         int folds, const RunContext& run,
                                                         std::span<const PixelSamples> observed) {
  folds = std::min(folds, count_of(table_.light_groups()));
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
        const double error =
            (static_cast<double>(predicted_[c * stride_ + j]) - b) / table_.image_weights()[j];
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
      if (std::isnan(b)) continue;
      const double weight = table_.image_weights()[j];
      const double error = (predicted_[c * stride_ + j] - b) / weight;
      kernels.squared_residual += error * error;
      kernels.squared_samples += (b / weight) * (b / weight);
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
