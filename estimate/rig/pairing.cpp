// SPDX-License-Identifier: Apache-2.0
// The pairing of photographs and lights that the photographs prefer.
#include <tbb/parallel_for.h>

#include <cmath>
#include <numeric>

#include "core/base/rng.h"
#include "estimate/rig/estimate_rig.h"
#include "estimate/rig/light_predictors.h"

namespace refield {

namespace {

using Eigen::ArrayXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::MatrixXf;

/// Series of up to `count` pixels of a channel, spread over the sample, all measured; [images × pixels].
MatrixXf measured_series(const PixelSample& sample, int channel, int count) {
  std::vector<int> usable;
  std::vector<double> power;
  for (int p = 0; p < sample.pixels; ++p) {
    double sum = 0.0;
    bool measured = true;
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < sample.images; ++j) {
        const float value = sample.series(c, p)[j];
        measured = measured && std::isfinite(value);
        sum += static_cast<double>(value) * value;
      }
    if (!measured) continue;
    usable.push_back(p);
    power.push_back(sum);
  }
  if (usable.empty()) return MatrixXf(sample.images, 0);
  std::vector<double> ordered = power;
  std::ranges::sort(ordered);
  const double least = ordered[ordered.size() / 5];  // dark pixels are mostly noise
  std::vector<int> bright;
  for (std::size_t i = 0; i < usable.size(); ++i)
    if (power[i] >= least && power[i] > 0.0) bright.push_back(usable[i]);
  const int taken = std::min<int>(count, static_cast<int>(bright.size()));
  MatrixXf series(sample.images, taken);
  for (int k = 0; k < taken; ++k) {
    const int p = bright[static_cast<std::size_t>(k) * bright.size() / taken];
    series.col(k) = Eigen::Map<const Eigen::VectorXf>(sample.series(channel, p), sample.images);
  }
  return series;
}

/// Which light each photograph shows, each light once, and how badly photographs fit: logarithm of the power
/// that the others do not predict over their own, [photographs].
struct Assignment {
  std::vector<int> light_of;
  ArrayXd misfit;
  std::vector<std::string> changes;  // for people
  int first = 0, offset = 0;         // of the last change

  /// A few photographs that do not fit at all count no more than others.
  double score() const { return misfit.mean(); }
};

/// Photographs in any order, the same each time.
std::vector<int> random_order(int images) {
  std::vector<int> order(static_cast<std::size_t>(images));
  std::iota(order.begin(), order.end(), 0);
  Rng rng(static_cast<std::uint64_t>(images));
  for (std::size_t j = order.size() - 1; j > 0; --j) std::swap(order[j], order[rng.below(j + 1)]);
  return order;
}

/// Whether photographs show nothing but noise: pixels of a cell, which are some pixels apart, do not change
/// together from one photograph to the next. In captures of four scenes their correlation is 0.18 to 0.7, in
/// noise 0.00. Light of a few texels each, which no two pixels share, changes them by more than noise does.
bool show_no_light(const PixelSample& sample) {
  constexpr double max_correlation = 0.03, max_change = 0.3;
  double correlation = 0.0;
  std::vector<double> changes;  // relative, of each cell
  for (const PixelSample::Cell& cell : sample.cells) {
    double apart = 0.0, together = 0.0, mean = 0.0, series_count = 0.0;
    for (int c = 0; c < 3; ++c) {
      ArrayXd sum = ArrayXd::Zero(sample.images);
      for (const int p : cell.pixels) {
        const Eigen::Map<const Eigen::ArrayXf> series(sample.series(c, p), sample.images);
        if (!series.isFinite().all()) continue;
        const ArrayXd change = series.cast<double>() - series.cast<double>().mean();
        sum += change;
        apart += change.square().sum();
        mean += series.cast<double>().mean();
        ++series_count;
      }
      together += sum.square().sum();
    }
    const double pixels = series_count / 3.0;
    if (pixels < 2.0 || apart == 0.0 || !(mean > 0.0)) continue;
    correlation += (together / apart - 1.0) / (pixels - 1.0);
    changes.push_back(std::sqrt(apart * series_count / sample.images) / mean);
  }
  if (changes.empty() || correlation > max_correlation * static_cast<double>(changes.size())) return false;
  const auto middle = changes.begin() + std::ssize(changes) / 2;
  std::ranges::nth_element(changes, middle);
  return *middle < max_change;
}

/// Assignments of lights to photographs, by how well the photographs predict each other under them.
class PairingSearch {
 public:
  PairingSearch(const LightFeatures& lights, const PixelSample& sample) : images_(sample.images) {
    std::vector<int> all(images_);
    std::iota(all.begin(), all.end(), 0);
    const LightPredictors predictors(lights, all);
    power_ = ArrayXd::Constant(images_, 1e-20);
    for (int c = 0; c < 3; ++c) {
      inverse_[c] = predictors.inverse(c, 1.0);
      leave_one_out_[c] = predictors.leave_one_out(c, 1.0);
      series_[c] = measured_series(sample, c, max_pixels);
      series_[c].array().rowwise() /= series_[c].colwise().norm().array() + 1e-20f;
      power_ += series_[c].rowwise().squaredNorm().cast<double>().array();
      const MatrixXf of_lights = lights.of_channel[c][0].transpose().cast<float>();
      const double misfit = criterion(leave_one_out_[c], of_lights);
      light_misfit_ += misfit / 3.0;
      const MatrixXf exchanged = of_lights(random_order(images_), Eigen::all);
      light_gain_ += (criterion(leave_one_out_[c], exchanged) - misfit) / 3.0;
    }
  }

  bool usable() const { return series_[0].cols() >= 8; }
  int images() const { return images_; }
  /// Whether a right pairing would show: lights that have little in common, or nothing but their mean,
  /// predict no photograph.
  bool lights_predict_each_other() const {
    return relative(light_misfit_) < max_light_misfit && light_gain_ > min_light_gain;
  }

  Assignment assess(std::vector<int> light_of) const {
    std::array<ArrayXd, 3> of_light;
    tbb::parallel_for(0, 3, [&](int c) {
      of_light[c] = (leave_one_out_[c] * by_light(c, light_of)).rowwise().squaredNorm().cast<double>();
    });
    ArrayXd misfit = (of_light[0] + of_light[1] + of_light[2] + 1e-20)(light_of) / power_;
    return {std::move(light_of), misfit.log(), {}, 0, 0};
  }

  /// Power of what each of `photographs` is more than the photographs that are not among them predict under
  /// each of their lights, [photographs × their lights].
  MatrixXd differences(const std::vector<int>& light_of, const std::vector<int>& photographs) const {
    std::vector<int> lights, others;
    std::vector<char> among(images_, 0);
    for (const int j : photographs) {
      lights.push_back(light_of[j]);
      among[light_of[j]] = 1;
    }
    for (int k = 0; k < images_; ++k)
      if (!among[k]) others.push_back(k);
    const auto count = static_cast<Index>(photographs.size());
    MatrixXd result = MatrixXd::Zero(count, count);
    for (int c = 0; c < 3; ++c) {
      const MatrixXd known = by_light(c, light_of)(others, Eigen::all).cast<double>();
      const MatrixXd predicted =
          -inverse_[c](lights, lights).llt().solve(MatrixXd(inverse_[c](lights, others) * known));
      const MatrixXd shown = series_[c](photographs, Eigen::all).cast<double>();
      for (Index k = 0; k < count; ++k)
        result.col(k) += (shown.rowwise() - predicted.row(k)).rowwise().squaredNorm();
    }
    return result;
  }

  /// The same of photographs i and j.
  double difference(int i, int j) const {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) sum += (series_[c].row(i) - series_[c].row(j)).squaredNorm();
    return sum;
  }
  double power(int photograph) const { return power_[photograph]; }

 private:
  static constexpr int max_pixels = 96;
  // Four sets of natural lights have 0.28 to 0.49. 66 designed patterns, which have little in common, have
  // 0.57, and right pairs of them fit no better than others.
  static constexpr double max_light_misfit = 0.5;
  // Logarithm of the residual's power that the lights themselves lose when they are paired rightly and not at
  // random: natural lights 1.0 to 2.1, designed patterns 0.8 to 1.0, white noise of 32 texels 0.6 to 1.0, of
  // 96 to 192 texels at most 0.3.
  static constexpr double min_light_gain = 0.5;

  MatrixXf by_light(int channel, const std::vector<int>& light_of) const {
    MatrixXf rows(images_, series_[channel].cols());
    rows(light_of, Eigen::all) = series_[channel];
    return rows;
  }

  int images_;
  std::array<MatrixXd, 3> inverse_;
  std::array<MatrixXf, 3> leave_one_out_, series_;  // each pixel's power is 1
  ArrayXd power_;                                   // of each photograph
  double light_misfit_ = 0.0, light_gain_ = 0.0;
};

/// Photographs from `first` on show the light `offset` further, in a circle among themselves.
std::vector<int> with_offset(std::vector<int> light_of, int first, int offset) {
  const auto from = light_of.begin() + first;
  const auto count = light_of.end() - from;
  std::rotate(from, from + (offset % count + count) % count, light_of.end());
  return light_of;
}

/// Offsets that are tried in any capture, and from any photograph on in doubtful ones; places that are tried
/// first; offsets that are found one after the other.
constexpr int max_offset = 3, max_later_offset = 2, coarse_places = 32, max_changes = 5;
/// Logarithm of the residual's power that another pairing must gain in each photograph whose light changes,
/// and of all together: 2 is a factor of 2.7 in the residual.
constexpr double pairing_gain = 0.7, min_total_gain = 8.0;
/// Pairs of photographs and lights that belong together leave less than that.
constexpr double max_residual = 0.25;
/// Of the residual, for a pairing that fits better but not well enough to be used: it is told.
constexpr double clearly_less = 0.7;
/// Pairs that are not so much better than random ones are in doubt, or say nothing at all.
constexpr double doubtful_gain = 2.5, no_gain = 0.5;
/// Of the residual's power, against the typical photograph's: photographs beyond the first do not fit, below
/// the second they do; one that shows another's light fits that much better with it.
constexpr double stands_out = 4.0, fits = 16.0, fits_better = 3.0;

std::string offset_text(int offset) {
  return std::string("the light of ") + std::to_string(std::abs(offset)) +
         (std::abs(offset) == 1 ? " frame " : " frames ") + (offset > 0 ? "later" : "earlier");
}

bool is_better(const Assignment& candidate, const Assignment& than) {
  int moved = 0;
  for (std::size_t j = 0; j < than.light_of.size(); ++j) moved += candidate.light_of[j] != than.light_of[j];
  const double gain = (than.misfit - candidate.misfit).sum();
  return gain > std::max(pairing_gain * moved, min_total_gain);
}

double typical_misfit(const Assignment& pairing) {
  std::vector<double> ordered(pairing.misfit.begin(), pairing.misfit.end());
  std::ranges::sort(ordered);
  return ordered[ordered.size() / 2];
}

/// Photographs whose misfit stands out, if they are few.
std::vector<int> misfits_of(const Assignment& pairing) {
  const double limit = typical_misfit(pairing) + std::log(stands_out);
  std::vector<int> found;
  for (Index j = 0; j < pairing.misfit.size(); ++j)
    if (pairing.misfit[j] > limit) found.push_back(static_cast<int>(j));
  if (4 * std::ssize(found) > pairing.misfit.size()) found.clear();
  return found;
}

/// Tries other pairings from the photographs' names on.
class Pairing {
 public:
  Pairing(const PairingSearch& search, std::span<const CaptureFrame> frames, const RunContext& run)
      : search_(search), frames_(frames), run_(run) {
    std::vector<int> as_paired(search.images());
    std::iota(as_paired.begin(), as_paired.end(), 0);
    best_ = search.assess(as_paired);
    before_ = best_.score();
    random_ = search.assess(random_order(search.images())).score();
  }

  double before() const { return before_; }
  double after() const { return best_.score(); }
  bool is_doubtful() const { return random_ - before_ < doubtful_gain; }
  bool says_nothing() const { return random_ - before_ < no_gain; }

  /// The offset of all photographs, at most `farthest`, or, if `later`, of those from some photograph on (one
  /// before it is doubled or missing) that fits best. Returns whether it fits better than none.
  bool try_offsets(int farthest, bool later) {
    const int images = search_.images(), step = std::max(1, images / coarse_places);
    std::optional<Assignment> found;
    int place = 0;
    const auto try_from = [&](int first, int reach) {
      for (int offset = -reach; offset <= reach; ++offset)
        if (offset != 0 && keep_better(found, first, offset)) place = first;
    };
    try_from(0, farthest);
    for (int first = 1; later && first + 2 <= images; first += step) try_from(first, max_later_offset);
    const int nearest = place, last = std::min(place + step, images - 1);
    for (int first = std::max(1, nearest - step + 1); nearest > 0 && first < last; ++first)
      try_from(first, max_later_offset);
    if (!found || !is_better(*found, best_)) return false;
    // The light maps of those at the end of the offset need not be there.
    const int offset = found->offset;
    for (int i = 0; i < std::abs(offset); ++i) doubtful_[offset > 0 ? images - 1 - i : found->first + i] = 1;
    best_ = std::move(*found);
    return true;
  }

  /// Gives photographs that do not fit each other's lights where they fit.
  void try_exchanges() {
    const std::vector<int> misfits = misfits_of(best_);
    if (misfits.size() < 2) return;
    const MatrixXd differs = search_.differences(best_.light_of, misfits);
    const double fitting = fitting_power();
    std::vector<Index> light_of(misfits.size(), -1);
    std::vector<char> taken(misfits.size(), 0);
    while (true) {  // the closest first
      double least = 1.0 / fits_better;
      Index photograph = -1, light = -1;
      for (Index j = 0; j < differs.rows(); ++j)
        for (Index k = 0; k < differs.cols(); ++k) {
          const double ratio = differs(j, k) / std::max(differs(j, j), 1e-20);
          if (light_of[j] >= 0 || taken[k] || ratio >= least ||
              differs(j, k) > fitting * search_.power(misfits[j]))
            continue;
          least = ratio;
          photograph = j;
          light = k;
        }
      if (photograph < 0) break;
      light_of[photograph] = light;
      taken[light] = 1;
    }
    // Exchanged photographs are circles: the light of each is another's.
    for (bool is_open = true; is_open;) {
      is_open = false;
      for (std::size_t j = 0; j < light_of.size(); ++j) {
        if (light_of[j] < 0 || taken[j]) continue;
        taken[light_of[j]] = 0;
        light_of[j] = -1;
        is_open = true;
      }
    }
    exchange(misfits, light_of);
  }

  /// Photographs at the ends of offsets whose light maps are not there lose theirs.
  std::vector<int> result() {
    std::vector<int> light_of = best_.light_of;
    for (const int j : misfits_of(best_)) {
      if (!doubtful_[j]) continue;
      light_of[j] = -1;
      const double same = fitting_power() * search_.power(j);
      const auto shows_same = [&](int i) {
        return i >= 0 && i < search_.images() && search_.difference(i, j) < same;
      };
      const int twin = shows_same(j - 1) ? j - 1 : j + 1;
      best_.changes.push_back(shows_same(twin) ? name(std::min(j, twin)) + " and " + name(std::max(j, twin)) +
                                                     " show the same light"
                                               : name(j) + " shows the light of no light map");
    }
    return light_of;
  }

  bool has_changed() const { return !best_.changes.empty(); }
  std::string text() const {
    constexpr std::size_t max_named = 5;
    std::string text;
    for (std::size_t i = 0; i < std::min(max_named, best_.changes.size()); ++i)
      text += (i == 0 ? "" : "; ") + best_.changes[i];
    return best_.changes.size() > max_named ? text + "; and more" : text;
  }

 private:
  const std::string& name(int j) const { return frames_[static_cast<std::size_t>(j)].name; }

  bool keep_better(std::optional<Assignment>& found, int first, int offset) const {
    run_.throw_if_stopped();
    Assignment candidate = search_.assess(with_offset(best_.light_of, first, offset));
    if (found && candidate.score() >= found->score()) return false;
    candidate.changes = best_.changes;
    candidate.changes.push_back(first == 0 ? "every photograph shows " + offset_text(offset)
                                           : "from " + name(first) + " on each photograph shows " +
                                                 offset_text(offset));
    candidate.first = first;
    candidate.offset = offset;
    found = std::move(candidate);
    return true;
  }

  /// Of a photograph's own power: differences below that are those of photographs that fit.
  double fitting_power() const { return fits * std::exp(typical_misfit(best_)); }

  /// Photograph misfits[i] shows the light of misfits[light_of[i]], where that is not −1.
  void exchange(const std::vector<int>& misfits, const std::vector<Index>& light_of) {
    std::vector<int> assigned = best_.light_of;
    auto changes = best_.changes;
    for (std::size_t i = 0; i < misfits.size(); ++i) {
      if (light_of[i] < 0) continue;
      const auto k = static_cast<std::size_t>(light_of[i]);
      assigned[misfits[i]] = best_.light_of[misfits[k]];
      if (light_of[k] != static_cast<Index>(i))
        changes.push_back(name(misfits[i]) + " shows the light of " + name(misfits[k]));
      else if (i < k)
        changes.push_back(name(misfits[i]) + " and " + name(misfits[k]) + " are exchanged");
    }
    best_ = search_.assess(assigned);
    best_.changes = std::move(changes);
  }

  const PairingSearch& search_;
  std::span<const CaptureFrame> frames_;
  const RunContext& run_;
  Assignment best_;
  double before_ = 0.0, random_ = 0.0;
  std::vector<char> doubtful_ = std::vector<char>(frames_.size(), 0);  // whether their light maps are there
};

}  // namespace

std::vector<int> find_pairing(const LightFeatures& lights, const PixelSample& sample,
                              std::span<const CaptureFrame> frames, bool doubtful, RigFinding& finding,
                              const RunContext& run) {
  finding.effect = "pairing";
  finding.measured = "photographs and light maps belong together as they are paired";
  if (sample.images < min_frames_for_rig) return {};
  const PairingSearch search(lights, sample);
  if (!search.usable()) return {};
  Pairing pairing(search, frames, run);
  finding.residual_before = finding.residual_after = relative(pairing.before());
  doubtful = doubtful || pairing.is_doubtful();
  for (int changes = 0; changes < max_changes; ++changes)
    if (!pairing.try_offsets(doubtful ? sample.images / 2 : max_offset, doubtful)) break;
  pairing.try_exchanges();
  const std::vector<int> light_of = pairing.result();
  const double after = relative(pairing.after());
  if (!pairing.has_changed() || (after > max_residual && after > clearly_less * relative(pairing.before()))) {
    if (!pairing.says_nothing()) return {};
    const bool is_noise = show_no_light(sample);
    if (!is_noise && !search.lights_predict_each_other()) return {};
    finding.state = RigFinding::State::unusable;
    finding.measured = is_noise ? "photographs do not change with the light: they differ by noise alone"
                                : "photographs fit their light maps no better than any others";
    return {};
  }
  finding.measured = pairing.text();
  finding.residual_after = after;
  for (int j = 0; j < sample.images; ++j)
    if (light_of[j] >= 0) finding.amount = std::max<double>(finding.amount, std::abs(light_of[j] - j));
  finding.state = RigFinding::State::suspicious;
  if (finding.residual_after > max_residual) return {};
  finding.state = RigFinding::State::corrected;
  return light_of;
}

}  // namespace refield
