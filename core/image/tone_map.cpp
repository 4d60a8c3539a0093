// SPDX-License-Identifier: Apache-2.0
#include "core/image/tone_map.h"

#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>
#include <cstdlib>

#include "core/base/number_text.h"
#include "core/image/tone_vectors.h"

namespace refield {

namespace {

constexpr int cell_shift = 16;
constexpr std::uint32_t bits_of_infinity = 0x7f800000;

/// In double: rounding in float would make the curves fall here and there.
double displayed(double x, ToneOperator curve) {
  switch (curve) {
    case ToneOperator::clip:
      return x;
    case ToneOperator::reinhard: {
      constexpr double white = 4.0;
      const double bounded = std::min(x, white);
      return bounded * (1.0 + bounded / (white * white)) / (1.0 + bounded);
    }
    case ToneOperator::filmic: {
      const double bounded = std::min(x, 1e6);  // infinity by infinity is nothing
      return bounded * (2.51 * bounded + 0.03) / (bounded * (2.43 * bounded + 0.59) + 0.14);
    }
  }
  throw InputError("unknown tone operator");
}

/// The least float ≥ 0 whose level is at least `wanted`; NaN when there is none.
float least_value(const std::function<std::uint8_t(float)>& level, int wanted) {
  if (level(std::numeric_limits<float>::infinity()) < wanted) return std::numeric_limits<float>::quiet_NaN();
  std::uint32_t low = 0, high = bits_of_infinity;  // floats ≥ 0 have the order of their bits
  while (low < high) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (level(std::bit_cast<float>(middle)) >= wanted)
      high = middle;
    else
      low = middle + 1;
  }
  return std::bit_cast<float>(low);
}

}  // namespace

ToneOperator next(ToneOperator curve) {
  return tone_operators[(static_cast<std::size_t>(curve) + 1) % tone_operators.size()];
}

std::string_view name_of(ToneOperator curve) {
  constexpr std::array names = {"clip", "reinhard", "filmic"};
  return names.at(static_cast<std::size_t>(curve));
}

float linear_from_srgb(float encoded) {
  return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f);
}

float srgb_from_linear(float linear) {
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.0f / 2.4f) - 0.055f;
}

std::uint8_t tone_mapped(float radiance, const ToneMapping& mapping) {
  if (!(radiance > 0.0f)) return 0;
  const double shown = displayed(radiance * mapping.exposure, mapping.curve);
  return static_cast<std::uint8_t>(
      std::lround(255.0f * srgb_from_linear(static_cast<float>(std::min(shown, 1.0)))));
}

LevelTable::LevelTable(const std::function<std::uint8_t(float)>& level)
    : level_at_start_of_cell_((bits_of_infinity >> cell_shift) + 1) {
  least_value_of_.fill(std::numeric_limits<float>::quiet_NaN());
  for (int wanted = 0; wanted < 256; ++wanted) least_value_of_[wanted] = least_value(level, wanted);
  int at = 0;
  for (std::size_t cell = 0; cell < level_at_start_of_cell_.size(); ++cell) {
    const auto start = std::bit_cast<float>(static_cast<std::uint32_t>(cell) << cell_shift);
    while (start >= least_value_of_[at + 1]) ++at;
    level_at_start_of_cell_[cell] = static_cast<std::uint8_t>(at);
    if (cell > 0) steps_ = std::max(steps_, at - level_at_start_of_cell_[cell - 1]);
  }
  level_at_start_of_cell_.resize(level_at_start_of_cell_.size() + 3);  // see LevelCells
}

LevelTable::LevelTable(const ToneMapping& mapping)
    : LevelTable([&mapping](float radiance) { return tone_mapped(radiance, mapping); }) {}

std::uint8_t LevelTable::operator()(float value) const {
  if (!(value > 0.0f)) return level_at_start_of_cell_[0];
  int level = level_at_start_of_cell_[std::bit_cast<std::uint32_t>(value) >> cell_shift];
  while (value >= least_value_of_[level + 1]) ++level;
  return static_cast<std::uint8_t>(level);
}

LevelCells LevelTable::cells() const {
  return {level_at_start_of_cell_.data(), least_value_of_.data(), cell_shift, steps_};
}

std::vector<std::uint8_t> tone_mapped(const Image& image, const ToneMapping& mapping) {
  const LevelTable table(mapping);
  std::vector<std::uint8_t> levels(image.values.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, levels.size(), 16384), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i) levels[i] = table(image.values[i]);
  });
  return levels;
}

void tone_map_rgba(const Image& image, const LevelTable& table, std::span<std::uint8_t> rgba) {
  if (image.channels != 3 || rgba.size() != 4 * image.pixel_count())
    throw InputError("an image of ", shape_text(image), " does not fill ", rgba.size(),
                     " bytes of RGBA; it needs 3 channels and 4 bytes per pixel");
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, image.pixel_count(), 8192), [&](const auto& range) {
    tone_map_pixels(table.cells(), image.values.data() + 3 * range.begin(), range.size(),
                    rgba.data() + 4 * range.begin());
  });
}

namespace {

constexpr double white_quantile = 0.99;

float brightest_channel(const Image& image, std::size_t pixel) {
  float brightest = 0.0f;
  for (int c = 0; c < image.channels; ++c)
    brightest = std::max(brightest, image.values[pixel * image.channels + c]);
  return brightest;
}

/// The largest number of three decimal digits that is not above `value`.
double rounded_down(double value) {
  const double digit = std::pow(10.0, std::floor(std::log10(value)) - 2.0);
  return std::strtod(formatted("%.3g", digit * std::floor(value / digit)).c_str(), nullptr);
}

}  // namespace

double exposure_to_white(const Image& image, const Mask& mask) {
  ExposureMeter meter;
  meter.add(image, mask);
  return meter.exposure_to_white();
}

void ExposureMeter::add(const Image& image, const Mask& mask) {
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    if (!mask.empty() && mask[p] == 0) continue;
    const float brightest = brightest_channel(image, p);
    if (brightest > 0.0f && std::isfinite(brightest)) brightest_.push_back(brightest);
  }
}

double ExposureMeter::exposure_to_white() {
  if (brightest_.empty()) return 1.0;
  // Fewer than one pixel in a hundred is brighter, however few there are.
  const auto place =
      static_cast<std::size_t>(std::ceil(white_quantile * static_cast<double>(brightest_.size())));
  const auto white = brightest_.begin() + static_cast<std::ptrdiff_t>(std::min(place, brightest_.size() - 1));
  std::nth_element(brightest_.begin(), white, brightest_.end());
  return 1.0 / static_cast<double>(*white);
}

double ExposureMeter::exposure() {
  // The highest level begins at a linear value of 0.9957. The rest of the margin keeps the share below 1 %
  // even where pixels of level 0 are not counted.
  return rounded_down(0.98 * exposure_to_white());
}

double clipped_share(const Image& image, double exposure) {
  const float white = linear_from_srgb(254.5f / 255.0f);
  std::size_t lit = 0, clipped = 0;
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    const float brightest = brightest_channel(image, p);
    if (!(brightest > 0.0f)) continue;
    ++lit;
    if (brightest * exposure >= white) ++clipped;
  }
  return lit == 0 ? 0.0 : static_cast<double>(clipped) / static_cast<double>(lit);
}

namespace {

std::uint8_t level_of_fraction(double fraction) {
  return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(fraction, 0.0, 1.0)));
}

}  // namespace

EncodedColour false_colour(double fraction) {
  const double position = std::clamp(fraction, 0.0, 1.0) * (false_colour_stops.size() - 1);
  const auto low = std::min(static_cast<std::size_t>(position), false_colour_stops.size() - 2);
  const auto t = static_cast<float>(position - static_cast<double>(low));
  EncodedColour colour;
  for (int c = 0; c < 3; ++c)
    colour[c] = (1.0f - t) * false_colour_stops[low][c] + t * false_colour_stops[low + 1][c];
  return colour;
}

LevelTable linear_levels(double high) {
  if (!(high > 0.0)) throw InputError("false colours need a range above zero");
  return LevelTable([high](float value) { return level_of_fraction(value / high); });
}

LevelTable stop_levels(double low, double high) {
  if (!(high > low)) throw InputError("false colours need a range of stops above zero");
  return LevelTable([=](float value) {
    return value > 0.0f ? level_of_fraction((std::log2(value) - low) / (high - low)) : std::uint8_t{0};
  });
}

void false_colour_rgba(const Image& image, const LevelTable& levels, std::span<std::uint8_t> rgba) {
  if ((image.channels != 1 && image.channels != 3) || rgba.size() != 4 * image.pixel_count())
    throw InputError("an image of ", shape_text(image), " does not fill ", rgba.size(),
                     " bytes of RGBA; it needs 1 or 3 channels and 4 bytes per pixel");
  std::array<std::array<std::uint8_t, 4>, 256> colours;
  for (int level = 0; level < 256; ++level) {
    const EncodedColour colour = false_colour(level / 255.0);
    for (int c = 0; c < 3; ++c) colours[level][c] = level_of_fraction(colour[c]);
    colours[level][3] = 255;
  }
  constexpr std::array<std::uint8_t, 4> unknown = {128, 128, 128, 255};
  const auto value_of = [&image](std::size_t p) {
    const float* v = image.values.data() + p * image.channels;
    return image.channels == 1 ? v[0] : 0.2126f * v[0] + 0.7152f * v[1] + 0.0722f * v[2];
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, image.pixel_count(), 8192), [&](const auto& range) {
    for (std::size_t p = range.begin(); p != range.end(); ++p) {
      const float value = value_of(p);
      std::ranges::copy(std::isnan(value) ? unknown : colours[levels(value)], rgba.begin() + 4 * p);
    }
  });
}

}  // namespace refield
