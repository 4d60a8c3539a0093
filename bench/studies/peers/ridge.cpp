// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/ridge.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "cli/run_context.h"
#include "core/base/errors.h"

namespace refield::peers {

namespace {

constexpr int ridge_block_pixels = 32;

std::vector<double> length_scales(const LightDomain& domain, DualMethod method) {
  std::vector<double> scales = {0.0};
  if (method == DualMethod::smooth_ridge)
    for (double length = 1.0; length <= domain.width; length *= 2.0) scales.push_back(length);
  return scales;
}

/// One covariance and channel: what is the same for all pixels.
struct Fitter {
  GramSpectrum spectrum;
  DualFilters filters;
  Fitter(const Eigen::MatrixXd& gram, DualMethod method) : spectrum(gram), filters(spectrum, method) {}
};

/// Of a covariance, a channel each.
struct ChannelGrams {
  std::array<Eigen::MatrixXd, 3> gram;
  std::vector<Fitter> fitters;  // [3]
};

/// A channel of a pixel that misses samples: the rows that it has, and spectra of their own.
struct PartialChannel {
  std::vector<Eigen::Index> rows;
  std::vector<Fitter> fitters;  // [covariances]
};

std::vector<Eigen::Index> measured_rows(const Eigen::Ref<const Eigen::VectorXf>& samples) {
  std::vector<Eigen::Index> rows;
  for (Eigen::Index j = 0; j < samples.size(); ++j)
    if (!std::isnan(samples(j))) rows.push_back(j);
  return rows;
}

class DualFit {
 public:
  DualFit(const PeerData& data, DualMethod method) : data_(data), method_(method) {
    model_.domain = data.domain;
    model_.width = data.width;
    model_.height = data.height;
    for (const double length : length_scales(data.domain, method))
      model_.covariances.emplace_back(data.domain, length);
    grams_.resize(model_.covariances.size());
    for (int c = 0; c < 3; ++c) {
      const Eigen::MatrixXd texels = texel_matrix(data.lights, c);
      for (std::size_t k = 0; k < grams_.size(); ++k) {
        run_context().throw_if_stopped();
        grams_[k].gram[c] = texels.transpose() * model_.covariances[k].times(texels);
      }
      model_.lights[c] = texels.cast<float>();
    }
    tbb::parallel_for(std::size_t{0}, grams_.size(), [&](std::size_t k) {
      for (int c = 0; c < 3; ++c) grams_[k].fitters.emplace_back(grams_[k].gram[c], method);
    });
    model_.covariance_of.assign(3 * static_cast<std::size_t>(data.pixels()), 0);
    model_.alpha = Eigen::MatrixXf::Zero(data.images(), data.observed.cols());
  }

  DualModel run() {
    Progress progress(run_context(), "dual regression", data_.pixels());
    tbb::parallel_for(0, (data_.pixels() + ridge_block_pixels - 1) / ridge_block_pixels, [&](int block) {
      run_context().throw_if_stopped();
      const int first = block * ridge_block_pixels;
      fit_block(first, std::min(ridge_block_pixels, data_.pixels() - first));
      progress.advance(std::min(ridge_block_pixels, data_.pixels() - first));
    });
    return std::move(model_);
  }

 private:
  void fit_block(int first, int count) {
    // β of complete channels, by one product a covariance and channel.
    std::vector<std::array<Eigen::MatrixXd, 3>> beta(grams_.size());
    for (int c = 0; c < 3; ++c) {
      Eigen::MatrixXd samples(data_.images(), count);
      for (int i = 0; i < count; ++i) samples.col(i) = data_.observed.col(3 * (first + i) + c).cast<double>();
      for (std::size_t k = 0; k < grams_.size(); ++k)
        beta[k][c].noalias() = grams_[k].fitters[c].spectrum.vectors.transpose() * samples;
    }
    for (int i = 0; i < count; ++i)
      if (data_.counts(first + i)) fit_pixel(first + i, i, beta);
  }

  void fit_pixel(int pixel, int place, const std::vector<std::array<Eigen::MatrixXd, 3>>& block_beta) {
    std::array<PartialChannel, 3> partial;
    for (int c = 0; c < 3; ++c) {
      partial[c].rows = measured_rows(data_.observed.col(3 * pixel + c));
      if (partial[c].rows.size() == static_cast<std::size_t>(data_.images()) || partial[c].rows.size() < 2)
        continue;
      for (const ChannelGrams& grams : grams_)
        partial[c].fitters.emplace_back(grams.gram[c](partial[c].rows, partial[c].rows), method_);
    }
    double best = std::numeric_limits<double>::infinity();
    std::size_t best_covariance = 0;
    Eigen::Index best_setting = 0;
    for (std::size_t k = 0; k < grams_.size(); ++k) {
      Eigen::VectorXd sum;
      for (int c = 0; c < 3; ++c) {
        const Fitter* fitter = fitter_of(k, c, partial[c]);
        if (!fitter) continue;
        const Eigen::VectorXd found =
            fitter->filters.criterion(beta_of(pixel, place, k, c, partial[c], block_beta).cwiseAbs2());
        const Eigen::Index settings = sum.size() == 0 ? found.size() : std::min(found.size(), sum.size());
        sum = sum.size() == 0 ? found : (sum.head(settings) + found.head(settings)).eval();
      }
      Eigen::Index setting = 0;
      if (sum.size() == 0 || !(sum.minCoeff(&setting) < best)) continue;
      best = sum(setting);
      best_covariance = k;
      best_setting = setting;
    }
    for (int c = 0; c < 3; ++c) {
      model_.covariance_of[3 * pixel + c] = static_cast<std::uint8_t>(best_covariance);
      const Fitter* fitter = fitter_of(best_covariance, c, partial[c]);
      if (!fitter) continue;
      const Eigen::VectorXd beta = beta_of(pixel, place, best_covariance, c, partial[c], block_beta);
      const Eigen::VectorXf alpha =
          (fitter->spectrum.vectors * fitter->filters.factors.col(best_setting).cwiseProduct(beta))
              .cast<float>();
      for (std::size_t r = 0; r < partial[c].rows.size(); ++r)
        model_.alpha(partial[c].rows[r], 3 * pixel + c) = alpha(static_cast<Eigen::Index>(r));
    }
  }

  /// None where a channel has fewer than two samples.
  const Fitter* fitter_of(std::size_t covariance, int channel, const PartialChannel& partial) const {
    if (!partial.fitters.empty()) return &partial.fitters[covariance];
    if (partial.rows.size() < 2) return nullptr;
    return &grams_[covariance].fitters[channel];
  }

  Eigen::VectorXd beta_of(int pixel, int place, std::size_t covariance, int channel,
                          const PartialChannel& partial,
                          const std::vector<std::array<Eigen::MatrixXd, 3>>& block_beta) const {
    if (partial.fitters.empty()) return block_beta[covariance][channel].col(place);
    const Eigen::VectorXd samples =
        data_.observed.col(3 * pixel + channel)(partial.rows).template cast<double>();
    return partial.fitters[covariance].spectrum.vectors.transpose() * samples;
  }

  const PeerData& data_;
  DualMethod method_;
  std::vector<ChannelGrams> grams_;  // [covariances]
  DualModel model_;
};

}  // namespace

DualModel fit_dual(const PeerData& data, DualMethod method) {
  return DualFit(data, method).run();
}

Image DualModel::relight(const LightMap& light) const {
  if (light.domain() != domain)
    throw InputError("the light map does not have the size that the model was fitted to");
  Eigen::MatrixXf likeness(alpha.rows(), 3 * static_cast<Eigen::Index>(covariances.size()));
  for (int c = 0; c < 3; ++c) {
    const Eigen::MatrixXd texels = texel_matrix(std::span(&light, 1), c);
    for (std::size_t k = 0; k < covariances.size(); ++k)
      likeness.col(3 * static_cast<Eigen::Index>(k) + c).noalias() =
          lights[c].transpose() * covariances[k].times(texels).cast<float>();
  }
  Image image(width, height, 3);
  tbb::parallel_for(tbb::blocked_range<Eigen::Index>(0, alpha.cols(), 1024), [&](const auto& range) {
    for (Eigen::Index i = range.begin(); i != range.end(); ++i) {
      const Eigen::Index k = covariance_of[static_cast<std::size_t>(i)];
      image.values[static_cast<std::size_t>(i)] =
          std::max(0.0f, alpha.col(i).dot(likeness.col(3 * k + i % 3)));
    }
  });
  return image;
}

double DualModel::bytes_per_pixel() const {
  const double pixels = static_cast<double>(width) * height;
  const double shared = 3.0 * static_cast<double>(lights[0].size()) * sizeof(float);
  return 3.0 * static_cast<double>(alpha.rows()) * sizeof(float) + (covariances.size() > 1 ? 1.0 : 0.0) +
         shared / pixels;
}

}  // namespace refield::peers
