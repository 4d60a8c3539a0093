// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_merge.h"

#include <cmath>
#include <cstdlib>

#include "acquire/calibrate/calibration.h"
#include "core/base/number_text.h"
#include "core/image/image_facts.h"

namespace refield {

namespace {

/// As given or, for all images, from their metadata.
std::vector<Seconds> stated_exposures(const Bracket& bracket, std::span<const Seconds> given) {
  if (!given.empty()) {
    if (given.size() != bracket.files.size())
      throw InputError("--exposures gives ", given.size(), " times for ", bracket.files.size(),
                       " images; give one time for each image, in order");
    return {given.begin(), given.end()};
  }
  std::vector<Seconds> exposures;
  for (std::size_t i = 0; i < bracket.files.size(); ++i) {
    const BracketFile& file = bracket.files[i];
    if (!file.exposure && bracket.files.size() == 1 && !file.sigma.empty())
      return {Seconds(1.0)};  // merged already, by another tool
    if (!file.exposure)
      throw InputError(bracket.paths[i],
                       ": does not state its exposure time; give the times of all images with --exposures");
    require_same_settings(file.settings, bracket.paths[i], bracket.files[0].settings, bracket.paths[0]);
    exposures.push_back(*file.exposure);
  }
  return exposures;
}

/// The stated times, replaced where they were measured.
std::vector<Seconds> exposures_of(const Bracket& bracket, std::span<const Seconds> given,
                                  const BracketCamera& camera) {
  constexpr double least = 1e-7, most = 1e5;  // seconds
  std::vector<Seconds> exposures = stated_exposures(bracket, given);
  constexpr double same = 0.02;  // metadata round
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    if (const double seconds = exposures[i].count(); !(seconds >= least && seconds <= most)) {
      throw InputError(bracket.paths[i],
                       formatted(": has an exposure time of %g s; give 1e-7 to 1e5 s", seconds),
                       " with --exposures");
    }
    const auto measured = std::ranges::find_if(camera.measured_times, [&](const auto& times) {
      return std::abs(exposures[i] / times.first - 1.0) < same;
    });
    if (measured != camera.measured_times.end()) exposures[i] = measured->second;
  }
  return exposures;
}

/// Throws InputError where a file's noise is no noise.
void require_sigma(const BracketFile& file, const fs::path& path) {
  if (file.sigma.empty())
    throw InputError(path,
                     ": carries no noise (sigma.R, sigma.G, sigma.B), which other files of its bracket do; "
                     "give all with sigma or none");
  for (const float sigma : file.sigma.values)
    if (std::isnan(sigma) || sigma < 0.0f)
      throw InputError(path, ": a sigma is negative or not a number; repair that sample");
}

/// Images that carry the noise of each sample: the mean weighted by its inverse variance, which is kept as
/// measured. Samples of infinite sigma, or from `saturation` on, were not measured.
Photograph merge_measured(const Bracket& bracket, double black, std::optional<double> saturation,
                          MergeStatistics* statistics) {
  const std::size_t exposures = bracket.files.size();
  const Image& first = bracket.files.front().linear;
  Photograph merged{Image(first.width, first.height, 3), Image(first.width, first.height, 3)};
  const auto shortest =
      static_cast<std::size_t>(std::ranges::min_element(bracket.exposures) - bracket.exposures.begin());
  for (std::size_t k = 0; k < exposures; ++k) {
    require_finite(bracket.files[k].linear, bracket.paths[k].string(), true, "repair that pixel");
    require_sigma(bracket.files[k], bracket.paths[k]);
  }
  std::vector<double> useful(exposures, 0.0), information(exposures);
  double clipped = 0.0;
  const std::size_t samples = first.values.size();
  for (std::size_t i = 0; i < samples; ++i) {
    double sum = 0.0, total = 0.0;
    for (std::size_t k = 0; k < exposures; ++k) {
      const double value = bracket.files[k].linear.values[i], sigma = bracket.files[k].sigma.values[i];
      const double seconds = bracket.exposures[k].count();
      information[k] = 0.0;
      if (std::isinf(sigma) || (saturation && value >= *saturation)) continue;
      // A sigma of zero would outweigh all others: floats hold no value better than this.
      const double least = std::max(1e-7 * std::abs(value), 1e-30);
      information[k] = std::pow(seconds / std::max(sigma, least), 2);
      sum += information[k] * (value - black) / seconds;
      total += information[k];
    }
    const double bound =
        (bracket.files[shortest].linear.values[i] - black) / bracket.exposures[shortest].count();
    merged.radiance.values[i] = static_cast<float>(total > 0.0 ? sum / total : bound);
    merged.sigma.values[i] =
        total > 0.0 ? static_cast<float>(1.0 / std::sqrt(total)) : std::numeric_limits<float>::infinity();
    if (!(total > 0.0)) clipped += 1.0;
    for (std::size_t k = 0; k < exposures; ++k)
      if (information[k] > 0.0 && information[k] >= 0.4 / static_cast<double>(exposures) * total)
        useful[k] += 1.0;
  }
  if (statistics != nullptr) {
    statistics->useful_fraction = useful;
    for (double& fraction : statistics->useful_fraction) fraction /= static_cast<double>(samples);
    statistics->clipped_fraction = clipped / static_cast<double>(samples);
  }
  return merged;
}

Photograph merge_float_bracket(Bracket& bracket, const BracketCamera& camera, MergeStatistics* statistics) {
  if (!camera.response.empty() && camera.response != "linear")
    throw InputError("--response ", camera.response, ": float images are linear already; leave it out");
  LinearSensor sensor;
  sensor.black = camera.black.value_or(0.0);
  sensor.saturation = camera.saturation.value_or(sensor.saturation);
  sensor.electrons_per_value = camera.full_scale_electrons;
  sensor.read_noise_electrons = camera.read_noise_electrons;
  const auto carries_sigma = [](const BracketFile& file) { return !file.sigma.empty(); };
  if (std::ranges::any_of(bracket.files, carries_sigma))
    return merge_measured(bracket, sensor.black, camera.saturation, statistics);
  std::vector<Image> images;
  for (std::size_t i = 0; i < bracket.files.size(); ++i) {
    require_finite(bracket.files[i].linear, bracket.paths[i].string(), true, "repair that pixel");
    images.push_back(std::move(bracket.files[i].linear));
  }
  return merge_linear_exposures(images, bracket.exposures, sensor, with_unmeasured_saturation, statistics);
}

/// Moves the samples of a RAW file to the black level of the first of its bracket, whose levels count for
/// all: cameras state others in each file.
void equalise_levels(BracketFile& first, BracketFile& file) {
  if (!first.raw_levels || !file.raw_levels) return;
  const double difference = first.raw_levels->black - file.raw_levels->black;
  first.raw_levels->saturation =
      std::min(first.raw_levels->saturation, file.raw_levels->saturation + difference);
  for (std::uint16_t& sample : file.frame.samples)
    sample = static_cast<std::uint16_t>(std::clamp(sample + difference, 0.0, 65535.0));
}

constexpr double level_width = 1e-3;       // of the level: sensors clip within some DN
constexpr std::size_t ranges_below = 10;   // ranges of that width to compare with
constexpr double pile_contrast = 4.0;      // of the fullest of them
constexpr std::size_t enough_in_pile = 8;  // samples
constexpr double min_pile_share = 1e-4;    // of all samples: some 2 000 of a photograph
constexpr double max_share_of_frame = 0.5;

/// Samples of one exposure near the highest level.
struct Exposure {
  double highest = 0.0;
  std::size_t samples = 0;
  std::array<std::size_t, ranges_below + 1> in_range{};  ///< from the level downwards
  std::array<std::size_t, 3> of_colour{};                ///< of the first range

  bool piles_up() const {
    const std::size_t fullest = *std::max_element(in_range.begin() + 1, in_range.end());
    return in_range[0] >= enough_in_pile && in_range[0] >= min_pile_share * static_cast<double>(samples) &&
           static_cast<double>(in_range[0]) >= pile_contrast * static_cast<double>(fullest);
  }
  bool piles_up_in_two_colours() const {
    return std::ranges::count_if(of_colour, [](std::size_t count) { return count >= enough_in_pile; }) >= 2;
  }
};

template <class Visit>
void for_samples(const BracketFile& file, const Visit& visit) {
  if (file.bits == 0)
    for (std::size_t i = 0; i < file.linear.values.size(); ++i) visit(i, double{file.linear.values[i]});
  else
    for (std::size_t i = 0; i < file.frame.samples.size(); ++i) visit(i, double(file.frame.samples[i]));
}

std::size_t colour_of(const BracketFile& file, std::size_t sample) {
  const RawFrame& frame = file.frame;
  if (!is_bayer(frame.layout)) return sample % 3;
  const auto columns = static_cast<std::size_t>(frame.width);
  return static_cast<std::size_t>(
      bayer_channel(frame.layout, static_cast<int>(sample % columns), static_cast<int>(sample / columns)));
}

bool is_of_fewer_bits(double level, int bits) {
  for (int k = 8; k <= 16; ++k)
    if (level == (1 << k) - 1 && (bits == 0 || (k > 8 && k < bits))) return true;
  return bits == 0 && level == 1.0;
}

double sample_of(const BracketFile& file, std::size_t i) {
  return file.bits == 0 ? double{file.linear.values[i]} : double(file.frame.samples[i]);
}

/// Whether the samples of exposure `i` at the level have different values in the clearly shorter exposure
/// `j`: a surface that is evenly bright is so in both.
bool was_clipped(const Bracket& bracket, std::size_t i, std::size_t j, double level) {
  constexpr double another_time = 1.1, spread = 0.05;  // relative standard deviation
  if (bracket.exposures[i] < another_time * bracket.exposures[j]) return false;
  double count = 0.0, sum = 0.0, squares = 0.0;
  for_samples(bracket.files[i], [&](std::size_t at, double value) {
    if (value < level * (1.0 - level_width)) return;
    const double shorter = sample_of(bracket.files[j], at);
    count += 1.0;
    sum += shorter;
    squares += shorter * shorter;
  });
  return squares * count - sum * sum > spread * spread * sum * sum;
}

}  // namespace

std::optional<PixelLayout> layout_of(const std::string& name) {
  if (name.empty()) return std::nullopt;
  if (name == "bayer") return PixelLayout::bayer_rggb;
  const auto found = std::ranges::find(layout_names, name);
  if (found == layout_names.end())
    throw InputError("--layout: '", name,
                     "' is not a known layout; give grey, or a Bayer order such as bayer_rggb");
  return static_cast<PixelLayout>(found - layout_names.begin());
}

Bracket read_bracket(const std::vector<fs::path>& paths, const BracketCamera& camera,
                     std::span<const Seconds> exposures) {
  if (paths.empty()) throw InputError("there is no exposure to merge");
  if (!(camera.full_scale_electrons >= 10.0 && camera.full_scale_electrons <= 1e9))
    throw InputError("--full-scale-electrons is outside 10 to 1e9; cameras hold 1e3 to 1e6 photo-electrons");
  Bracket bracket{paths, {}, {}};
  const auto layout = layout_of(camera.layout);
  for (const fs::path& path : paths) {
    bracket.files.push_back(read_bracket_file(path, layout));
    const BracketFile& first = bracket.files.front();
    const BracketFile& file = bracket.files.back();
    if (file.bits != first.bits || file.frame.layout != first.frame.layout ||
        file.frame.width != first.frame.width || file.frame.height != first.frame.height ||
        !file.linear.same_shape(first.linear))
      throw InputError(path, ": differs in size, bits or channels from ", paths.front(),
                       "; merge exposures of one camera and one view");
    if (camera.response.empty() && file.bits > 8 && file.response == "unknown")
      throw InputError(path, ": ", unknown_encoding, ", or give its response with --response");
    if (camera.response.empty() && file.response != first.response)
      throw InputError(path, ": states another encoding ('", file.response, "') than ", paths.front(), " ('",
                       first.response, "'); give the response of all with --response");
    equalise_levels(bracket.files.front(), bracket.files.back());
  }
  bracket.exposures = exposures_of(bracket, exposures, camera);
  return bracket;
}

std::string response_of(const BracketCamera& camera, int bits) {
  if (!camera.response.empty()) return camera.response;
  if (!camera.stated.empty() && camera.stated != "unknown") return camera.stated;
  return bits == 8 ? "srgb" : "linear";
}

CameraCalibration bracket_calibration(const BracketCamera& camera, int bits) {
  const std::string response = response_of(camera, bits);
  if (fs::is_regular_file(response)) return read_camera_calibration(response);
  CameraCalibration calibration;
  calibration.bits = bits;
  if (!camera.curve.empty()) {
    calibration.linear_from_dn = camera.curve;
  } else if (response == "linear") {
    calibration.linear_from_dn = linear_response(bits);
  } else if (response == "srgb") {
    calibration.linear_from_dn = srgb_response(bits);
  } else if (response.starts_with("gamma:")) {
    char* end = nullptr;
    const double gamma = std::strtod(response.c_str() + 6, &end);
    if (*end != '\0' || !(gamma >= 0.1 && gamma <= 10.0))
      throw InputError("--response ", response, ": give a gamma from 0.1 to 10, for example gamma:2.2");
    calibration.linear_from_dn = gamma_response(bits, gamma);
  } else {
    throw InputError("--response ", response,
                     ": is neither linear, srgb, gamma:X nor an existing calibration file");
  }
  const double full = calibration.linear_from_dn.back();
  calibration.black_level_dn = camera.black.value_or(0.0);
  calibration.saturation_dn = camera.saturation.value_or(full);
  calibration.electrons_per_dn = camera.full_scale_electrons / full;
  calibration.read_noise_electrons = camera.read_noise_electrons;
  calibration.electrons_per_radiance_second = camera.full_scale_electrons;
  calibration.check("--black, --saturation and noise options");
  return calibration;
}

Photograph merge_bracket(Bracket& bracket, const BracketCamera& given, MergeStatistics* statistics) {
  BracketCamera camera = given;
  camera.stated = bracket.files.at(0).response;
  const bool measured = fs::is_regular_file(camera.response);
  std::optional<double> found;
  if (!camera.saturation && !measured)
    if (const HighestSamples highest = highest_samples(bracket); highest.is_saturation) found = highest.level;
  if (found) camera.saturation = found;
  if (const auto& levels = bracket.files.at(0).raw_levels) {
    camera.black = camera.black.value_or(levels->black);
    camera.saturation = camera.saturation.value_or(levels->saturation);
  }
  require_brighter_with_time(samples_of(bracket), camera);
  if (bracket.files.at(0).bits == 0) {
    Photograph merged = merge_float_bracket(bracket, camera, statistics);
    if (statistics) statistics->found_saturation = found;
    return merged;
  }
  std::vector<RawFrame> frames;
  for (std::size_t i = 0; i < bracket.files.size(); ++i) {
    frames.push_back(std::move(bracket.files[i].frame));
    frames.back().exposure = bracket.exposures[i];
  }
  const CameraCalibration calibration = bracket_calibration(camera, bracket.files[0].bits);
  const MergeOptions unmeasured =
      calibration.bits == 8 && !camera.saturation ? with_compressed_samples : with_unmeasured_saturation;
  Photograph merged =
      merge_exposures(frames, calibration, measured ? MergeOptions{} : unmeasured, statistics);
  divide(merged, calibration.flat_field);
  if (statistics) statistics->found_saturation = found;
  return merged;
}

HighestSamples highest_samples(const Bracket& bracket) {
  const BracketFile& first = bracket.files.at(0);
  const double stated = first.raw_levels  ? first.raw_levels->saturation
                        : first.bits == 0 ? std::numeric_limits<double>::infinity()
                                          : (1 << first.bits) - 1.0;
  std::vector<Exposure> exposures(bracket.files.size());
  HighestSamples result;
  if (!first.sigma.empty()) return result;  // merged already: sigma says what is clipped
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    for_samples(bracket.files[i], [&](std::size_t, double value) {
      exposures[i].highest = std::max(exposures[i].highest, value);
      ++exposures[i].samples;
    });
    result.level = std::max(result.level, exposures[i].highest);
  }
  // Merging leaves out what lies that far below the stated saturation, see merge_exposures().
  const double margin =
      first.bits == 8 ? with_compressed_samples.clip_margin : with_unmeasured_saturation.clip_margin;
  if (!(result.level > 0.0) || !std::isfinite(result.level) || result.level >= stated * (1.0 - margin))
    return result;
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    for_samples(bracket.files[i], [&](std::size_t sample, double value) {
      const double range = (1.0 - value / result.level) / level_width;
      if (!(range < static_cast<double>(ranges_below + 1))) return;
      ++exposures[i].in_range[static_cast<std::size_t>(range)];
      if (range < 1.0) ++exposures[i].of_colour[colour_of(bracket.files[i], sample)];
    });
    if (!exposures[i].piles_up()) continue;
    result.piles_up = true;
    if (exposures[i].in_range[0] > result.at_level) {
      result.at_level = exposures[i].in_range[0];
      result.file = bracket.paths[i];
    }
    for (std::size_t j = 0; j < exposures.size(); ++j)
      result.is_saturation |= was_clipped(bracket, i, j, result.level);
    const bool is_sensor = first.is_raw || is_bayer(first.frame.layout);
    const double share =
        static_cast<double>(exposures[i].in_range[0]) / static_cast<double>(exposures[i].samples);
    result.is_saturation |=
        is_of_fewer_bits(result.level, first.bits) ||
        (is_sensor && share < max_share_of_frame && exposures[i].piles_up_in_two_colours());
  }
  return result;
}

}  // namespace refield
