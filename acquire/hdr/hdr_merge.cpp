// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/hdr_merge.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <limits>
#include <numeric>

namespace refield {

namespace {

cv::Mat filtered(const cv::Mat& plane, const cv::Mat& kernel) {
  cv::Mat result;
  cv::filter2D(plane, result, CV_32F, kernel, cv::Point(-1, -1), 0.0, cv::BORDER_CONSTANT);
  return result;
}

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float useful_share = 0.4f;  // of what an exposure would hold were all equal
constexpr float within_the_noise =
    5.0f;  // standard deviations; beyond, clipping was certain and tells nothing
constexpr int newton_steps = 4;

/// φ(z) / (1 − Φ(z)): the mean of what a normal variable exceeds z by, plus z.
double hazard(double z) {
  constexpr double tail = 8.0;  // from here on the asymptote is exact to 1e-3
  if (z > tail) return z + 1.0 / z;
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  return density / (0.5 * std::erfc(z / std::numbers::sqrt2));
}

/// A decoded sample, or the level from which on samples count as clipped: electrons above black, and the
/// variance that does not depend on light. An infinite variance marks a clipped sample: its weight becomes
/// zero without a branch.
struct Sample {
  float electrons;
  float floor_variance;
};

/// Fits the response lines of many samples at once: electrons over exposure, through the origin.
///
/// Weighted least squares with predicted variances, see merge_exposures(). Where a clipped sample lies within
/// the noise of its clipping level, that it clipped is information, and leaving it out would favour those
/// that came out low: there the likelihood of the samples that were measured and of the clipping together is
/// maximised (a censored or Tobit regression: Tobin 1958; Amemiya 1984, eq. 6), by Newton's method with
/// expected information.
class ResponseLines {
 public:
  ResponseLines(std::size_t exposures, std::size_t size)
      : exposures_(exposures),
        size_(size),
        electrons_(exposures * size),
        floor_(exposures * size),
        predicted_(size),
        numerator_(size),
        information_(size) {}

  // [size] of each exposure, to be filled in.
  float* electrons(std::size_t i) { return electrons_.data() + i * size_; }
  float* floor(std::size_t i) { return floor_.data() + i * size_; }

  /// `per_radiance` [exposures]: electrons that radiance 1 gives. `useful` [exposures] counts samples for
  /// which an exposure holds a fair share of the information, `clipped` those without any measurement: their
  /// sigma is infinite and their radiance the clipping level of the shortest exposure.
  void fit(std::span<const float> per_radiance, std::span<const Sample> clip, std::span<float> radiance,
           std::span<float> sigma, std::span<std::uint32_t> useful, std::uint32_t& clipped) {
    predict(per_radiance);
    add_up(per_radiance, [this](std::size_t x, float t, float f) { return t / (predicted_[x] * t + f); });
    const std::size_t shortest = std::ranges::min_element(per_radiance) - per_radiance.begin();
    const float* bound = electrons(shortest);
    clipped = 0;
    for (std::size_t x = 0; x < size_; ++x) {
      const bool measured = information_[x] > 0.0f;
      radiance[x] = measured ? numerator_[x] / information_[x] : bound[x] / per_radiance[shortest];
      sigma[x] = measured ? 1.0f / std::sqrt(information_[x]) : infinity;
      clipped += !measured;
    }
    for (std::size_t i = 0; i < exposures_; ++i) useful[i] = count_useful(i, per_radiance[i]);
    refine_where_clipping_tells(per_radiance, clip, radiance, sigma);
  }

 private:
  /// The sums of weight × electrons and of weight × t over the exposures.
  template <class Weight>
  void add_up(std::span<const float> per_radiance, const Weight& weight) {
    std::ranges::fill(numerator_, 0.0f);
    std::ranges::fill(information_, 0.0f);
    for (std::size_t i = 0; i < exposures_; ++i) {
      const float* e = electrons(i);
      const float* f = floor(i);
      const float t = per_radiance[i];
      for (std::size_t x = 0; x < size_; ++x) {
        const float w = weight(x, t, f[x]);
        numerator_[x] += w * e[x];
        information_[x] += w * t;
      }
    }
  }

  /// Radiance Σ electrons / Σ exposure, not below zero: what variances are predicted from.
  void predict(std::span<const float> per_radiance) {
    add_up(per_radiance, [](std::size_t, float, float f) { return f < infinity ? 1.0f : 0.0f; });
    for (std::size_t x = 0; x < size_; ++x)
      predicted_[x] = information_[x] > 0.0f ? std::max(numerator_[x] / information_[x], 0.0f) : 0.0f;
  }

  void refine_where_clipping_tells(std::span<const float> per_radiance, std::span<const Sample> clip,
                                   std::span<float> radiance, std::span<float> sigma) {
    for (std::size_t i = 0; i < exposures_; ++i) {
      const float* f = floor(i);
      const float t = per_radiance[i];
      // The radiance here comes from the other exposures: its own noise widens the doubtful zone.
      const float certain =
          (clip[i].electrons + within_the_noise * std::sqrt(clip[i].electrons + clip[i].floor_variance)) / t;
      for (std::size_t x = 0; x < size_; ++x)
        if (f[x] == infinity && sigma[x] < infinity && radiance[x] - within_the_noise * sigma[x] < certain)
          refine(x, per_radiance, clip, radiance[x], sigma[x]);
    }
  }

  void refine(std::size_t x, std::span<const float> per_radiance, std::span<const Sample> clip,
              float& radiance, float& sigma) const {
    double r = radiance;
    double information = 0.0;
    for (int step = 0; step < newton_steps; ++step) {
      double score = 0.0;
      information = 0.0;
      for (std::size_t i = 0; i < exposures_; ++i) {
        const double t = per_radiance[i];
        const double f = floor_[i * size_ + x];
        if (f < infinity) {
          const double weighted_t = t / (predicted_[x] * t + f);
          score += weighted_t * (electrons_[i * size_ + x] - t * r);
          information += weighted_t * t;
        } else {
          const double spread = std::sqrt(std::max(r, 0.0) * t + clip[i].floor_variance);
          const double z = (clip[i].electrons - t * r) / spread;
          const double h = hazard(z);
          score += t / spread * h;
          information += t * t / (spread * spread) * h * (h - z);
        }
      }
      r += score / information;
    }
    radiance = static_cast<float>(r);
    sigma = static_cast<float>(1.0 / std::sqrt(information));
  }

  std::uint32_t count_useful(std::size_t i, float per_radiance) const {
    const float* f = floor_.data() + i * size_;
    const float share = useful_share / static_cast<float>(exposures_);
    std::uint32_t count = 0;
    for (std::size_t x = 0; x < size_; ++x)
      count +=
          per_radiance * per_radiance > share * information_[x] * (predicted_[x] * per_radiance + f[x]) &&
          f[x] < infinity;
    return count;
  }

  std::size_t exposures_;
  std::size_t size_;
  std::vector<float> electrons_;
  std::vector<float> floor_;
  std::vector<float> predicted_;
  std::vector<float> numerator_;
  std::vector<float> information_;  // Σ weight · t²: the inverse variance of the slope
};

/// For each exposure the longest of those that get clearly less light relative to their clipping level; the
/// exposure itself where there is none. Of a still scene, what is clipped there is clipped here too.
std::vector<std::size_t> shorter_exposures(std::span<const float> per_radiance,
                                           std::span<const Sample> clip) {
  constexpr double clearly = 1.5;  // beyond noise: repeated frames of one exposure are left alone
  const auto level = [&](std::size_t i) { return double{per_radiance[i]} / clip[i].electrons; };
  std::vector<std::size_t> shorter(per_radiance.size());
  for (std::size_t i = 0; i < shorter.size(); ++i) {
    shorter[i] = i;
    for (std::size_t j = 0; j < shorter.size(); ++j)
      if (clearly * level(j) <= level(i) && (shorter[i] == i || level(j) > level(shorter[i]))) shorter[i] = j;
  }
  return shorter;
}

/// Merges row by row. `clip` [exposures]. `decode(i, y, electrons, floor)` fills one row of one exposure.
template <class Decode>
Photograph merge_rows(int width, int height, int channels, std::span<const float> per_radiance,
                      std::span<const Sample> clip, const Decode& decode, MergeStatistics* statistics) {
  Photograph merged{Image(width, height, channels), Image(width, height, channels)};
  const std::size_t exposures = per_radiance.size();
  const std::size_t row_size = static_cast<std::size_t>(width) * channels;
  std::vector<std::uint32_t> useful(exposures * height);
  std::vector<std::uint32_t> clipped(height);
  const auto shorter = shorter_exposures(per_radiance, clip);
  std::vector<std::size_t> by_light(exposures);  // the least first
  std::iota(by_light.begin(), by_light.end(), std::size_t{0});
  std::ranges::stable_sort(by_light, {}, [&](std::size_t i) { return per_radiance[i] / clip[i].electrons; });
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 8), [&](const tbb::blocked_range<int>& rows) {
    ResponseLines lines(exposures, row_size);
    for (int y = rows.begin(); y < rows.end(); ++y) {
      for (std::size_t i = 0; i < exposures; ++i) decode(i, y, lines.electrons(i), lines.floor(i));
      // JPEG's ringing leaves levels below clipping among clipped ones: they would pass for samples.
      for (const std::size_t i : by_light) {
        if (shorter[i] == i) continue;
        const float* before = lines.floor(shorter[i]);
        float* floor = lines.floor(i);
        for (std::size_t x = 0; x < row_size; ++x) floor[x] = before[x] == infinity ? infinity : floor[x];
      }
      lines.fit(per_radiance, clip, merged.radiance.row(y), merged.sigma.row(y),
                std::span(useful).subspan(exposures * y, exposures), clipped[y]);
    }
  });
  if (statistics) {
    const double samples = static_cast<double>(row_size) * height;
    statistics->useful_fraction.assign(exposures, 0.0);
    statistics->clipped_fraction = 0.0;
    for (int y = 0; y < height; ++y) {
      for (std::size_t i = 0; i < exposures; ++i)
        statistics->useful_fraction[i] += useful[exposures * y + i] / samples;
      statistics->clipped_fraction += clipped[y] / samples;
    }
  }
  return merged;
}

/// What raw samples of one gain stand for.
struct SampleTable {
  std::vector<Sample> samples;  // by DN
  Sample clip;
};

SampleTable sample_table(const CameraCalibration& camera, double gain, double clip_margin) {
  const auto& linear = camera.linear_from_dn;
  const double electrons_per_dn = camera.electrons_per_dn / gain;
  const double clipped_from = camera.saturation_dn * (1.0 - clip_margin);
  std::vector<Sample> table(linear.size());
  Sample clip{0.0f, 0.0f};
  for (std::size_t dn = 0; dn < table.size(); ++dn) {
    const std::size_t below = dn == 0 ? 0 : dn - 1;
    const std::size_t above = std::min(dn + 1, table.size() - 1);
    const double step =
        electrons_per_dn * (linear[above] - linear[below]) / static_cast<double>(above - below);
    const double read = camera.read_noise_electrons;
    // A flat stretch of the response says nothing, but must not claim a noise of zero.
    const double floor =
        std::max(read * read + step * step / 12.0, 1e-6 * electrons_per_dn * electrons_per_dn);
    table[dn].electrons = static_cast<float>((linear[dn] - camera.black_level_dn) * electrons_per_dn);
    table[dn].floor_variance = static_cast<double>(dn) >= clipped_from ? infinity : static_cast<float>(floor);
    // Rounding takes samples from half a step below on for the first one that counts as clipped.
    if (static_cast<double>(dn) < clipped_from + 1.0)
      clip = {static_cast<float>(table[dn].electrons - 0.5 * step), static_cast<float>(floor)};
  }
  return {std::move(table), clip};
}

void check_frames(std::span<const RawFrame> frames, const CameraCalibration& camera) {
  camera.check("camera calibration");
  if (frames.empty()) throw InputError("there is no exposure to merge");
  const RawFrame& first = frames.front();
  const std::size_t expected =
      static_cast<std::size_t>(first.width) * first.height * (first.layout == PixelLayout::rgb ? 3 : 1);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const RawFrame& frame = frames[i];
    const std::string name = "exposure " + std::to_string(i + 1) + " of " + std::to_string(frames.size());
    if (frame.width != first.width || frame.height != first.height || frame.layout != first.layout ||
        frame.samples.size() != expected || expected == 0)
      throw InputError(name, ": is ", frame.width, "×", frame.height,
                       " pixels and differs in size or layout from the first; merge exposures of one camera");
    if (!(frame.exposure.count() > 0.0 && std::isfinite(frame.exposure.count()) && frame.gain > 0.0))
      throw InputError(name, ": exposure time and gain must be above zero");
    if (const auto top = *std::ranges::max_element(frame.samples); top >= camera.linear_from_dn.size())
      throw InputError(name, ": has a sample of ", top, ", more than the ", camera.bits,
                       " bits of the calibration; give the camera's own calibration");
  }
}

Image repeated_in_all_channels(const Image& grey) {
  Image rgb(grey.width, grey.height, 3);
  for (std::size_t i = 0; i < rgb.values.size(); ++i) rgb.values[i] = grey.values[i / 3];
  return rgb;
}

}  // namespace

Photograph demosaic(const Image& radiance, const Image& sigma, PixelLayout layout) {
  if (!is_bayer(layout) || radiance.channels != 1 || !radiance.same_shape(sigma) || radiance.width < 2 ||
      radiance.height < 2)
    throw InputError("Bayer planes must have one channel and at least 2×2 pixels, not ",
                     shape_text(radiance));
  const int width = radiance.width;
  const int height = radiance.height;
  const cv::Mat red_blue_kernel = (cv::Mat_<float>(3, 3) << 1, 2, 1, 2, 4, 2, 1, 2, 1);
  const cv::Mat green_kernel = (cv::Mat_<float>(3, 3) << 0, 1, 0, 1, 4, 1, 0, 1, 0);
  Photograph rgb{Image(width, height, 3), Image(width, height, 3)};
  for (int c = 0; c < 3; ++c) {
    cv::Mat present(height, width, CV_32F, cv::Scalar(0));
    cv::Mat value = present.clone();
    cv::Mat variance = present.clone();
    cv::Mat clipped = present.clone();
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (bayer_channel(layout, x, y) != c) continue;
        const float s = sigma.at(x, y, 0);
        present.at<float>(y, x) = 1.0f;
        value.at<float>(y, x) = radiance.at(x, y, 0);
        variance.at<float>(y, x) = std::isinf(s) ? 0.0f : s * s;
        clipped.at<float>(y, x) = std::isinf(s) ? 1.0f : 0.0f;
      }
    const cv::Mat& kernel = c == 1 ? green_kernel : red_blue_kernel;
    const cv::Mat squared_kernel = kernel.mul(kernel);
    const cv::Mat weight_sum = filtered(present, kernel);
    const cv::Mat value_sum = filtered(value, kernel);
    const cv::Mat variance_sum = filtered(variance, squared_kernel);
    const cv::Mat clipped_sum = filtered(clipped, kernel);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (bayer_channel(layout, x, y) ==
            c) {  // a measured sample; for green the kernel would blend nothing in either
          rgb.radiance.at(x, y, c) = radiance.at(x, y, 0);
          rgb.sigma.at(x, y, c) = sigma.at(x, y, 0);
          continue;
        }
        const float weight = weight_sum.at<float>(y, x);
        rgb.radiance.at(x, y, c) = value_sum.at<float>(y, x) / weight;
        rgb.sigma.at(x, y, c) = clipped_sum.at<float>(y, x) > 0.0f
                                    ? std::numeric_limits<float>::infinity()
                                    : std::sqrt(variance_sum.at<float>(y, x)) / weight;
      }
  }
  return rgb;
}

Photograph merge_exposures(std::span<const RawFrame> frames, const CameraCalibration& calibration,
                           const MergeOptions& options, MergeStatistics* statistics) {
  check_frames(frames, calibration);
  const RawFrame& first = frames.front();
  std::vector<float> per_radiance;
  std::vector<SampleTable> tables;
  std::vector<Sample> clip;
  std::vector<std::size_t> table_of;
  for (const RawFrame& frame : frames) {
    per_radiance.push_back(
        static_cast<float>(frame.exposure.count() * calibration.electrons_per_radiance_second));
    const auto same_gain = std::ranges::find(frames, frame.gain, &RawFrame::gain) - frames.begin();
    const auto index = table_of.size();
    table_of.push_back(static_cast<std::size_t>(same_gain) < index ? table_of[same_gain] : tables.size());
    if (table_of.back() == tables.size())
      tables.push_back(sample_table(calibration, frame.gain, options.clip_margin));
    clip.push_back(tables[table_of.back()].clip);
  }
  const int channels = first.layout == PixelLayout::rgb ? 3 : 1;
  const std::size_t row_size = static_cast<std::size_t>(first.width) * channels;
  const auto decode = [&](std::size_t i, int y, float* electrons, float* floor) {
    const std::uint16_t* dn = frames[i].samples.data() + row_size * y;
    const Sample* table = tables[table_of[i]].samples.data();
    for (std::size_t x = 0; x < row_size; ++x) {
      electrons[x] = table[dn[x]].electrons;
      floor[x] = table[dn[x]].floor_variance;
    }
  };
  Photograph merged = merge_rows(first.width, first.height, channels, per_radiance, clip, decode, statistics);
  switch (first.layout) {
    case PixelLayout::rgb:
      return merged;
    case PixelLayout::grey:
      return {repeated_in_all_channels(merged.radiance), repeated_in_all_channels(merged.sigma)};
    default:
      return demosaic(merged.radiance, merged.sigma, first.layout);
  }
}

Photograph merge_linear_exposures(std::span<const Image> images, std::span<const Seconds> exposures,
                                  const LinearSensor& sensor, const MergeOptions& options,
                                  MergeStatistics* statistics) {
  if (images.empty()) throw InputError("there is no exposure to merge");
  if (images.size() != exposures.size())
    throw InputError(images.size(), " images but ", exposures.size(),
                     " exposure times; give one for each image");
  if (!(sensor.black < sensor.saturation && sensor.electrons_per_value > 0.0 &&
        sensor.read_noise_electrons >= 0.0))
    throw InputError("black must lie below saturation, and noise figures must not be negative");
  std::vector<float> per_radiance;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::string name = "exposure " + std::to_string(i + 1) + " of " + std::to_string(images.size());
    if (!images[i].same_shape(images[0]))
      throw InputError(name, ": is ", shape_text(images[i]), ", the first is ", shape_text(images[0]),
                       "; merge exposures of one camera");
    if (!(exposures[i].count() > 0.0 && std::isfinite(exposures[i].count())))
      throw InputError(name, ": the exposure time must be above zero");
    require_finite(images[i], name, true, "repair that pixel");
    per_radiance.push_back(static_cast<float>(exposures[i].count() * sensor.electrons_per_value));
  }
  const auto scale = static_cast<float>(sensor.electrons_per_value);
  const auto black = static_cast<float>(sensor.black);
  const auto clipped_from =
      std::isinf(sensor.saturation)
          ? infinity
          : static_cast<float>(sensor.saturation - options.clip_margin * (sensor.saturation - sensor.black));
  // Half-float files resolve 2^-11 of a value: small beside shot noise, but it keeps the floor above zero.
  const auto floor_variance =
      static_cast<float>(std::max(sensor.read_noise_electrons * sensor.read_noise_electrons, 1e-3));
  const auto decode = [&](std::size_t i, int y, float* electrons, float* floor) {
    const auto row = images[i].row(y);
    for (std::size_t x = 0; x < row.size(); ++x) {
      electrons[x] = (row[x] - black) * scale;
      floor[x] = row[x] >= clipped_from ? infinity : floor_variance;
    }
  };
  const std::vector<Sample> clip(images.size(), {(clipped_from - black) * scale, floor_variance});
  return merge_rows(images[0].width, images[0].height, images[0].channels, per_radiance, clip, decode,
                    statistics);
}

void subtract_ambient(Photograph& photograph, const Photograph& ambient) {
  if (!photograph.radiance.same_shape(ambient.radiance))
    throw InputError("the ambient photograph is ", shape_text(ambient.radiance), ", the photograph ",
                     shape_text(photograph.radiance), "; take both with one camera");
  for (std::size_t i = 0; i < photograph.radiance.values.size(); ++i) {
    photograph.radiance.values[i] -= ambient.radiance.values[i];
    photograph.sigma.values[i] = std::hypot(photograph.sigma.values[i], ambient.sigma.values[i]);
  }
}

double darker_share(const Photograph& photograph, const Photograph& ambient) {
  constexpr float noise = 5.0f, response = 0.1f;
  std::size_t darker = 0;
  for (std::size_t i = 0; i < photograph.radiance.values.size(); ++i)
    darker += photograph.radiance.values[i] <
              -noise * photograph.sigma.values[i] - response * ambient.radiance.values[i];
  return static_cast<double>(darker) / static_cast<double>(photograph.radiance.values.size());
}

std::string darker_text(const std::string& ambient, const std::vector<std::string>& darker) {
  return ambient + ": " + std::to_string(darker.size()) + " photographs (first: " + darker.front() +
         ") are darker than this one of the ambient light, so the room light was on in it; photograph black "
         "again with the room as dark as during the capture";
}

}  // namespace refield
