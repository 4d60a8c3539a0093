// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_merge.h"

#include <cmath>
#include <numeric>

#include "acquire/calibrate/calibration.h"
#include "core/base/linear_algebra.h"
#include "core/base/number_text.h"
#include "core/image/metrics.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

constexpr std::size_t max_samples = 30000;  // of an exposure
constexpr double another_exposure = 1.1;    // ratio of times from which on two exposures are compared
constexpr double tolerated_spread = 0.05;   // 8-bit files of a camera with the sRGB curve: below 0.02
constexpr double tolerated_factor = 0.10;   // 1/15, 1/30, 1/60 s stand for 1/16, 1/32, 1/64 s: up to 0.07
constexpr double share_of_range_clipped = 0.96;  // cameras bend samples below full scale

std::string digits(double value, int significant = 3) {
  return formatted("%.*g", significant, value);
}

std::string percent(double share) {
  return digits(100.0 * share, share < 0.1 ? 2 : 3) + " %";
}

double range_of(const BracketSamples& bracket) {
  return bracket.bits == 0 ? std::numeric_limits<double>::infinity()
                           : static_cast<double>((1 << bracket.bits) - 1);
}

/// From where on samples are left out as clipped: below what the files hold at most, for the level at which
/// they clip may lie below full scale (12 bits in 16).
double clip_level_of(const BracketSamples& bracket, const BracketCamera& camera) {
  double highest = 0.0;
  for (const auto& exposure : bracket.values)
    for (const float value : exposure) highest = std::max(highest, static_cast<double>(value));
  const double stated = camera.saturation.value_or(
      fs::is_regular_file(camera.response) ? read_camera_calibration(camera.response).saturation_dn
                                           : range_of(bracket));
  return share_of_range_clipped * std::min(stated, highest);
}

/// Stored samples to light above black, as a share of the range.
class Linearisation {
 public:
  Linearisation(const BracketSamples& bracket, const BracketCamera& camera) {
    if (bracket.bits == 0) {
      black_ = camera.black.value_or(0.0);
      range_ = camera.saturation.value_or(bracket.highest.level) - black_;
      return;
    }
    BracketCamera of_bracket = camera;
    of_bracket.stated = bracket.response;
    if (!of_bracket.black) of_bracket.black = bracket.black;
    const CameraCalibration calibration = bracket_calibration(of_bracket, bracket.bits);
    table_ = calibration.linear_from_dn;
    black_ = calibration.black_level_dn;
    range_ = table_[static_cast<std::size_t>(calibration.saturation_dn)] - black_;
  }
  double operator()(float value) const {
    const double linear =
        table_.empty() ? value
                       : table_[std::min(static_cast<std::size_t>(std::max(0.0f, value)), table_.size() - 1)];
    return (linear - black_) / range_;
  }

 private:
  std::vector<float> table_;
  double black_ = 0.0;
  double range_ = 1.0;
};

/// Mean without the outer tenths: movement and noise do little to it.
double trimmed_mean(std::vector<double> values) {
  std::ranges::sort(values);
  const std::size_t cut = values.size() / 10;
  const auto first = values.begin() + static_cast<std::ptrdiff_t>(cut);
  const auto last = values.end() - static_cast<std::ptrdiff_t>(cut);
  return std::accumulate(first, last, 0.0) / static_cast<double>(last - first);
}

/// Log of the radiance by exposure `i + 1` over that by exposure `i`, in classes of brightness.
struct PairComparison {
  std::vector<double> log_ratio;  ///< of each class with enough samples
  std::size_t compared = 0;
};

PairComparison compare_pair(const BracketSamples& bracket, std::size_t i, const Linearisation& linear,
                            double clipped) {
  constexpr int classes = 12;
  constexpr std::size_t enough = 40;
  constexpr double darkest = 0.01;  // of the range: below, rounding and black level count
  const double ratio = bracket.seconds[i + 1] / bracket.seconds[i];
  const double darkest_longer = darkest * ratio;
  std::array<std::vector<double>, classes> found;
  for (std::size_t s = 0; s < bracket.values[i].size(); ++s) {
    const float longer_value = bracket.values[i + 1][s];
    if (longer_value >= clipped || bracket.values[i][s] >= clipped) continue;
    // Classes by the longer exposure alone: choosing by the shorter, noisier one would bias the mean.
    const double longer = linear(longer_value), shorter = linear(bracket.values[i][s]);
    if (!(longer >= darkest_longer && longer < 1.0)) continue;
    const double place = std::log(longer / darkest_longer) / std::log(1.0 / darkest_longer);
    found[std::min(classes - 1, static_cast<int>(place * classes))].push_back(
        std::log(longer / (std::max(shorter, 0.1 * darkest) * ratio)));
  }
  PairComparison comparison;
  for (auto& values : found)
    if (values.size() >= enough) {
      comparison.compared += values.size();
      comparison.log_ratio.push_back(trimmed_mean(std::move(values)));
    }
  return comparison;
}

/// Appends means over blocks of one channel, of those that are even in all exposures.
void add_block_means(const Bracket& bracket, const std::vector<std::size_t>& order, int block,
                     BracketSamples& samples) {
  constexpr double tolerated_deviation = 0.04;  // of the range, RMS within a block
  const RawFrame& first = bracket.files[order[0]].frame;
  const double full = range_of(samples);
  const double blocks = static_cast<double>(first.width) * first.height / (block * block);
  const int step = block * std::max(1, static_cast<int>(std::sqrt(3.0 * blocks / max_samples)));
  const double count = block * block;
  std::vector<float> means(order.size());
  for (int y = 0; y + block <= first.height; y += step)
    for (int x = 0; x + block <= first.width; x += step)
      for (int c = 0; c < 3; ++c) {
        bool even = true;
        for (std::size_t k = 0; k < order.size(); ++k) {
          const RawFrame& frame = bracket.files[order[k]].frame;
          double sum = 0.0, squares = 0.0;
          for (int v = y; v < y + block; ++v)
            for (int u = x; u < x + block; ++u) {
              const double sample = frame.samples[(static_cast<std::size_t>(v) * frame.width + u) * 3 + c];
              sum += sample;
              squares += sample * sample;
            }
          means[k] = static_cast<float>(sum / count);
          const double variance = squares / count - (sum / count) * (sum / count);
          even = even && variance < std::pow(tolerated_deviation * full, 2);
        }
        if (!even) continue;
        for (std::size_t k = 0; k < order.size(); ++k) samples.values[k].push_back(means[k]);
      }
}

/// A scene point that several exposures hold.
struct ScenePoint {
  double brightness;
  std::size_t bracket, sample;
};

constexpr double darkest_share = 2.0 / 255.0;  // of the range: darker samples say little for their rounding
constexpr double brightest_share = 252.0 / 255.0;  // cameras bend what is above

bool is_usable(double value, double full) {
  return value > darkest_share * full && value < brightest_share * full;
}

/// Points of all brightnesses alike: most of a frame may be dark.
std::vector<ScenePoint> points_of(std::span<const BracketSamples> brackets) {
  constexpr std::size_t levels = 64, max_points_of_level = 100;
  const double full = range_of(brackets.front());
  std::array<std::vector<ScenePoint>, levels> by_level;
  for (std::size_t b = 0; b < brackets.size(); ++b)
    for (std::size_t s = 0; s < brackets[b].values.front().size(); ++s) {
      double sum = 0.0;
      int usable = 0;
      for (const auto& exposure : brackets[b].values)
        if (is_usable(exposure[s], full)) {
          sum += exposure[s];
          ++usable;
        }
      if (usable >= 2)
        by_level[static_cast<std::size_t>(sum / usable / full * levels)].push_back({sum / usable, b, s});
    }
  std::vector<ScenePoint> points;
  for (const auto& level : by_level) {
    const std::size_t count = std::min(level.size(), max_points_of_level);
    for (std::size_t k = 0; k < count; ++k) points.push_back(level[k * level.size() / count]);
  }
  return points;
}

/// Log of an inverse response: that of sRGB plus hat functions over the encoded range.
class LogResponse {
 public:
  static constexpr int knots = 33;

  /// Weighted least squares for the coefficients, the light of each point eliminated.
  void fit(std::span<const BracketSamples> brackets, std::span<const ScenePoint> points, double full) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(knots, knots);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(knots);
    std::vector<Row> rows;
    for (const ScenePoint& point : points) {
      rows_of(brackets[point.bracket], point.sample, full, rows);
      Eigen::VectorXd mean = Eigen::VectorXd::Zero(knots);
      double total = 0.0, mean_value = 0.0;
      for (const Row& row : rows) {
        total += row.weight;
        mean_value += row.weight * row.value;
        mean(row.knot) += row.weight * (1.0 - row.above);
        mean(row.knot + 1) += row.weight * row.above;
      }
      for (const Row& row : rows) {
        Eigen::VectorXd a = -mean / total;
        a(row.knot) += 1.0 - row.above;
        a(row.knot + 1) += row.above;
        normal.noalias() += row.weight * a * a.transpose();
        right += row.weight * (row.value - mean_value / total) * a;
      }
    }
    // Exposure times of one ratio leave free any function that repeats with that ratio of light: smoothness
    // decides there, and is weak beside what the data tell.
    const double data = normal.trace() / knots;
    constexpr double smoothness = 0.1, flatness = 1e-6;
    for (int k = 0; k + 2 < knots; ++k) {
      Eigen::VectorXd bend = Eigen::VectorXd::Zero(knots);
      bend.segment<3>(k) = Eigen::Vector3d(1.0, -2.0, 1.0);
      normal += smoothness * data * bend * bend.transpose();
    }
    for (int k = 0; k + 1 < knots; ++k) {
      Eigen::VectorXd slope = Eigen::VectorXd::Zero(knots);
      slope.segment<2>(k) = Eigen::Vector2d(-1.0, 1.0);
      normal += flatness * data * slope * slope.transpose();
    }
    normal(knots - 1, knots - 1) += data;  // the scale is free
    coefficients_ = solve_symmetric(normal, right);
  }

  double light(double share) const {
    const auto [knot, above] = place_of(share);
    return linear_from_srgb(static_cast<float>(share)) *
           std::exp(coefficients_(knot) * (1.0 - above) + coefficients_(knot + 1) * above);
  }

  /// RMS of the samples about the curve, relative, weighted as in the fit.
  double residual(std::span<const BracketSamples> brackets, std::span<const ScenePoint> points,
                  double full) const {
    double squares = 0.0, total = 0.0;
    std::vector<Row> rows;
    for (const ScenePoint& point : points) {
      rows_of(brackets[point.bracket], point.sample, full, rows);
      double sum = 0.0, sum_of_squares = 0.0, weights = 0.0;
      for (const Row& row : rows) {
        const double of_curve =
            coefficients_(row.knot) * (1.0 - row.above) + coefficients_(row.knot + 1) * row.above;
        sum += row.weight * (row.value - of_curve);
        sum_of_squares += row.weight * std::pow(row.value - of_curve, 2);
        weights += row.weight;
      }
      squares += sum_of_squares - sum * sum / weights;
      total += weights;
    }
    return std::sqrt(std::max(squares, 0.0) / total);
  }

 private:
  struct Row {
    int knot;
    double above;  // share of the next knot
    double value, weight;
  };
  struct Place {
    int knot;
    double above;
  };

  static Place place_of(double share) {
    const double x = std::clamp(share, 0.0, 1.0) * (knots - 1);
    const int knot = std::min(static_cast<int>(x), knots - 2);
    return {knot, x - knot};
  }

  void rows_of(const BracketSamples& bracket, std::size_t sample, double full, std::vector<Row>& rows) const {
    constexpr double noise = 1.0 / 255.0;  // of the range: rounding, noise, compression
    constexpr double unevenness = 0.01;    // of light: shutters are no more exact
    rows.clear();
    for (std::size_t i = 0; i < bracket.values.size(); ++i) {
      const double value = bracket.values[i][sample];
      if (!is_usable(value, full)) continue;
      const double share = value / full;
      const double log_light = std::log(linear_from_srgb(static_cast<float>(share)));
      const double log_slope =
          (std::log(linear_from_srgb(static_cast<float>(share + 0.002))) - log_light) / 0.002;
      const auto [knot, above] = place_of(share);
      rows.push_back({knot, above, std::log(bracket.seconds[i]) - log_light,
                      1.0 / (std::pow(noise * log_slope, 2) + unevenness * unevenness)});
    }
  }

  Eigen::VectorXd coefficients_ = Eigen::VectorXd::Zero(knots);
};

ExposureAgreement worst_agreement(std::span<const BracketSamples> brackets, const BracketCamera& camera,
                                  std::size_t& worst) {
  ExposureAgreement result;
  double squares = 0.0, weights = 0.0;
  for (std::size_t b = 0; b < brackets.size(); ++b) {
    const ExposureAgreement one = compare_exposures(brackets[b], camera);
    squares += one.spread * one.spread * static_cast<double>(one.compared);
    weights += static_cast<double>(one.compared);
    result.compared += one.compared;
    if (std::abs(std::log(one.factor)) > std::abs(std::log(result.factor))) {
      worst = b;
      result.factor = one.factor;
      result.shorter = one.shorter;
      result.longer = one.longer;
    }
  }
  result.spread = weights > 0.0 ? std::sqrt(squares / weights) : 0.0;
  return result;
}

std::string factor_text(const BracketSamples& bracket, const ExposureAgreement& agreement) {
  const double stated = bracket.seconds[agreement.longer] / bracket.seconds[agreement.shorter];
  return bracket.paths[agreement.longer].string() + ": was exposed " + digits(stated) + " times as long as " +
         bracket.paths[agreement.shorter].filename().string() + " by the stated times, but is " +
         digits(stated * agreement.factor) + " times as bright";
}

/// Whether a contrast curve may explain the factor: where it acts as a power of the light, as in the middle
/// of its range, exposures differ by one factor. Only several ratios of times tell it from a wrong time.
bool is_contrast(const BracketSamples& bracket, const ExposureAgreement& agreement) {
  // Picture styles have powers up to 1.3; a bracketing step taken for another is 1/2, 2/3, 3/2 or 2.
  constexpr double lowest_power = 0.75, highest_power = 1.4;
  const double stated = bracket.seconds[agreement.longer] / bracket.seconds[agreement.shorter];
  const double power = 1.0 + std::log(agreement.factor) / std::log(stated);
  return bracket.seconds.size() >= 3 && power > lowest_power && power < highest_power;
}

std::string name_of_response(const BracketCamera& camera, int bits) {
  if (!camera.response.empty()) return "'" + camera.response + "'";
  const std::string response = response_of(camera, bits);
  return response == "srgb"     ? "the sRGB curve"
         : response == "linear" ? "a linear response"
                                : "'" + response + "'";
}

constexpr const char* unconfirmed_curve =
    "8-bit files with one exposure per view are taken to have the sRGB curve, which one exposure cannot "
    "confirm; a camera's contrast curve makes errors of 20 % and more. Photograph brackets, or give the "
    "camera's curve with --response (docs/guide/import.md)";
constexpr const char* check_exposures_text = "; check --exposures, ISO speed and aperture";

/// What to check when exposures contradict a response that is known.
const char* remedy_without_curve(const BracketSamples& bracket) {
  return bracket.bits == 0 || bracket.is_sensor
             ? "; check exposure times, black level, movement and flicker"
             : "; leave --response and --black out, or estimate the curve with 'refield acquire import … -o "
               "camera.toml'; check also exposure times, movement and flicker";
}

/// Estimates the response and gives it to the camera where the exposures agree with it. Returns what to note;
/// `wrong` says what the exposures contradict, `bends` that they contradict the response's shape.
std::string estimate_curve(std::span<const BracketSamples> brackets, const std::string& wrong, bool bends,
                           BracketCamera& camera) {
  BracketCamera estimated = camera;
  try {
    estimated.curve = estimate_response(brackets).linear_from_dn;
  } catch (const InputError& error) {
    return wrong + ", as if by a contrast curve of the camera's, and " + error.what();
  }
  std::size_t worst = 0;
  const ExposureAgreement agreement = worst_agreement(brackets, estimated, worst);
  if (!bends && std::abs(agreement.factor - 1.0) > tolerated_factor) return wrong + check_exposures_text;
  if (agreement.spread > tolerated_spread)
    return wrong + ", and no response curve brings them nearer than " + percent(agreement.spread) +
           "; check exposure times, automatic white balance, local contrast, movement and flicker";
  camera.curve = std::move(estimated.curve);
  return wrong + ": the camera applies a contrast curve of its own. Its response was estimated from " +
         std::to_string(brackets.size()) + (brackets.size() == 1 ? " bracket" : " brackets") +
         ", and the exposures now agree to " + percent(agreement.spread) +
         "; --response overrules the estimate";
}

/// Sets the level at which samples clip, where they show it. Returns what to note.
std::optional<std::string> settle_saturation(std::span<const BracketSamples> brackets,
                                             BracketCamera& camera) {
  if (camera.saturation || fs::is_regular_file(camera.response)) return std::nullopt;
  double highest = 0.0;
  for (const BracketSamples& bracket : brackets) highest = std::max(highest, bracket.highest.level);
  const HighestSamples* found = nullptr;
  std::size_t alike = 0;
  for (const BracketSamples& bracket : brackets) {
    constexpr double same = 0.999;
    if (!bracket.highest.piles_up || bracket.highest.level < same * highest) continue;
    ++alike;
    if (!found || bracket.highest.is_saturation > found->is_saturation) found = &bracket.highest;
  }
  if (!found || (!found->is_saturation && alike < 2)) return std::nullopt;
  const std::string many = std::to_string(found->at_level) + " samples of " + found->file.string() +
                           " share the level " + digits(highest, 6) + ", and none exceeds it";
  if (!found->is_saturation)
    return many + "; if the camera saturates there, give --saturation " + digits(highest, 6);
  camera.saturation = highest;
  return many + ": it is taken as saturation; --saturation overrules it";
}

constexpr double exact_ratio = 0.015;  // rounding of cameras is more, noise of 8 bits at most 0.01

/// Log of measured over stated ratio of two neighbouring exposure times.
struct TimeRatio {
  double log = 0.0;
  double uncertainty = 0.0;  ///< standard error
};

/// [exposures − 1]; nullopt where exposures do not overlap.
std::vector<std::optional<TimeRatio>> measure_ratios(std::span<const BracketSamples> brackets,
                                                     const BracketCamera& camera) {
  constexpr std::ptrdiff_t enough = 3;  // classes of brightness
  std::vector<std::optional<TimeRatio>> ratios(brackets.front().seconds.size() - 1);
  for (std::size_t i = 0; i < ratios.size(); ++i) {
    std::vector<double> logs, deviations;
    for (const BracketSamples& bracket : brackets) {
      if (bracket.seconds[i + 1] < another_exposure * bracket.seconds[i]) continue;
      const PairComparison pair =
          compare_pair(bracket, i, Linearisation(bracket, camera), clip_level_of(bracket, camera));
      const auto classes = static_cast<std::ptrdiff_t>(pair.log_ratio.size());
      // The brighter half: the logarithm of noisy dark samples has a bias. An estimated curve has it, too.
      const std::ptrdiff_t first = camera.curve.empty() ? classes / 2 : 0;
      if (classes >= enough)
        logs.push_back(trimmed_mean({pair.log_ratio.begin() + first, pair.log_ratio.end()}));
    }
    if (logs.empty()) continue;
    const double middle = upper_median(logs);
    for (const double log : logs) deviations.push_back(std::abs(log - middle));
    // 1.4826 · MAD estimates the deviation, and a median has 1.2533 times the standard error of a mean.
    ratios[i] = {middle, 1.86 * upper_median(deviations) / std::sqrt(static_cast<double>(logs.size()))};
  }
  return ratios;
}

std::string times_text(const std::vector<double>& seconds) {
  std::string text;
  for (const double time : seconds) text += (text.empty() ? "" : ", ") + digits(time, 4);
  return text + " s";
}

/// Times with measured ratios, from the shortest on; the stated ones where nothing contradicts them.
std::vector<double> times_by_ratio(std::span<const BracketSamples> brackets, const BracketCamera& camera) {
  constexpr double certain = 4.0;
  constexpr double max_spread = 0.02;  // beyond, the response is doubtful, and the ratio with it
  std::vector<double> times = brackets.front().seconds;
  std::size_t worst = 0;
  if (worst_agreement(brackets, camera, worst).spread > max_spread) return times;
  const auto ratios = measure_ratios(brackets, camera);
  for (std::size_t i = 0; i < ratios.size(); ++i)
    if (ratios[i] && std::abs(ratios[i]->log) > std::max(exact_ratio, certain * ratios[i]->uncertainty) &&
        std::abs(ratios[i]->log) < std::log1p(tolerated_factor))
      for (std::size_t k = i + 1; k < times.size(); ++k) times[k] *= std::exp(ratios[i]->log);
  return times;
}

/// The times that cameras mean by those they state, with their response curve, where that fits clearly
/// better. A curve serves any times of one common ratio, but only the right ones where ratios differ.
std::vector<double> times_by_name(std::span<const BracketSamples> brackets, BracketCamera& camera) {
  constexpr double clearly = 0.92;  // 5 brackets of 80×60 pixels with 1/60, 1/15 and 1/4 s have 0.80
  std::vector<double> times = brackets.front().seconds;
  for (double& time : times) time = std::exp2(std::round(3.0 * std::log2(time)) / 3.0);
  std::vector<BracketSamples> renamed(brackets.begin(), brackets.end());
  for (BracketSamples& bracket : renamed) bracket.seconds = times;
  ResponseEstimate named = estimate_response(renamed);
  if (named.residual > clearly * estimate_response(brackets).residual) return brackets.front().seconds;
  camera.curve = std::move(named.linear_from_dn);
  return times;
}

}  // namespace

BracketSamples samples_of(const Bracket& bracket) {
  BracketSamples samples;
  const BracketFile& first = bracket.files.at(0);
  samples.bits = first.bits;
  samples.response = first.response;
  if (first.raw_levels) samples.black = first.raw_levels->black;
  samples.automatic_white_balance = !first.is_raw && first.settings.white_balance == 0;
  samples.highest = highest_samples(bracket);
  samples.is_sensor =
      first.is_raw || (first.frame.layout != PixelLayout::rgb && first.frame.layout != PixelLayout::grey);
  std::vector<std::size_t> order(bracket.files.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return bracket.exposures[i]; });
  for (const std::size_t i : order) {
    samples.paths.push_back(bracket.paths[i]);
    samples.seconds.push_back(bracket.exposures[i].count());
    samples.values.emplace_back();
  }
  const RawFrame& frame = first.frame;
  // Noise and compression would bias a curve: means of small, even blocks of developed pictures have less.
  constexpr int largest_block = 4, blocks_across = 16;
  const int block = std::clamp(std::min(frame.width, frame.height) / blocks_across, 1, largest_block);
  if (first.bits > 0 && frame.layout == PixelLayout::rgb && block > 1) {
    add_block_means(bracket, order, block, samples);
    return samples;
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    const BracketFile& file = bracket.files[order[k]];
    const std::size_t size = file.bits == 0 ? file.linear.values.size() : file.frame.samples.size();
    // An odd step, no multiple of 3: all channels and all colours of a Bayer pattern.
    std::size_t step = std::max<std::size_t>(1, size / max_samples) | 1;
    while (step % 3 == 0) step += 2;
    for (std::size_t s = 0; s < size; s += step)
      samples.values[k].push_back(file.bits == 0 ? file.linear.values[s]
                                                 : static_cast<float>(file.frame.samples[s]));
  }
  return samples;
}

void require_brighter_with_time(const BracketSamples& bracket, const BracketCamera& camera) {
  constexpr std::size_t enough = 100;
  constexpr double lit = 0.05;  // of the highest: below, noise decides
  const double clipped = clip_level_of(bracket, camera);
  for (std::size_t i = 0; i + 1 < bracket.values.size(); ++i) {
    if (bracket.seconds[i + 1] < another_exposure * bracket.seconds[i]) continue;
    std::vector<float> growth;
    for (std::size_t s = 0; s < bracket.values[i].size(); ++s) {
      const float shorter = bracket.values[i][s], longer = bracket.values[i + 1][s];
      if (std::max(shorter, longer) >= lit * clipped && std::max(shorter, longer) < clipped)
        growth.push_back(longer - shorter);
    }
    if (growth.size() < enough) continue;
    const float middle = upper_median(std::move(growth));
    if (middle > 0.0f) continue;
    throw InputError(bracket.paths[i + 1], ": is ", middle < 0.0f ? "darker" : "no brighter", " than ",
                     bracket.paths[i], ", though its exposure time is ", digits(bracket.seconds[i + 1], 6),
                     " s instead of ", digits(bracket.seconds[i], 6),
                     " s; the times are swapped or wrong, or one photograph was given twice: correct "
                     "--exposures or the files");
  }
}

ExposureAgreement compare_exposures(const BracketSamples& bracket, const BracketCamera& camera) {
  const Linearisation linear(bracket, camera);
  const double clipped = clip_level_of(bracket, camera);
  ExposureAgreement agreement;
  double squares = 0.0, count = 0.0;
  constexpr double other_light = 0.2;  // log; less is noise and flicker of a repeated exposure
  for (std::size_t i = 0; i + 1 < bracket.values.size(); ++i) {
    const PairComparison pair = compare_pair(bracket, i, linear, clipped);
    if (pair.log_ratio.empty()) continue;
    const auto classes = static_cast<double>(pair.log_ratio.size());
    const double common = std::accumulate(pair.log_ratio.begin(), pair.log_ratio.end(), 0.0) / classes;
    const bool is_repeated = bracket.seconds[i + 1] < another_exposure * bracket.seconds[i];
    if (is_repeated && std::abs(common) < other_light) continue;
    agreement.compared += pair.compared;
    for (const double ratio : pair.log_ratio) squares += (ratio - common) * (ratio - common);
    count += classes;
    if (std::abs(common) > std::abs(std::log(agreement.factor))) {
      agreement.factor = std::exp(common);
      agreement.shorter = i;
      agreement.longer = i + 1;
    }
  }
  agreement.spread = count > 0.0 ? std::expm1(std::sqrt(squares / count)) : 0.0;
  return agreement;
}

ResponseEstimate estimate_response(std::span<const BracketSamples> brackets) {
  const double full = range_of(brackets.front());
  const std::vector<ScenePoint> points = points_of(brackets);
  double darkest = 1.0, brightest = 0.0;
  for (const ScenePoint& point : points)
    for (const auto& exposure : brackets[point.bracket].values)
      if (const double value = exposure[point.sample]; is_usable(value, full)) {
        darkest = std::min(darkest, value / full);
        brightest = std::max(brightest, value / full);
      }
  constexpr std::size_t enough = 300;
  constexpr double dark_enough = 0.25, bright_enough = 0.8;
  if (points.size() < enough || darkest > dark_enough || brightest < bright_enough)
    throw InputError("the camera's response cannot be estimated: ", points.size(),
                     " samples that two exposures hold reach from ", percent(darkest), " to ",
                     percent(brightest),
                     " of the range; photograph a view with darks and brights, with more exposures");
  LogResponse response;
  response.fit(brackets, points, full);
  ResponseEstimate estimate;
  estimate.places = points.size();
  estimate.residual = response.residual(brackets, points, full);
  std::vector<double> light;
  for (double value = 0.0; value <= full; value += 1.0) light.push_back(response.light(value / full));
  light = never_falling(std::move(light));
  for (const double value : light)
    estimate.linear_from_dn.push_back(static_cast<float>(full * value / light.back()));
  return estimate;
}

std::vector<std::string> settle_response(std::span<const BracketSamples> brackets, BracketCamera& camera) {
  for (const BracketSamples& bracket : brackets) require_brighter_with_time(bracket, camera);
  std::vector<std::string> notes;
  const BracketSamples& first = brackets.front();
  camera.stated = first.response;
  if (const auto note = settle_saturation(brackets, camera)) notes.push_back(*note);
  if (first.automatic_white_balance)
    notes.emplace_back(
        "the photographs were developed with automatic white balance, which may differ between them without "
        "a trace; fix it, or give the RAW files");
  const bool assumed = camera.response.empty() && !first.is_sensor && first.bits > 0;
  const std::string response = response_of(camera, first.bits);
  const bool several = std::ranges::any_of(brackets, [](const BracketSamples& bracket) {
    return bracket.seconds.back() >= another_exposure * bracket.seconds.front();
  });
  if (!several) {
    if (assumed && first.bits == 8 && response == "srgb")
      notes.emplace_back(unconfirmed_curve);
    else if (assumed && response != "linear")
      notes.push_back("the photographs are decoded by the curve that they state, " + response +
                      ", which one exposure cannot confirm; --response overrules it");
    return notes;
  }
  std::size_t worst = 0;
  const ExposureAgreement agreement = worst_agreement(brackets, camera, worst);
  const bool bends = agreement.spread > tolerated_spread;
  const bool off = std::abs(agreement.factor - 1.0) > tolerated_factor;
  if (!bends && !off) return notes;
  const std::string wrong = bends ? "the exposures contradict " + name_of_response(camera, first.bits) +
                                        " by " + percent(agreement.spread)
                                  : factor_text(brackets[worst], agreement);
  const bool may_be_a_curve = assumed && !camera.black;
  if (!bends && !(may_be_a_curve && is_contrast(brackets[worst], agreement)))
    notes.push_back(wrong + check_exposures_text);
  else if (!may_be_a_curve)
    notes.push_back(wrong + remedy_without_curve(first));
  else
    notes.push_back(estimate_curve(brackets, wrong, bends, camera));
  return notes;
}

std::string settle_times(std::span<const BracketSamples> brackets, BracketCamera& camera) {
  const std::vector<double> stated = brackets.front().seconds;
  const auto is_same = [&](const BracketSamples& bracket) {
    return std::ranges::equal(bracket.seconds, stated,
                              [](double a, double b) { return std::abs(a - b) < 1e-4 * b; });
  };
  if (stated.size() < 2 || !std::ranges::all_of(brackets, is_same)) return "";
  const std::vector<double> times =
      camera.curve.empty() ? times_by_ratio(brackets, camera) : times_by_name(brackets, camera);
  bool differs = false;
  for (std::size_t i = 1; i < times.size(); ++i)
    differs |= std::abs(times[i] / times[0] * stated[0] / stated[i] - 1.0) > exact_ratio;
  if (!differs) return "";
  for (std::size_t i = 0; i < times.size(); ++i)
    camera.measured_times.emplace_back(Seconds(stated[i]), Seconds(times[i]));
  return "the files state exposure times of " + times_text(stated) + ", but the exposures agree with " +
         times_text(times) + ", which are used: cameras round the times that they state";
}

}  // namespace refield
