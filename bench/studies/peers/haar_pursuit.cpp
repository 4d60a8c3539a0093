// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/haar_pursuit.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>

#include "bench/studies/peers/haar.h"
#include "cli/run_context.h"
#include "core/base/errors.h"

namespace refield::peers {

namespace {

constexpr int haar_block_pixels = 64;
/// What the inner products of chosen wavelets with all others may take. Beyond, they are computed anew.
constexpr std::uint64_t cache_bytes = 2ull << 30;
/// A wavelet may be found again, and its weight corrected; that many steps a wavelet are allowed.
constexpr int max_steps_per_wavelet = 3;

using Correlations = std::array<Eigen::VectorXf, 3>;  // a channel each, [wavelets]

/// Inner products ⟨column k, column i⟩ over the images of one wavelet with all, kept once computed.
class GramColumns {
 public:
  explicit GramColumns(const HaarDictionary& dictionary)
      : dictionary_(dictionary), kept_(static_cast<std::size_t>(dictionary.atoms())) {}

  std::shared_ptr<const Correlations> of(Eigen::Index atom) {
    auto& slot = kept_[static_cast<std::size_t>(atom)];
    if (auto found = slot.load()) return found;
    auto made = std::make_shared<Correlations>();
    for (int c = 0; c < 3; ++c)
      (*made)[c].noalias() = dictionary_.columns(c).transpose() * dictionary_.column(c, atom);
    const std::uint64_t bytes = 3 * sizeof(float) * static_cast<std::uint64_t>(dictionary_.atoms());
    if (used_.fetch_add(bytes) + bytes <= cache_bytes) slot.store(made);
    return made;
  }

 private:
  const HaarDictionary& dictionary_;
  std::vector<std::atomic<std::shared_ptr<const Correlations>>> kept_;
  std::atomic<std::uint64_t> used_{0};
};

struct PixelWavelets {
  std::vector<std::uint32_t> atoms;
  std::vector<float> weights;  // [atoms × 3]
};

class HaarFit {
 public:
  HaarFit(const PeerData& data, int wavelets)
      : data_(data), wavelets_(wavelets), dictionary_(data), gram_(dictionary_) {
    for (int c = 0; c < 3; ++c)
      squared_norms_[c] = dictionary_.columns(c).colwise().squaredNorm().transpose();
  }

  HaarModel run() {
    std::vector<PixelWavelets> found(static_cast<std::size_t>(data_.pixels()));
    Progress progress(run_context(), "Haar pursuit", data_.pixels());
    tbb::parallel_for(0, (data_.pixels() + haar_block_pixels - 1) / haar_block_pixels, [&](int block) {
      run_context().throw_if_stopped();
      const int first = block * haar_block_pixels;
      const int count = std::min(haar_block_pixels, data_.pixels() - first);
      fit_block(first, count, found);
      progress.advance(count);
    });
    HaarModel model{data_.domain, data_.width, data_.height, {}};
    for (const PixelWavelets& pixel : found) model.transfer.append_row(pixel.atoms, pixel.weights);
    return model;
  }

 private:
  void fit_block(int first, int count, std::vector<PixelWavelets>& found) {
    Eigen::MatrixXf samples = data_.observed.middleCols(3 * first, 3 * count);
    for (Eigen::Index k = 0; k < samples.cols(); ++k) fill_gaps(samples.col(k), static_cast<int>(k % 3));
    std::array<Eigen::MatrixXf, 3> correlations;
    for (int c = 0; c < 3; ++c) {
      const Eigen::MatrixXf channel = samples(Eigen::all, Eigen::seqN(c, count, 3));
      correlations[c].noalias() = dictionary_.columns(c).transpose() * channel;
    }
    for (int i = 0; i < count; ++i) {
      const int pixel = first + i;
      if (!data_.counts(pixel)) continue;
      const auto chosen = pursue({correlations[0].col(i), correlations[1].col(i), correlations[2].col(i)});
      found[static_cast<std::size_t>(pixel)] = refit(pixel, chosen);
    }
  }

  /// For the search alone, a sample that was not measured is taken to follow the light's mean.
  void fill_gaps(Eigen::Ref<Eigen::VectorXf> samples, int channel) const {
    if (!samples.hasNaN()) return;
    const auto measured = samples.array().isNaN() == false;
    const auto means = dictionary_.column(channel, 0).array();
    const float light = measured.select(means, 0.0f).sum();
    const float seen = measured.select(samples.array(), 0.0f).sum();
    const float ratio = light > 0.0f ? seen / light : 0.0f;
    samples = measured.select(samples.array(), ratio * means).eval();
  }

  std::vector<Eigen::Index> pursue(Correlations correlation) {
    std::vector<Eigen::Index> chosen;
    Eigen::ArrayXf gain(dictionary_.atoms());
    for (int step = 0; step < max_steps_per_wavelet * wavelets_; ++step) {
      gain.setZero();
      for (int c = 0; c < 3; ++c)
        gain += correlation[c].array().square() /
                squared_norms_[c].array().max(std::numeric_limits<float>::min());
      Eigen::Index best = 0;
      if (!(gain.maxCoeff(&best) > 0.0f)) break;
      if (std::ranges::find(chosen, best) == chosen.end()) {
        if (static_cast<int>(chosen.size()) == wavelets_) break;
        chosen.push_back(best);
      }
      const auto products = gram_.of(best);
      for (int c = 0; c < 3; ++c)
        if (squared_norms_[c](best) > 0.0f)
          correlation[c] -= (correlation[c](best) / squared_norms_[c](best)) * (*products)[c];
    }
    return chosen;
  }

  PixelWavelets refit(int pixel, const std::vector<Eigen::Index>& chosen) const {
    std::array<SequentialFit, 3> fits;
    Eigen::Index samples = 0;
    for (int c = 0; c < 3; ++c) {
      std::vector<Eigen::Index> rows;
      for (Eigen::Index j = 0; j < data_.images(); ++j)
        if (!std::isnan(data_.observed(j, 3 * pixel + c))) rows.push_back(j);
      samples += static_cast<Eigen::Index>(rows.size());
      const Eigen::MatrixXd columns = dictionary_.columns(c)(rows, chosen).template cast<double>();
      const Eigen::VectorXd observed = data_.observed.col(3 * pixel + c)(rows).template cast<double>();
      fits[c] = SequentialFit(columns, observed);
    }
    Eigen::Index best = 0;
    double best_criterion = std::numeric_limits<double>::infinity();
    const auto n = static_cast<double>(samples);
    // Three weights each; and each was the best of all wavelets, so noise alone would have found something.
    const double cost_of_a_wavelet =
        3.0 * std::log(n) + 2.0 * std::log(static_cast<double>(dictionary_.atoms()));
    for (Eigen::Index k = 1; k <= static_cast<Eigen::Index>(chosen.size()); ++k) {
      const double residual = fits[0].residual(k) + fits[1].residual(k) + fits[2].residual(k);
      const double criterion =
          n * std::log(std::max(residual, 1e-30)) + static_cast<double>(k) * cost_of_a_wavelet;
      if (criterion >= best_criterion) continue;
      best_criterion = criterion;
      best = k;
    }
    PixelWavelets result;
    std::array<Eigen::VectorXd, 3> weights;
    for (int c = 0; c < 3; ++c) weights[c] = fits[c].weights(best);
    for (Eigen::Index k = 0; k < best; ++k) {
      result.atoms.push_back(static_cast<std::uint32_t>(chosen[static_cast<std::size_t>(k)]));
      for (int c = 0; c < 3; ++c) result.weights.push_back(static_cast<float>(weights[c](k)));
    }
    return result;
  }

  /// Least squares on the first k columns for every k, by modified Gram–Schmidt.
  struct SequentialFit {
    Eigen::MatrixXd r;         // upper triangle
    Eigen::VectorXd products;  // ⟨q_k, b⟩
    double squared = 0.0;      // ‖b‖²

    SequentialFit() = default;
    SequentialFit(Eigen::MatrixXd columns, const Eigen::VectorXd& observed)
        : r(Eigen::MatrixXd::Zero(columns.cols(), columns.cols())),
          products(Eigen::VectorXd::Zero(columns.cols())),
          squared(observed.squaredNorm()) {
      for (Eigen::Index k = 0; k < columns.cols(); ++k) {
        const double norm_before = columns.col(k).norm();
        for (Eigen::Index i = 0; i < k; ++i) {
          r(i, k) = columns.col(i).dot(columns.col(k));
          columns.col(k) -= r(i, k) * columns.col(i);
        }
        const double norm = columns.col(k).norm();
        if (norm <= 1e-6 * norm_before || norm == 0.0) {  // depends on the columns before
          columns.col(k).setZero();
          r(k, k) = 1.0;
          continue;
        }
        r(k, k) = norm;
        columns.col(k) /= norm;
        products(k) = columns.col(k).dot(observed);
      }
    }
    double residual(Eigen::Index k) const { return std::max(0.0, squared - products.head(k).squaredNorm()); }
    Eigen::VectorXd weights(Eigen::Index k) const {
      return r.topLeftCorner(k, k).triangularView<Eigen::Upper>().solve(products.head(k));
    }
  };

  const PeerData& data_;
  int wavelets_;
  HaarDictionary dictionary_;
  GramColumns gram_;
  std::array<Eigen::VectorXf, 3> squared_norms_;
};

}  // namespace

HaarDictionary::HaarDictionary(const PeerData& data) {
  const Eigen::Index atoms = static_cast<Eigen::Index>(haar_side(data.domain)) * haar_side(data.domain);
  for (auto& columns : columns_) columns.resize(data.images(), atoms);
  tbb::parallel_for(0, data.images(), [&](int j) {
    for (int c = 0; c < 3; ++c) {
      const auto coefficients = haar_coefficients(data.lights[j], c);
      columns_[c].row(j) = Eigen::Map<const Eigen::RowVectorXf>(coefficients.data(), atoms);
    }
  });
}

HaarModel fit_haar(const PeerData& data, int wavelets) {
  if (wavelets < 1 || wavelets >= data.images())
    throw InputError(std::to_string(wavelets) + " wavelets a pixel cannot be fitted to " +
                     std::to_string(data.images()) + " images; give fewer");
  return HaarFit(data, wavelets).run();
}

Image HaarModel::relight(const LightMap& light) const {
  if (light.domain() != domain)
    throw InputError("the light map does not have the size that the model was fitted to");
  std::array<std::vector<float>, 3> planes;
  for (int c = 0; c < 3; ++c) planes[c] = haar_coefficients(light, c);
  std::vector<float> coefficients(3 * planes[0].size());
  for (std::size_t k = 0; k < planes[0].size(); ++k)
    for (std::size_t c = 0; c < 3; ++c) coefficients[3 * k + c] = planes[c][k];
  Image image(width, height, 3);
  transfer.apply(coefficients, image.values);
  for (float& value : image.values) value = std::max(0.0f, value);
  return image;
}

double HaarModel::bytes_per_pixel() const {
  return static_cast<double>(transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float)) +
                             transfer.row_start.size() * sizeof(std::uint64_t)) /
         (static_cast<double>(width) * height);
}

}  // namespace refield::peers
