// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibrate.h"

#include <tbb/parallel_for.h>
#include <Eigen/LU>

#include <cerrno>
#include <cmath>

#include "core/base/linear_algebra.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

constexpr int frames_watched = 24;
constexpr int frames_compared = 4;  // the last ones: what the step ends at
constexpr double arrived =
    0.2;  // of the step may be missing: a pulsing backlight makes single frames uncertain
constexpr double step_ratio = 4.0;

/// Levels of the frames that begin after the exposure was set.
std::vector<double> levels_after(CalibrationBench& bench, const Metering& metering, Seconds exposure,
                                 const RunContext& run) {
  std::vector<double> levels;
  const TimePoint made = bench.set_exposure(exposure);
  for (int i = 0; i < 8 * frames_watched && static_cast<int>(levels.size()) < frames_watched; ++i) {
    const RawFrame frame = bench.next_frame(metering.exposure, run);
    if (frame.exposure_start >= made) levels.push_back(mean_over(frame.samples, metering.lit));
  }
  if (static_cast<int>(levels.size()) < frames_watched)
    throw DeviceError(bench.camera().name, EIO,
                      "sends only frames that started before its settings changed; check that its time "
                      "stamps use the monotonic clock");
  return levels;
}

double end_of(const std::vector<double>& levels) {
  double sum = 0.0;
  for (int i = 1; i <= frames_compared; ++i) sum += levels[levels.size() - i];
  return sum / frames_compared;
}

/// The number of frames before the level stays near its end.
int frames_until(const std::vector<double>& levels, double from) {
  const double to = end_of(levels);
  int last = -1;
  for (std::size_t i = 0; i < levels.size(); ++i)
    if (std::abs(levels[i] - to) > arrived * std::abs(to - from)) last = static_cast<int>(i);
  return last + 1;
}

constexpr int flips_each_way = 14;
constexpr double settled_within = 0.01;

/// Integral from −∞ to t of a ramp from 0 at `latency` to 1 at `latency + settling`.
double ramp_integral(double t, double latency, double settling) {
  const double since = t - latency;
  if (since <= 0.0) return 0.0;
  if (since >= settling) return since - settling / 2.0;
  return since * since / (2.0 * settling);
}

double squared_error(const std::vector<ChangeFrame>& frames, double latency, double settling) {
  double sum = 0.0;
  for (const ChangeFrame& frame : frames) {
    const double share = (ramp_integral(frame.start_s + frame.exposure_s, latency, settling) -
                          ramp_integral(frame.start_s, latency, settling)) /
                         frame.exposure_s;
    sum += (frame.share - share) * (frame.share - share);
  }
  return sum;
}

/// One exposure's frames across one change of light.
struct Series {
  std::vector<RawFrame> frames;
  TimePoint flip;
};

Series frames_across(CalibrationBench& bench, std::uint8_t level, Seconds exposure, const RunContext& run) {
  Series series;
  series.flip = bench.show_at_once(level);
  // From frames that waited in the driver on to the first that begins after the patience is over.
  constexpr int most = 2000;
  for (int i = 0; i < most; ++i) {
    series.frames.push_back(bench.next_frame(exposure, run));
    if (series.frames.back().exposure_start - series.flip > bench.patience()) return series;
  }
  throw DeviceError(bench.camera().name, EIO,
                    "sends only frames from before the display's flip; check that camera and display stamp "
                    "times with the same clock");
}

double linear_mean(const RawFrame& frame, const Metering& metering, const CameraResponse& response) {
  double sum = 0.0;
  for (auto s : metering.lit) sum += response.linear_from_dn[frame.samples[s]];
  return sum / static_cast<double>(metering.lit.size());
}

constexpr int frames_taken = 72;
constexpr double lowest_hz = 20.0;
constexpr double highest_hz = 2000.0;
constexpr double least_depth = 2e-3;
constexpr double largest_depth = 1.4;    // a square wave between dark and twice the mean has 4/π
constexpr double least_explained = 0.5;  // of the variance; by chance once in a thousand measurements
constexpr double tolerated_error = 1e-3;
constexpr double two_pi = 2.0 * std::numbers::pi;

/// Means over the exposure of cos and sin of a frequency.
Eigen::Vector2d mean_wave(double hz, const ExposedLight& light) {
  const double w = two_pi * hz;
  const double end = light.start_s + light.exposure_s;
  return Eigen::Vector2d(std::sin(w * end) - std::sin(w * light.start_s),
                         std::cos(w * light.start_s) - std::cos(w * end)) /
         (w * light.exposure_s);
}

/// Square root of a frame's weight: the relative variance of shot noise falls with the exposure.
double root_weight(const ExposedLight& light) {
  return std::sqrt(light.exposure_s);
}

/// What remains of brightness once its smooth dependence on the exposure is divided out: the camera's
/// response, which is not known yet, bends it. In logarithms, where a gamma curve is a straight line. Short
/// exposures, which are noisy, count less.
class Deviation {
 public:
  explicit Deviation(const std::vector<ExposedLight>& light);
  /// Relative, frame by frame.
  Eigen::VectorXd values;
  /// Weighted columns without what the smooth dependence could take up.
  template <class Columns>
  Columns beside_smooth(const Columns& columns) const {
    const Columns weighted = weight_.asDiagonal() * columns;
    return weighted - smooth_ * (smooth_.transpose() * weighted);
  }
  /// RMS of what is neither smooth nor was taken from `values`.
  double rest() const { return beside_smooth(values).norm() / weight_.norm(); }

 private:
  Eigen::VectorXd weight_;
  Eigen::MatrixXd smooth_;  // orthonormal, weighted
};

Deviation::Deviation(const std::vector<ExposedLight>& light) {
  constexpr int terms = 5;
  const auto n = static_cast<Eigen::Index>(light.size());
  Eigen::MatrixXd smooth(n, terms);
  Eigen::VectorXd brightness(n);
  weight_.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    brightness(i) = std::log(light[i].light_per_second);
    weight_(i) = root_weight(light[i]);
    for (int k = 0; k < terms; ++k)
      smooth(i, k) = std::pow(std::log(light[i].exposure_s / light[0].exposure_s), k);
  }
  smooth_ = orthonormal_basis(weight_.asDiagonal() * smooth);
  const Eigen::VectorXd expected = weight_.cwiseInverse().asDiagonal() *
                                   (smooth_ * (smooth_.transpose() * weight_.cwiseProduct(brightness)));
  values = (brightness - expected).array().exp() - 1.0;
}

struct Wave {
  double explained = 0.0;  // share of the variance
  Eigen::Vector2d amplitude{0.0, 0.0};
};

Wave fit_wave(double hz, const std::vector<ExposedLight>& light, const Deviation& deviation) {
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, 3>;
  Columns columns(deviation.values.size(), 3);
  for (Eigen::Index i = 0; i < columns.rows(); ++i)
    columns.row(i) << mean_wave(hz, light[i]).transpose(), deviation.values(i);
  const Columns beside = deviation.beside_smooth(columns);
  const Eigen::Matrix3d products = beside.transpose() * beside;
  const Eigen::Matrix2d normal = products.topLeftCorner<2, 2>();
  const Eigen::Vector2d right = products.topRightCorner<2, 1>();
  Wave wave;
  if (normal.determinant() < 1e-6 * normal.trace() * normal.trace()) return wave;
  wave.amplitude = normal.inverse() * right;
  wave.explained = right.dot(wave.amplitude) / products(2, 2);
  return wave;
}

double best_frequency(const std::vector<ExposedLight>& light, const Deviation& deviation) {
  double first = light[0].start_s;
  double last = first;
  for (const ExposedLight& l : light) {
    first = std::min(first, l.start_s);
    last = std::max(last, l.start_s + l.exposure_s);
  }
  const double step = 0.35 / (last - first);  // a peak is about three of them wide
  const auto count = static_cast<std::size_t>((highest_hz - lowest_hz) / step);
  std::vector<float> explained(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    explained[k] = static_cast<float>(fit_wave(lowest_hz + step * k, light, deviation).explained);
  });
  double hz = lowest_hz + step * static_cast<double>(std::ranges::max_element(explained) - explained.begin());
  for (double refine = step / 2.0; refine > 1e-4 * step; refine /= 2.0)
    for (double other : {hz - refine, hz + refine})
      if (fit_wave(other, light, deviation).explained > fit_wave(hz, light, deviation).explained) hz = other;
  return hz;
}

void analyse(Banding& banding) {
  banding.ripples = find_ripples(banding.frames, 2, &banding.noise);
  banding.exposure_unit = exposure_unit_for(banding.ripples, tolerated_error);
  const Eigen::VectorXd deviation = Deviation(banding.frames).values;
  banding.deviation.clear();
  for (std::size_t i = 0; i < banding.frames.size(); ++i)
    banding.deviation.push_back({banding.frames[i].exposure_s, deviation(static_cast<Eigen::Index>(i))});
  std::ranges::sort(banding.deviation);
}

/// Lit samples without those that may clip at the metered exposure, whose share falls with the exposure as if
/// light flickered. Where the sensor saturates is not known yet.
std::vector<std::uint32_t> unclipped(CalibrationBench& bench, const Metering& metering,
                                     const RunContext& run) {
  const RawFrame frame = bench.frame(metering.exposure, run);
  const double limit = 0.8 * *std::ranges::max_element(frame.samples);
  std::vector<std::uint32_t> samples;
  for (const std::uint32_t s : metering.lit)
    if (frame.samples[s] < limit) samples.push_back(s);
  // Of an even card most samples are near the maximum, and none clips.
  return 2 * samples.size() < metering.lit.size() ? metering.lit : samples;
}

}  // namespace

ControlLatency measure_control_latency(CalibrationBench& bench, const Metering& metering,
                                       const RunContext& run) {
  const Seconds longer = metering.exposure;
  const Seconds shorter = std::max(bench.camera().shortest_exposure, longer / step_ratio);
  bench.show(metering.level);
  bench.frame(shorter, run);  // waits until the light stands still
  const auto dark_first = levels_after(bench, metering, shorter, run);
  ControlLatency result;
  result.level_dn = levels_after(bench, metering, longer, run);
  const auto down = levels_after(bench, metering, shorter, run);
  result.expected_ratio = longer / shorter;
  const double low = end_of(dark_first);
  const double high = end_of(result.level_dn);
  result.seen_ratio = (high - metering.dark_dn) / std::max(1e-9, low - metering.dark_dn);
  // The response may bend: an exposure four times as long is rarely four times as bright in DN, but brighter.
  if (low - metering.dark_dn > 0.0 && result.seen_ratio < 1.0 + 0.1 * (result.expected_ratio - 1.0))
    throw DeviceError(bench.camera().name, EIO, "ignores its exposure: ", longer.count(),
                      " s is as bright as ", shorter.count(),
                      " s; turn off automatic exposure and gain, and dynamic frame rate");
  result.frames = std::max(frames_until(result.level_dn, low), frames_until(down, high));
  if (result.frames > frames_watched - 2 * frames_compared)
    throw DeviceError(bench.camera().name, EIO, "is still changing its brightness ", frames_watched,
                      " frames after its exposure was set; turn off automatic exposure and gain");
  return result;
}

DisplayTransition fit_light_change(const std::vector<ChangeFrame>& frames, Seconds longest,
                                   double tolerance) {
  double latency = 0.0;
  double settling = 1e-4;
  double best = squared_error(frames, latency, settling);
  const auto consider = [&](double l, double s) {
    if (l < 0.0 || s < 1e-4 || l + s > longest.count()) return false;
    const double error = squared_error(frames, l, s);
    if (!(error < best)) return false;
    best = error;
    latency = l;
    settling = s;
    return true;
  };
  const double coarse = longest.count() / 100.0;
  for (int i = 0; i <= 100; ++i)
    for (int j = 0; j <= 100 - i; ++j) consider(i * coarse, std::max(1e-4, j * coarse));
  for (double step = coarse; step > 1e-6;) {  // both ends of the ramp, one at a time and together
    const bool better = consider(latency + step, settling - step) ||
                        consider(latency - step, settling + step) || consider(latency, settling + step) ||
                        consider(latency, settling - step) || consider(latency + step, settling) ||
                        consider(latency - step, settling);
    if (!better) step /= 2.0;
  }
  double end = latency + settling;
  for (const ChangeFrame& frame : frames)
    if (std::abs(frame.share - 1.0) > tolerance)
      end = std::max(end, std::min(frame.start_s, longest.count()));
  return {Seconds(latency), Seconds(end - latency), std::sqrt(best / static_cast<double>(frames.size()))};
}

DisplayTiming measure_display_timing(CalibrationBench& bench, const CameraResponse& response,
                                     Seconds exposure_unit, const RunContext& run) {
  const Metering metering = meter(bench, std::max(3.0 * bench.camera().frame_interval, Seconds(0.1)), run);
  const auto exposures = exposure_series(bench.camera(), metering.exposure / 24.0, metering.exposure,
                                         flips_each_way, exposure_unit);
  DisplayTiming result;
  Progress progress(run, "measuring display latency", exposures.size());
  double noise = 0.0;
  for (Seconds exposure : exposures) {
    bench.show(0);
    bench.frame(exposure, run);  // black has settled, and so has the exposure
    bench.set_exposure(exposure);
    const Series rise = frames_across(bench, metering.level, exposure, run);
    const Series fall = frames_across(bench, 0, exposure, run);
    const double light = linear_mean(rise.frames.back(), metering, response);
    const double dark = linear_mean(fall.frames.back(), metering, response);
    if (light - dark < 1.0)
      throw DeviceError(bench.display().name, EIO, "shows no change of light within ",
                        bench.patience().count(), " s of a flip; give a longer --patience");
    noise = std::max(noise, 1.0 / std::max(1.0, light - dark));  // a DN
    const auto collect = [&](const Series& series, double from, double to, std::vector<ChangeFrame>& into) {
      for (const RawFrame& frame : series.frames) {
        const double start = Seconds(frame.exposure_start - series.flip).count();
        if (start + frame.exposure.count() > 0.0)
          into.push_back(
              {start, frame.exposure.count(), (linear_mean(frame, metering, response) - from) / (to - from)});
      }
    };
    collect(rise, dark, light, result.rising);
    collect(fall, light, dark, result.falling);
    progress.advance();
  }
  const double tolerance = std::max(settled_within, 4.0 * noise);
  result.rise = fit_light_change(result.rising, bench.patience(), tolerance);
  result.fall = fit_light_change(result.falling, bench.patience(), tolerance);
  result.latency = std::min(result.rise.latency, result.fall.latency);
  result.settling =
      std::max(result.rise.latency + result.rise.settling, result.fall.latency + result.fall.settling) -
      result.latency;
  if (result.latency + result.settling > 0.9 * bench.patience())
    throw DeviceError(bench.display().name, EIO, "is still changing ", bench.patience().count(),
                      " s after a flip; give a longer --patience, and turn off the display's own fading, "
                      "dynamic contrast and power saving");
  return result;
}

double Ripple::error_at(Seconds exposure) const {
  const double turns = std::numbers::pi * hz * exposure.count();
  return depth * std::abs(std::sin(turns) / turns);
}

std::vector<Ripple> find_ripples(const std::vector<ExposedLight>& light, int most, double* unexplained) {
  Deviation deviation(light);
  std::vector<Ripple> ripples;
  while (static_cast<int>(ripples.size()) < most) {
    const double hz = best_frequency(light, deviation);
    const Wave wave = fit_wave(hz, light, deviation);
    const double depth = wave.amplitude.norm();
    if (wave.explained < least_explained || depth < least_depth || depth > largest_depth) break;
    ripples.push_back({hz, depth});
    // A pulse has harmonics; whole periods of the first are whole periods of theirs.
    constexpr int harmonics = 9;
    for (int k = 1; k <= harmonics; ++k) {
      const Wave part = fit_wave(k * hz, light, deviation);
      for (Eigen::Index i = 0; i < deviation.values.size(); ++i)
        deviation.values(i) -= mean_wave(k * hz, light[i]).dot(part.amplitude);
    }
  }
  if (unexplained) *unexplained = deviation.rest();
  return ripples;
}

Seconds exposure_unit_for(const std::vector<Ripple>& ripples, double tolerance) {
  if (ripples.empty()) return Seconds(0);
  const Seconds period(1.0 / ripples.front().hz);
  constexpr int max_periods = 64;
  for (int n = 1; n <= max_periods; ++n) {
    const bool quiet = std::ranges::all_of(
        ripples, [&](const Ripple& ripple) { return ripple.error_at(n * period) < tolerance; });
    if (quiet) return n * period;
  }
  return period;
}

Seconds common_period(const std::vector<Seconds>& differences) {
  if (differences.empty()) return Seconds(0);
  const Seconds shortest = *std::ranges::min_element(differences);
  constexpr int max_periods = 6;
  constexpr double tolerated = 0.1;  // of a period: time stamps jitter
  for (int n = 1; n <= max_periods; ++n) {
    const Seconds period = shortest / n;
    bool all = true;
    double periods = 0.0;
    Seconds sum{0};
    for (Seconds difference : differences) {
      const double count = difference / period;
      all = all && std::abs(count - std::round(count)) < tolerated;
      periods += std::round(count);
      sum += difference;
    }
    if (all && periods > 0.0) return sum / periods;
  }
  return Seconds(0);
}

Banding measure_banding(CalibrationBench& bench, const Metering& metering, double black_dn,
                        const RunContext& run) {
  Banding result;
  std::vector<Seconds> differences;
  TimePoint last = bench.show_at_once(metering.level);
  for (int i = 0; i < 24; ++i) {
    if (i % 3 == 0) bench.next_frame(metering.exposure, run);  // delays of all lengths
    const TimePoint flip = bench.show_at_once(metering.level);
    differences.push_back(flip - last);
    last = flip;
  }
  result.refresh_period = common_period(differences);

  bench.show(metering.level);
  const auto samples = unclipped(bench, metering, run);
  std::optional<TimePoint> begin;
  const Seconds shortest = std::max(bench.camera().shortest_exposure, metering.exposure / 16.0);
  for (int i = 0; i < frames_taken; ++i) {
    const double irregular = std::fmod(0.5 + i * std::numbers::phi, 1.0);
    const Seconds exposure = shortest * std::pow(metering.exposure / shortest, irregular);
    const RawFrame frame = bench.frame(exposure, run);
    if (!begin) begin = frame.exposure_start;
    result.frames.push_back(
        {Seconds(frame.exposure_start - *begin).count(), frame.exposure.count(),
         std::max(0.5, mean_over(frame.samples, samples) - black_dn) / frame.exposure.count()});
  }
  analyse(result);
  return result;
}

Banding linearised(Banding banding, double black_dn, const std::vector<float>& linear_from_dn) {
  for (ExposedLight& light : banding.frames) {
    const double dn = black_dn + light.light_per_second * light.exposure_s;
    const auto below =
        static_cast<std::size_t>(std::clamp(dn, 0.0, static_cast<double>(linear_from_dn.size()) - 2.0));
    const double above = dn - static_cast<double>(below);
    const double linear = linear_from_dn[below] * (1.0 - above) + linear_from_dn[below + 1] * above;
    light.light_per_second = std::max(0.5, linear - black_dn) / light.exposure_s;
  }
  analyse(banding);
  return banding;
}

}  // namespace refield
