// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_pairing.h"

#include <Eigen/Cholesky>

#include <cmath>
#include <limits>

#include "core/image/metrics.h"

namespace refield {

namespace {

constexpr int block_columns = 6, block_rows = 4, blocks = block_columns * block_rows;

template <class Sample>
BlockMeans means_of(int width, int height, const Sample& sample) {
  BlockMeans sums = BlockMeans::Zero(3 * blocks);
  Eigen::VectorXf counts = Eigen::VectorXf::Zero(3 * blocks);
  // Large photographs: enough samples of each block. Steps are odd, for all colours of a Bayer pattern.
  const int step = std::max(1, std::min(width, height) / 400) | 1;
  for (int y = 0; y < height; y += step)
    for (int x = 0; x < width; x += step) {
      const int block = y * block_rows / height * block_columns + x * block_columns / width;
      sample(x, y, [&](int channel, float value) {
        sums(3 * block + channel) += value;
        counts(3 * block + channel) += 1.0f;
      });
    }
  return sums.cwiseQuotient(counts.cwiseMax(1.0f));
}

// Costs of a pairing, in units of the variance of a right pair. A pair that does not fit costs `max_cost`,
// less than leaving out both its bracket and its light: one odd photograph keeps its place.
constexpr double max_cost = 8.0, cost_of_missing = 8.0, cost_of_black = 1.0, cost_of_stray = 12.0;
constexpr double cost_of_doubled = 10.0, cost_of_equal = 1.0;  // where a bracket equals the one before
constexpr double least_evidence = 20.0;  // against pairs in order where counts are equal

double relative_difference(const BlockMeans& a, const BlockMeans& b) {
  return 2.0 * (a - b).norm() / std::max(1e-12f, a.norm() + b.norm());
}

enum class Step : std::uint8_t { pair, missing, black, doubled, stray };

class Aligner {
 public:
  explicit Aligner(const OrderedSeries& series)
      : series_(series), brackets_(series.photographs.size()), lights_(series.lights.size()) {
    std::vector<double> brightness;
    for (const BlockMeans& photograph : series.photographs) brightness.push_back(photograph.sum());
    const auto darkest = static_cast<std::size_t>(std::ranges::min_element(brightness) - brightness.begin());
    const bool is_given = series.black && series.black->sum() < brightness[darkest];
    black_ = is_given ? *series.black : series.photographs[darkest];  // room light may be on in the given one
    constexpr double uneven = 1.3, dim = 0.004;  // of black itself; of what patterns give
    const double level = uneven * black_.sum() + dim * upper_median(brightness);
    for (std::size_t i = 0; i < brackets_; ++i) {
      is_black_.push_back(brightness[i] <= level);
      constexpr double equal = 0.02;  // noise and compression; light maps differ by more
      is_repeated_.push_back(i > 0 && relative_difference(series.photographs[i] - black_,
                                                          series.photographs[i - 1] - black_) < equal);
    }
    std::vector<double> norms;
    for (const BlockMeans& photograph : series.photographs) norms.push_back(photograph.norm());
    soft_ = static_cast<float>(0.3 * upper_median(norms));
    predict_by_mean();
  }

  OrderedPairing align() {
    constexpr int max_rounds = 6;
    std::vector<Step> steps = best_steps();
    for (int round = 0; round < max_rounds; ++round) {
      learn(steps);
      const std::vector<Step> next = best_steps();
      if (next == steps) break;
      steps = next;
    }
    if (brackets_ == lights_ + (series_.first_is_black ? 1 : 0)) {
      std::vector<Step> plain(brackets_, Step::pair);
      if (series_.first_is_black) plain.front() = Step::black;
      if (steps != plain && total(plain) < total(steps) + least_evidence) steps = plain;
    }
    OrderedPairing pairing = pairing_of(steps);
    pairing.is_certain = is_certain(steps);
    return pairing;
  }

 private:
  /// Each block in proportion to the light's mean, before any pair is known.
  void predict_by_mean() {
    std::array<std::vector<double>, 3> mean;
    for (const BlockMeans& light : series_.lights)
      for (int c = 0; c < 3; ++c) mean[c].push_back(light(Eigen::seqN(c, blocks, 3)).mean());
    predicted_.assign(lights_, black_);
    for (int k = 0; k < 3 * blocks; ++k) {
      std::vector<double> values;
      for (std::size_t i = 0; i < brackets_; ++i)
        if (!is_black_[i]) values.push_back(series_.photographs[i](k) - black_(k));
      const double gain = upper_median(values) / std::max(1e-12, upper_median(mean[k % 3]));
      for (std::size_t j = 0; j < lights_; ++j) predicted_[j](k) += static_cast<float>(gain * mean[k % 3][j]);
    }
    constexpr float spread = 0.2f;  // of natural light maps of one mean
    set_covariance(spread * spread * Eigen::MatrixXf::Identity(3 * blocks, 3 * blocks));
  }

  /// From the better pairs: ridge regression of photographs on lights, the covariance of its residuals, and
  /// the offset of the clocks.
  void learn(const std::vector<Step>& steps) {
    const auto pairs = pairs_of(steps);
    const double typical = median_difference(pairs);
    // Where a bracket is missing or repeated is not certain yet: the pairs beside it may be wrong.
    constexpr std::size_t doubtful = 6, enough = 30;
    std::vector<std::size_t> gaps;
    walk(steps, [&](Step step, std::size_t, std::size_t j) {
      if (step != Step::pair && step != Step::black) gaps.push_back(j);
    });
    const auto is_near_gap = [&](std::size_t j) {
      return std::ranges::any_of(gaps,
                                 [&](std::size_t gap) { return j + doubtful > gap && j < gap + doubtful; });
    };
    std::vector<std::pair<std::size_t, std::size_t>> good;
    for (const auto& [i, j] : pairs)
      if (difference(i, j) <= 3.0 * typical && !is_near_gap(j)) good.emplace_back(i, j);
    if (good.size() >= enough) fit(good);
    scale_ = std::max(1e-12, median_difference(pairs));
    set_clocks(pairs);
  }

  void set_clocks(const std::vector<std::pair<std::size_t, std::size_t>>& pairs) {
    std::vector<double> apart, shifts, intervals;
    for (const auto& [i, j] : pairs)
      if (series_.taken[i] && series_.shown[j]) apart.push_back(*series_.taken[i] - *series_.shown[j]);
    for (std::size_t j = 0; j + 1 < lights_; ++j)
      if (series_.shown[j] && series_.shown[j + 1])
        intervals.push_back(*series_.shown[j + 1] - *series_.shown[j]);
    interval_ = upper_median(intervals);
    const double offset = upper_median(apart);
    for (const double time : apart) shifts.push_back(std::abs(time - offset));
    offset_.reset();
    if (2 * apart.size() > pairs.size() && upper_median(shifts) < 0.25 * interval_) offset_ = offset;
  }

  void fit(const std::vector<std::pair<std::size_t, std::size_t>>& pairs) {
    const auto n = static_cast<Eigen::Index>(pairs.size());
    Eigen::MatrixXf inputs(n, 3 * blocks), outputs(n, 3 * blocks), residuals(n, 3 * blocks);
    for (Eigen::Index p = 0; p < n; ++p) {
      const auto& [i, j] = pairs[static_cast<std::size_t>(p)];
      // Relative: bright photographs would decide alone otherwise.
      const float weight = 1.0f / (series_.photographs[i].norm() + soft_);
      inputs.row(p) = weight * series_.lights[j];
      outputs.row(p) = weight * (series_.photographs[i] - black_);
    }
    constexpr float ridge = 0.1f, shrinkage = 0.05f;
    Eigen::MatrixXf normal = inputs.transpose() * inputs;
    normal.diagonal().array() += ridge * normal.trace() / static_cast<float>(n);
    const Eigen::LDLT<Eigen::MatrixXf> solver(normal);
    const Eigen::MatrixXf weights = solver.solve(inputs.transpose() * outputs);
    for (std::size_t j = 0; j < lights_; ++j)
      predicted_[j] = weights.transpose() * series_.lights[j] + black_;
    for (Eigen::Index p = 0; p < n; ++p) {
      const auto& [i, j] = pairs[static_cast<std::size_t>(p)];
      // Each light of a pair from the others alone, since a wrong pair would predict itself.
      const float leverage = std::min(0.9f, inputs.row(p).dot(solver.solve(inputs.row(p).transpose())));
      predicted_[j] = (predicted_[j] - leverage * series_.photographs[i]) / (1.0f - leverage);
      residuals.row(p) = (series_.photographs[i] - predicted_[j]) / brightness(i, j);
    }
    Eigen::MatrixXf covariance = residuals.transpose() * residuals / static_cast<float>(n);
    covariance.diagonal().array() += shrinkage * covariance.trace() / (3.0f * blocks);
    set_covariance(covariance);
  }

  /// Residuals have much in common over the blocks, which does not tell one light from another.
  void set_covariance(const Eigen::MatrixXf& covariance) {
    const Eigen::LLT<Eigen::MatrixXf> factor(covariance);
    white_photographs_.clear();
    white_predicted_.clear();
    for (const BlockMeans& photograph : series_.photographs)
      white_photographs_.push_back(factor.matrixL().solve(photograph));
    for (const BlockMeans& predicted : predicted_)
      white_predicted_.push_back(factor.matrixL().solve(predicted));
  }

  float brightness(std::size_t i, std::size_t j) const {
    return 0.5f * (series_.photographs[i].norm() + predicted_[j].norm()) + soft_;
  }

  /// Squared, relative, in units of its covariance.
  double difference(std::size_t i, std::size_t j) const {
    return (white_photographs_[i] - white_predicted_[j]).squaredNorm() / std::pow(brightness(i, j), 2);
  }

  double median_difference(const std::vector<std::pair<std::size_t, std::size_t>>& pairs) const {
    std::vector<double> differences;
    for (const auto& [i, j] : pairs) differences.push_back(difference(i, j));
    return upper_median(differences);
  }

  double cost(std::size_t i, std::size_t j) const {
    double cost = std::min(max_cost, difference(i, j) / scale_);
    if (!offset_ || !series_.taken[i] || !series_.shown[j]) return cost;
    constexpr double exactness = 0.3;  // of the interval: cameras state whole seconds
    const double late = *series_.taken[i] - *series_.shown[j] - *offset_;
    return std::min(2.0 * max_cost, cost + std::pow(late / (exactness * interval_), 2));
  }

  double cost(Step step, std::size_t i, std::size_t j) const {
    switch (step) {
      case Step::pair:
        return cost(i, j);
      case Step::missing:
        return cost_of_missing;
      case Step::black:
        return is_black_[i]                       ? cost_of_black
               : i == 0 && series_.first_is_black ? max_cost
                                                  : std::numeric_limits<double>::infinity();
      case Step::doubled:
        return j == 0 ? std::numeric_limits<double>::infinity()
                      : (is_repeated_[i] ? cost_of_equal : cost_of_doubled) +
                            std::min(max_cost, difference(i, j - 1) / scale_);
      case Step::stray:
        return cost_of_stray;
    }
    throw InputError("unknown step of a pairing");
  }

  static bool takes_bracket(Step step) { return step != Step::missing; }
  static bool takes_light(Step step) { return step == Step::pair || step == Step::missing; }

  std::vector<Step> best_steps() const {
    constexpr std::array<Step, 5> kinds = {Step::pair, Step::missing, Step::black, Step::doubled,
                                           Step::stray};
    std::vector<std::vector<double>> least(
        brackets_ + 1, std::vector<double>(lights_ + 1, std::numeric_limits<double>::infinity()));
    std::vector<std::vector<Step>> last(brackets_ + 1, std::vector<Step>(lights_ + 1, Step::pair));
    least[0][0] = 0.0;
    constexpr std::size_t max_shift = 50;
    const std::size_t more = std::max(brackets_, lights_) - std::min(brackets_, lights_) + max_shift;
    for (std::size_t i = 0; i <= brackets_; ++i)
      for (std::size_t j = i > more ? i - more : 0; j <= std::min(lights_, i + more); ++j)
        for (const Step kind : kinds) {
          if ((takes_bracket(kind) && i == 0) || (takes_light(kind) && j == 0)) continue;
          const std::size_t a = i - takes_bracket(kind), b = j - takes_light(kind);
          const double sum = least[a][b] + cost(kind, a, b);
          if (sum < least[i][j]) {
            least[i][j] = sum;
            last[i][j] = kind;
          }
        }
    std::vector<Step> steps;
    for (std::size_t i = brackets_, j = lights_; i > 0 || j > 0;) {
      steps.push_back(last[i][j]);
      i -= takes_bracket(steps.back());
      j -= takes_light(steps.back());
    }
    std::ranges::reverse(steps);
    return steps;
  }

  template <class Visit>
  static void walk(const std::vector<Step>& steps, const Visit& visit) {
    std::size_t i = 0, j = 0;
    for (const Step step : steps) {
      visit(step, i, j);
      i += takes_bracket(step);
      j += takes_light(step);
    }
  }

  double total(const std::vector<Step>& steps) const {
    double sum = 0.0;
    walk(steps, [&](Step step, std::size_t i, std::size_t j) { sum += cost(step, i, j); });
    return sum;
  }

  static std::vector<std::pair<std::size_t, std::size_t>> pairs_of(const std::vector<Step>& steps) {
    std::vector<std::pair<std::size_t, std::size_t>> pairs;
    walk(steps, [&](Step step, std::size_t i, std::size_t j) {
      if (step == Step::pair) pairs.emplace_back(i, j);
    });
    return pairs;
  }

  OrderedPairing pairing_of(const std::vector<Step>& steps) const {
    OrderedPairing pairing;
    pairing.bracket_of.resize(lights_);
    walk(steps, [&](Step step, std::size_t i, std::size_t j) {
      if (step == Step::pair) pairing.bracket_of[j] = i;
      if (step == Step::black) pairing.black.push_back(i);
      if (step == Step::stray) pairing.stray.push_back(i);
      if (step != Step::doubled) return;
      std::size_t again = i;
      auto& kept = pairing.bracket_of[j - 1];
      if (kept && cost(i, j - 1) < cost(*kept, j - 1)) std::swap(*kept, again);
      pairing.doubled.emplace_back(again, j - 1);
    });
    return pairing;
  }

  /// Whether right pairs differ clearly less than those of one light before or after.
  bool is_certain(const std::vector<Step>& steps) const {
    constexpr std::size_t enough = 8;
    constexpr double clearly = 3.0;
    std::vector<double> right, wrong;
    for (const auto& [i, j] : pairs_of(steps)) {
      right.push_back(difference(i, j));
      if (j > 0) wrong.push_back(difference(i, j - 1));
      if (j + 1 < lights_) wrong.push_back(difference(i, j + 1));
    }
    return right.size() >= enough && (offset_ || upper_median(wrong) > clearly * upper_median(right));
  }

  const OrderedSeries& series_;
  const std::size_t brackets_, lights_;
  BlockMeans black_;
  std::vector<bool> is_black_, is_repeated_;
  std::vector<BlockMeans> predicted_;  // [lights]
  std::vector<BlockMeans> white_photographs_, white_predicted_;
  float soft_ = 0.0f;             // brightness below which differences count less
  double scale_ = 1.0;            // difference of a typical pair
  std::optional<double> offset_;  // of the camera's clock, where times agree
  double interval_ = 0.0;         // between patterns, seconds
};

}  // namespace

BlockMeans block_means(const Image& image) {
  return means_of(image.width, image.height, [&](int x, int y, const auto& add) {
    for (int c = 0; c < 3; ++c) add(c, image.at(x, y, c));
  });
}

BlockMeans block_means(const BracketFile& file, const std::vector<float>& linear_from_dn, double black) {
  if (file.bits == 0) return block_means(file.linear);
  const RawFrame& frame = file.frame;
  const auto linear = [&](std::size_t sample) {
    const std::size_t dn = std::min<std::size_t>(frame.samples[sample], linear_from_dn.size() - 1);
    return linear_from_dn[dn] - static_cast<float>(black);
  };
  return means_of(frame.width, frame.height, [&](int x, int y, const auto& add) {
    const std::size_t pixel = static_cast<std::size_t>(y) * frame.width + x;
    if (is_bayer(frame.layout))
      add(bayer_channel(frame.layout, x, y), linear(pixel));
    else
      for (int c = 0; c < 3; ++c)
        add(c, linear(frame.layout == PixelLayout::rgb ? 3 * pixel + static_cast<std::size_t>(c) : pixel));
  });
}

OrderedPairing pair_in_order(const OrderedSeries& series) {
  return Aligner(series).align();
}

}  // namespace refield
