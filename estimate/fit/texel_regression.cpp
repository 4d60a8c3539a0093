// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/texel_regression.h"

#include <cmath>
#include <numbers>

#include "core/base/linear_algebra.h"
#include "core/light/cube_map.h"
#include "core/light/light_map.h"
#include "estimate/fit/nnls.h"

namespace refield {

namespace {

constexpr std::array<CellPrior, 8> priors = {{{1.0, 1.0},
                                              {0.125, 0.3},
                                              {0.125, 0.003},
                                              {0.5, 0.1},
                                              {0.5, 0.003},
                                              {2.0, 0.03},
                                              {2.0, 0.003},
                                              {2.0, 0.0003}}};

/// Lights whose Gram matrix, of unit lights, has eigenvalues within this factor do not tell noise from
/// detail.
constexpr double nearly_orthogonal = 100.0;
/// Any prior gives the same weights where the lights determine them.
constexpr int independent_prior = 0;
/// Samples that are filled in, so that incomplete pixels can choose a prior, come from this one.
constexpr int usual_prior = 4;
constexpr int usual_noise = 8;
/// Penalty of a rectangle: see "Selection of rectangles" in docs/method/estimation.md.
constexpr double rectangle_penalty = 17.0;
/// Covariances of weights that are kept, of each regression.
constexpr std::size_t max_posterior_bytes = 64 << 20;
/// Residuals below this part of the samples, squared, are rounding.
constexpr double rounding = 1e-13;

Eigen::Vector3d place_of(const Box& cell, const LightDomain& domain) {
  const double x = 0.5 * (cell.x0 + cell.x1), y = 0.5 * (cell.y0 + cell.y1);
  switch (domain.parameterisation) {
    case Parameterisation::lat_long:
      return 0.5 * lat_long_direction(x, y, domain.width, domain.height);
    case Parameterisation::cube:
      return 0.5 * cube_direction(x, y, domain.width);
    case Parameterisation::monitor:
      break;
  }
  return {x / domain.width, y / domain.width, 0.0};
}

/// Most probable weights without negative ones, from the unconstrained ones and their covariance S: those
/// that are held at zero move the others by their multipliers ν ≥ 0, w = μ + S ν. Block principal pivoting
/// (Júdice and Pires 1994), which seldom takes more than three steps where few weights are negative. None
/// where it goes round in circles, as it does where few lights leave most weights at zero.
std::optional<Eigen::VectorXd> without_negative(const Eigen::VectorXd& mean,
                                                const Eigen::MatrixXd& covariance) {
  constexpr int max_steps = 20;
  const double tolerance = 1e-9 * mean.cwiseAbs().maxCoeff();
  std::vector<char> held(static_cast<std::size_t>(mean.size()), 0);
  for (Eigen::Index k = 0; k < mean.size(); ++k) held[k] = mean(k) < 0.0;
  Eigen::VectorXd weights = mean;
  for (int step = 0; step < max_steps; ++step) {
    std::vector<Eigen::Index> zeros;
    for (Eigen::Index k = 0; k < mean.size(); ++k)
      if (held[k]) zeros.push_back(k);
    if (zeros.empty()) return weights.cwiseMax(0.0);
    const Eigen::VectorXd multipliers = covariance(zeros, zeros).llt().solve(-mean(zeros));
    weights = mean + covariance(Eigen::all, zeros) * multipliers;
    weights(zeros).setZero();
    bool changed = false;
    for (std::size_t i = 0; i < zeros.size(); ++i)
      if (multipliers(static_cast<Eigen::Index>(i)) < 0.0) {
        held[zeros[i]] = 0;
        changed = true;
      }
    for (Eigen::Index k = 0; k < mean.size(); ++k)
      if (!held[k] && weights(k) < -tolerance) {
        held[k] = 1;
        changed = true;
      }
    if (!changed) return weights.cwiseMax(0.0);
  }
  return std::nullopt;
}

bool are_nearly_orthogonal(const std::array<Eigen::MatrixXd, 3>& lights) {
  return std::ranges::all_of(lights, [](const Eigen::MatrixXd& channel) {
    if (channel.rows() > channel.cols()) return false;
    // Lights are scaled to one length: how bright each is does not matter, and radiance of equal irradiance
    // differs by more than the factor where one source is near a pole of a lat-long map.
    const Eigen::MatrixXd scaled = channel.rowwise().normalized();
    const Eigen::MatrixXd gram = scaled * scaled.transpose();
    const Eigen::VectorXd values = symmetric_eigenvalues(gram);
    return values.minCoeff() * nearly_orthogonal > values.maxCoeff();
  });
}

/// Weights of one channel, [cells]; `kernels` has those cells that have a weight, in their order.
Eigen::VectorXd weights_on_cells(const PixelKernels& kernels, std::span<const Box> cells, int channel) {
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(cells.size()));
  std::size_t cell = 0;
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k) {
    while (cells[cell] != kernels.boxes[k]) ++cell;
    weights(static_cast<Eigen::Index>(cell)) = kernels.weights[3 * k + channel];
  }
  return weights;
}

std::vector<int> measured_in(const float* samples, int images) {
  std::vector<int> measured;
  for (int j = 0; j < images; ++j)
    if (!std::isnan(samples[j])) measured.push_back(j);
  return measured;
}

}  // namespace

std::span<const CellPrior> cell_priors() {
  return priors;
}

double cell_noise_ratio(int level) {
  return std::pow(10.0, -9.0 + 0.5 * level);
}

std::array<Eigen::MatrixXd, 3> lights_of(const BoxTable& table, std::span<const Box> cells) {
  std::array<Eigen::MatrixXd, 3> lights;
  for (Eigen::MatrixXd& channel : lights)
    channel.resize(table.images(), static_cast<Eigen::Index>(cells.size()));
  AlignedFloats column(3 * table.stride());
  for (std::size_t k = 0; k < cells.size(); ++k) {
    table.column(cells[k], column.data());
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < table.images(); ++j)
        lights[c](j, static_cast<Eigen::Index>(k)) = column[c * table.stride() + j];
  }
  return lights;
}

Eigen::MatrixXd weight_covariance(double length, double independent, std::span<const Box> cells,
                                  const LightDomain& domain) {
  const auto count = static_cast<Eigen::Index>(cells.size());
  Eigen::MatrixXd covariance(count, count);
  for (Eigen::Index i = 0; i < count; ++i)
    for (Eigen::Index j = 0; j < count; ++j) {
      const double distance = (place_of(cells[i], domain) - place_of(cells[j], domain)).norm();
      const double t = std::numbers::sqrt3 * distance / length;
      covariance(i, j) = (1.0 - independent) * (1.0 + t) * std::exp(-t) + (i == j ? independent : 0.0);
    }
  return covariance;
}

std::vector<Box> light_cells(const BoxTable& table) {
  const LightDomain& domain = table.domain();
  const std::size_t length = 3 * table.stride();
  AlignedFloats totals(length), first(length), other(length);
  table.column({0, 0, domain.width, domain.height}, totals.data());
  // Differences of a summed-area table in double carry this much rounding.
  constexpr float unlit = 1e-10f, equal = 1e-6f;
  const auto is_lit = [&](const AlignedFloats& column) {
    for (std::size_t i = 0; i < length; ++i)
      if (column[i] > unlit * totals[i]) return true;
    return false;
  };
  std::vector<char> visited(static_cast<std::size_t>(domain.width) * domain.height, 0);
  const auto at = [&](int x, int y) -> char& {
    return visited[static_cast<std::size_t>(y) * domain.width + x];
  };
  const auto matches = [&](int x, int y) {
    if (at(x, y)) return false;
    table.column({x, y, x + 1, y + 1}, other.data());
    for (std::size_t i = 0; i < length; ++i)
      if (std::abs(other[i] - first[i]) > equal * std::abs(first[i]) + unlit * totals[i]) return false;
    return true;
  };
  std::vector<Box> cells;
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x) {
      if (at(x, y)) continue;
      table.column({x, y, x + 1, y + 1}, first.data());
      if (!is_lit(first)) continue;
      Box cell{x, y, x + 1, y + 1};
      while (cell.x1 < domain.width && matches(cell.x1, y)) ++cell.x1;
      const auto row_matches = [&](int row) {
        for (int column = cell.x0; column < cell.x1; ++column)
          if (!matches(column, row)) return false;
        return true;
      };
      while (cell.y1 < domain.height && row_matches(cell.y1)) ++cell.y1;
      for (int row = cell.y0; row < cell.y1; ++row)
        for (int column = cell.x0; column < cell.x1; ++column) at(column, row) = 1;
      cells.push_back(cell);
      if (cells.size() > max_single_light_cells) return {};
    }
  return cells.size() < 2 ? std::vector<Box>{} : cells;
}

TexelRegression::TexelRegression(const BoxTable& table, std::span<const Box> cells)
    : table_(&table),
      cells_(cells.begin(), cells.end()),
      images_(table.images()),
      repeats_(repeats_in(table.light_groups())) {
  const auto count = static_cast<Eigen::Index>(cells.size());
  lights_ = lights_of(table, cells);
  is_grey_ = lights_[1] == lights_[0] && lights_[2] == lights_[0];
  const int channels = is_grey_ ? 1 : 3;
  noise_levels_ = are_nearly_orthogonal(lights_) ? 1 : cell_noise_levels;
  is_of_single_lights_ = is_interpolating();
  if (!repeats_.empty()) {
    std::vector<int> first(count_of(table.light_groups()), images_);
    for (int j = 0; j < images_; ++j)
      first[table.light_groups()[j]] = std::min(first[table.light_groups()[j]], j);
    std::array<Eigen::MatrixXd, 3> differing;
    for (std::size_t c = 0; c < 3; ++c) differing[c] = lights_[c](first, Eigen::all);
    is_of_single_lights_ = are_nearly_orthogonal(differing);
  }
  spectra_.resize(3 * priors.size());
  for (std::size_t p = 0; p < priors.size(); ++p) {
    covariances_.push_back(weight_covariance(priors[p].length, priors[p].independent, cells, table.domain()));
    for (int c = 0; c < channels; ++c) {
      Spectrum& spectrum = spectra_[3 * p + c];
      if (images_ <= count) {
        Eigen::MatrixXd samples = lights_[c] * covariances_[p] * lights_[c].transpose();
        const double trace = samples.trace();
        spectrum.scale = trace > 0.0 ? images_ / trace : 1.0;
        const SymmetricEigen solver = symmetric_eigen(spectrum.scale * samples);
        spectrum.values = solver.values.cwiseMax(0.0);
        spectrum.vectors = solver.vectors;
      } else {
        // F = L C^½ has the same left singular vectors, and fewer columns.
        const Eigen::MatrixXd factor = lights_[c] * covariances_[p].llt().matrixL().toDenseMatrix();
        const double trace = factor.squaredNorm();
        spectrum.scale = trace > 0.0 ? images_ / trace : 1.0;
        const SymmetricEigen solver = symmetric_eigen(spectrum.scale * factor.transpose() * factor);
        // Directions that the lights do not tell apart are left to the rest, which has no signal.
        const double min_value = 1e-12 * solver.values.maxCoeff();
        const Eigen::Index rank = (solver.values.array() > min_value).count();
        spectrum.values = solver.values.tail(rank);
        spectrum.vectors = std::sqrt(spectrum.scale) * factor * solver.vectors.rightCols(rank) *
                           spectrum.values.cwiseSqrt().cwiseInverse().asDiagonal();
      }
      if (p == independent_prior && is_interpolating() && images_ == count)
        determined_[c] = spectrum.scale * covariances_[p] * lights_[c].transpose() * spectrum.vectors *
                         (spectrum.values.array() + cell_noise_ratio(0)).inverse().matrix().asDiagonal() *
                         spectrum.vectors.transpose();
      for (int level = 0; level < noise_levels_; ++level)
        spectrum.log_determinant[level] =
            (spectrum.values.array() + cell_noise_ratio(level)).log().sum() +
            static_cast<double>(images_ - spectrum.values.size()) * std::log(cell_noise_ratio(level));
    }
  }
}

Eigen::VectorXd TexelRegression::weights_of(int prior, int channel, const Eigen::VectorXd& dual) const {
  return spectrum(prior, channel).scale * (covariances_[prior] * (lights_[channel].transpose() * dual));
}

TexelRegression::Gap TexelRegression::gap_of(int prior, int noise, int channel,
                                             const std::vector<int>& measured) const {
  Gap gap;
  auto next = measured.begin();
  for (int j = 0; j < images_; ++j)
    if (next != measured.end() && *next == j)
      ++next;
    else
      gap.unmeasured.push_back(j);
  Eigen::MatrixXd units = Eigen::MatrixXd::Zero(images_, static_cast<Eigen::Index>(gap.unmeasured.size()));
  for (std::size_t i = 0; i < gap.unmeasured.size(); ++i)
    units(gap.unmeasured[i], static_cast<Eigen::Index>(i)) = 1.0;
  const Spectrum& own = spectrum(prior, channel);
  const double lambda = cell_noise_ratio(noise);
  const Eigen::MatrixXd rows = own.vectors(gap.unmeasured, Eigen::all).transpose();
  gap.columns = own.vectors * ((own.values.array() + lambda).inverse().matrix().asDiagonal() * rows);
  if (own.values.size() < images_) gap.columns += (units - own.vectors * rows) / lambda;
  gap.factor.compute(gap.columns(gap.unmeasured, Eigen::all));
  return gap;
}

std::shared_ptr<const Eigen::MatrixXd> TexelRegression::posterior(int prior, int noise, int channel,
                                                                  const std::vector<int>& measured) const {
  const auto count = static_cast<Eigen::Index>(cells_.size());
  const double scale = spectrum(prior, channel).scale;
  const std::array<int, 3> key = {prior, noise, is_grey_ ? 0 : channel};
  std::shared_ptr<const Eigen::MatrixXd> complete;
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = posteriors_.find(key); found != posteriors_.end()) complete = found->second;
  }
  if (!complete) {
    // s K less what the samples tell: Hᵀ H, where H = R s L K and Rᵀ R is the inverse covariance of the
    // samples. By way of the samples, since there are often fewer of them than weights.
    auto result = std::make_shared<Eigen::MatrixXd>(scale * covariances_[prior]);
    const Spectrum& own = spectrum(prior, channel);
    const Eigen::MatrixXd told =
        (own.values.array() + cell_noise_ratio(noise)).rsqrt().matrix().asDiagonal() *
        (own.vectors.transpose() * lights_[channel]) * *result;
    result->selfadjointView<Eigen::Lower>().rankUpdate(told.transpose(), -1.0);
    result->triangularView<Eigen::StrictlyUpper>() = result->transpose();
    complete = result;
    const std::lock_guard lock(mutex_);
    if (posteriors_.size() * count * count * sizeof(double) > max_posterior_bytes) posteriors_.clear();
    posteriors_[key] = complete;
  }
  if (static_cast<int>(measured.size()) == images_) return complete;
  const Gap gap = gap_of(prior, noise, channel, measured);
  const Eigen::MatrixXd lost = gap.factor.matrixL().solve(
      Eigen::MatrixXd(scale * gap.columns.transpose() * lights_[channel] * covariances_[prior]));
  return std::make_shared<Eigen::MatrixXd>(*complete + lost.transpose() * lost);
}

Eigen::VectorXd TexelRegression::dual_of(int prior, int noise, int channel,
                                         const Eigen::VectorXd& samples) const {
  const Spectrum& own = spectrum(prior, channel);
  const Eigen::VectorXd coordinates = own.vectors.transpose() * samples;
  const double lambda = cell_noise_ratio(noise);
  // (K + λI)⁻¹ b = V (1/(v + λ) − 1/λ) Vᵀb + b/λ; with all directions in V the rest is nothing but rounding.
  if (own.values.size() == images_)
    return own.vectors * (coordinates.array() / (own.values.array() + lambda)).matrix();
  return own.vectors * (coordinates.array() / (own.values.array() + lambda)).matrix() +
         (samples - own.vectors * coordinates) / lambda;
}

Eigen::VectorXd TexelRegression::solve(int prior, int noise, int channel, const Eigen::VectorXd& samples,
                                       const std::vector<int>& measured) const {
  if (static_cast<int>(measured.size()) == images_) return dual_of(prior, noise, channel, samples);
  Eigen::VectorXd seen = Eigen::VectorXd::Zero(images_);
  seen(measured) = samples(measured);
  Eigen::VectorXd dual = dual_of(prior, noise, channel, seen);
  const Gap gap = gap_of(prior, noise, channel, measured);
  dual -= gap.columns * gap.factor.solve(Eigen::VectorXd(dual(gap.unmeasured)));
  dual(gap.unmeasured).setZero();
  return dual;
}

Eigen::VectorXd TexelRegression::non_negative(int prior, int noise, int channel,
                                              const Eigen::VectorXd& samples,
                                              const std::vector<int>& measured) const {
  const auto count = static_cast<Eigen::Index>(cells_.size());
  const Eigen::MatrixXd lights = lights_[channel](measured, Eigen::all);
  Eigen::MatrixXd gram = lights.transpose() * lights;
  {
    const std::lock_guard lock(mutex_);
    Eigen::MatrixXd& precision = precisions_[prior];
    if (precision.size() == 0)
      precision = covariances_[prior].llt().solve(Eigen::MatrixXd::Identity(count, count));
    gram += cell_noise_ratio(noise) / spectrum(prior, channel).scale * precision;
  }
  const Eigen::VectorXd products = lights.transpose() * samples(measured);
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(count);
  const auto size = static_cast<int>(count);
  NnlsSolver().solve(gram.data(), size, products.data(), size, weights.data());
  return weights;
}

TexelRegression::Fit TexelRegression::fit(const PixelSamples& samples) const {
  Fit result;
  result.criterion = std::numeric_limits<double>::infinity();
  std::array<Eigen::VectorXd, 3> values;
  std::array<std::vector<int>, 3> measured;
  std::array<double, 3> squared{};
  for (int c = 0; c < 3; ++c) {
    measured[c] = measured_in(samples[c], images_);
    values[c] = Eigen::VectorXd::Zero(images_);
    for (const int j : measured[c]) values[c](j) = samples[c][j];
    squared[c] = values[c].squaredNorm();
    result.kernels.squared_samples += squared[c];
    if (squared[c] > 0.0 && static_cast<int>(measured[c].size()) < images_) {
      const int noise = std::min(usual_noise, noise_levels_ - 1);
      const Eigen::VectorXd dual = solve(usual_prior, noise, c, values[c], measured[c]);
      const Eigen::VectorXd predicted = lights_[c] * weights_of(usual_prior, c, dual);
      for (int j = 0; j < images_; ++j)
        if (std::isnan(samples[c][j])) values[c](j) = predicted(j);
    }
  }
  if (!(result.kernels.squared_samples > 0.0)) return result;
  int best_prior = independent_prior, best_noise = 0;
  const bool is_complete =
      std::ranges::all_of(measured, [&](const auto& m) { return static_cast<int>(m.size()) == images_; });
  const bool is_determined = is_complete && determined_[0].size() > 0;
  if (is_determined) result.criterion = 0.0;  // nothing to compare with
  for (int prior = 0; !is_determined && prior < static_cast<int>(priors.size()); ++prior) {
    std::array<double, 32> criterion{};
    for (int c = 0; c < 3; ++c) {
      if (!(squared[c] > 0.0)) continue;
      const Spectrum& own = spectrum(prior, c);
      const Eigen::ArrayXd coordinates = (own.vectors.transpose() * values[c]).array().square();
      const double total = values[c].squaredNorm();
      const double rest =
          own.values.size() < images_ ? std::max(total - coordinates.sum(), rounding * total) : 0.0;
      for (int level = 0; level < noise_levels_; ++level) {
        const double lambda = cell_noise_ratio(level);
        const double q = (coordinates / (own.values.array() + lambda)).sum() + rest / lambda;
        criterion[level] += images_ * std::log(q / images_) + own.log_determinant[level];
      }
    }
    for (int level = 0; level < noise_levels_; ++level)
      if (criterion[level] < result.criterion) {
        result.criterion = criterion[level];
        best_prior = prior;
        best_noise = level;
      }
  }
  PixelKernels& kernels = result.kernels;
  kernels.is_on_cells = true;
  kernels.light_class = best_prior * cell_noise_levels + best_noise;
  std::vector<float> all_weights(3 * cells_.size());
  for (int c = 0; c < 3; ++c) {
    if (!(squared[c] > 0.0)) continue;
    Eigen::VectorXd weights =
        is_determined ? determined_[is_grey_ ? 0 : c] * values[c]
                      : weights_of(best_prior, c, solve(best_prior, best_noise, c, values[c], measured[c]));
    if (weights.minCoeff() < 0.0) {
      const auto found = without_negative(weights, *posterior(best_prior, best_noise, c, measured[c]));
      weights = found ? *found : non_negative(best_prior, best_noise, c, values[c], measured[c]);
    }
    for (std::size_t k = 0; k < cells_.size(); ++k)
      all_weights[3 * k + c] = static_cast<float>(weights(static_cast<Eigen::Index>(k)));
    const Eigen::VectorXd residual = values[c] - lights_[c] * weights;
    kernels.squared_residual += residual(measured[c]).squaredNorm();
  }
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const float* weight = all_weights.data() + 3 * k;
    if (weight[0] == 0.0f && weight[1] == 0.0f && weight[2] == 0.0f) continue;
    kernels.boxes.push_back(cells_[k]);
    kernels.weights.insert(kernels.weights.end(), weight, weight + 3);
  }
  return result;
}

double TexelRegression::criterion_of(const PixelKernels& kernels, const PixelSamples& samples) const {
  std::vector<double> residual(images_);
  AlignedFloats column(table_->stride());
  double criterion = 0.0;
  const std::size_t hats = kernels.smooth.size() / 3;
  for (int c = 0; c < 3; ++c) {
    std::copy_n(samples[c], images_, residual.begin());
    int weights = 0;
    for (std::size_t k = 0; k < kernels.boxes.size(); ++k) {
      const double weight = kernels.weights[3 * k + c];
      if (weight == 0.0) continue;
      ++weights;
      table_->channel_column(kernels.boxes[k], c, column.data());
      for (int j = 0; j < images_; ++j) residual[j] -= weight * column[j];
    }
    for (std::size_t h = 0; h < hats; ++h) {
      const double weight = kernels.smooth[3 * h + c];
      if (weight == 0.0) continue;
      ++weights;
      for (int j = 0; j < images_; ++j) residual[j] -= weight * table_->hat_sums(static_cast<int>(h), c)[j];
    }
    double squared = 0.0, error = 0.0;
    int measured = 0;
    for (int j = 0; j < images_; ++j) {
      if (std::isnan(samples[c][j])) continue;
      ++measured;
      squared += static_cast<double>(samples[c][j]) * samples[c][j];
      error += residual[j] * residual[j];
    }
    if (!(squared > 0.0)) continue;
    // Nothing is known here about the filled-in samples that fit() counts: their share is left as it is.
    criterion +=
        images_ * std::log(std::max(error, rounding * squared) / measured) + weights * std::log(images_);
  }
  return criterion + rectangle_penalty * static_cast<double>(kernels.boxes.size());
}

TexelRegression::LeftOut TexelRegression::left_out_of(const PixelKernels& kernels,
                                                      const MaskedSamples& samples, int c) const {
  const int prior = kernels.light_class / cell_noise_levels, noise = kernels.light_class % cell_noise_levels;
  LeftOut out;
  out.values.resize(images_);
  for (int j = 0; j < images_; ++j) {
    const std::size_t at = c * table_->stride() + j;
    out.values(j) = samples.values[at];
    if (samples.complete || samples.measured[at] > 0.0f) out.measured.push_back(j);
  }
  out.dual = solve(prior, noise, c, out.values, out.measured);
  // (K + λI)⁻¹ on the diagonal: (1 − h) / λ of each sample, with all weights free.
  const double lambda = cell_noise_ratio(noise);
  const Spectrum& own = spectrum(prior, c);
  const Eigen::MatrixXd taken = own.vectors.cwiseAbs2();
  out.diagonal = taken * (own.values.array() + lambda).inverse().matrix();
  if (own.values.size() < images_) out.diagonal.array() += (1.0 - taken.rowwise().sum().array()) / lambda;
  if (static_cast<int>(out.measured.size()) < images_) {
    const Gap gap = gap_of(prior, noise, c, out.measured);
    out.diagonal -= gap.factor.matrixL()
                        .solve(Eigen::MatrixXd(gap.columns.transpose()))
                        .colwise()
                        .squaredNorm()
                        .transpose();
  }
  out.misfit = out.dual;  // b − K α = λ α, in units of λ
  if (!kernels.is_on_cells) return out;
  const Eigen::VectorXd weights = weights_on_cells(kernels, cells_, c);
  std::vector<Eigen::Index> zeros;
  for (Eigen::Index k = 0; k < weights.size(); ++k)
    if (weights(k) == 0.0) zeros.push_back(k);
  if (zeros.empty()) return out;
  // Weights that are held at zero take no part of the samples.
  const auto covariance = posterior(prior, noise, c, out.measured);
  const Eigen::MatrixXd shares = lights_[c] * (*covariance)(Eigen::all, zeros);
  const Eigen::MatrixXd held = (*covariance)(zeros, zeros);
  out.diagonal +=
      held.llt().matrixL().solve(shares.transpose()).colwise().squaredNorm().transpose() / (lambda * lambda);
  out.misfit = (out.values - lights_[c] * weights) / lambda;
  return out;
}

TexelRegression::GroupLeverage TexelRegression::leverage_of(const std::vector<int>& group, const LeftOut& out,
                                                            double noise_ratio) {
  GroupLeverage taken{Eigen::ArrayXd::Zero(static_cast<Eigen::Index>(group.size())), 1.0};
  for (std::size_t i = 0; i < group.size(); ++i)
    if (std::ranges::binary_search(out.measured, group[i]))
      taken.root(static_cast<Eigen::Index>(i)) =
          std::sqrt(std::max(1.0 - noise_ratio * out.diagonal(group[i]), 0.0));
  constexpr double min_error = 1e-12;
  taken.rest = std::max(1.0 - taken.root.square().sum(), min_error);
  return taken;
}

double TexelRegression::leave_one_out(const PixelKernels& kernels, const MaskedSamples& samples,
                                      float* residuals) const {
  const std::size_t stride = table_->stride();
  const double noise_ratio = cell_noise_ratio(kernels.light_class % cell_noise_levels);
  std::fill_n(residuals, 3 * stride, 0.0f);
  double squared = 0.0;
  for (int c = 0; c < 3; ++c) {
    if (!(samples.squared[c] > 0.0)) continue;
    const LeftOut out = left_out_of(kernels, samples, c);
    Eigen::ArrayXd residual = out.misfit.array() / out.diagonal.array();
    for (const auto& group : repeats_) {
      const GroupLeverage taken = leverage_of(group, out, noise_ratio);
      const double with_misfit = (taken.root * out.misfit(group).array()).sum();
      residual(group) = noise_ratio * (out.misfit(group).array() + taken.root * with_misfit / taken.rest);
    }
    for (const int j : out.measured) {
      residuals[c * stride + j] = static_cast<float>(residual(j));
      squared += residual(j) * residual(j);
    }
  }
  return squared;
}

double TexelRegression::expected_error(const PixelKernels& kernels, const MaskedSamples& samples) const {
  const double lambda = cell_noise_ratio(kernels.light_class % cell_noise_levels);
  double expected = 0.0;
  for (int c = 0; c < 3; ++c) {
    if (!(samples.squared[c] > 0.0)) continue;
    const LeftOut out = left_out_of(kernels, samples, c);
    // Variance of the samples, in units of the prior's scale.
    Eigen::ArrayXd variance = (out.diagonal.array().inverse() - lambda).max(0.0);
    for (const auto& group : repeats_) {
      const GroupLeverage taken = leverage_of(group, out, lambda);
      variance(group) = lambda * taken.root.square() / taken.rest;
    }
    // The scale of the prior with the highest evidence: bᵀ (K + λI)⁻¹ b / n.
    expected +=
        out.values.dot(out.dual) / static_cast<double>(out.measured.size()) * variance(out.measured).sum();
  }
  return expected;
}

TexelRegressions::TexelRegressions(const BoxTable& table) : table_(table), cells_(light_cells(table)) {
  if (cells_.size() > max_light_cells && !are_nearly_orthogonal(lights_of(table, cells_))) cells_.clear();
}

std::shared_ptr<const TexelRegression> TexelRegressions::of_all() {
  if (cells_.empty()) return nullptr;
  const std::lock_guard lock(mutex_);
  auto& found = parts_[{}];
  if (!found) found = std::make_shared<TexelRegression>(table_, cells_);
  return found;
}

std::shared_ptr<const TexelRegression> TexelRegressions::of_part(const std::vector<int>& seen) {
  if (cells_.empty()) return nullptr;
  const std::lock_guard lock(mutex_);
  auto& found = parts_[seen];
  if (!found) {
    tables_.push_back(std::make_unique<BoxTable>(table_.subset(seen)));
    found = std::make_shared<TexelRegression>(*tables_.back(), cells_);
  }
  return found;
}

}  // namespace refield
