// SPDX-License-Identifier: Apache-2.0
#include "core/light/light_pattern.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "core/base/rng.h"

namespace refield {

namespace {

constexpr std::string_view pattern_letters =
    "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_";
constexpr std::size_t parts = 8, places = 4;  // two lights of one texel each are alike once in 2^24
constexpr std::size_t colour_letters = parts * places + 4;  // with the mean and the contrast

void add_letter(std::string& letters, double value) {
  letters +=
      pattern_letters[static_cast<std::size_t>(std::lround(31.5 + 31.5 * std::clamp(value, -1.0, 1.0)))];
}

struct Contrast {
  Eigen::Array3d mean = Eigen::Array3d::Zero();
  double energy = 0.0, ground = 0.0;                          ///< of what differs from the mean, of the mean
  bool is_visible() const { return energy > 1e-5 * ground; }  // of less, 8 bits show nothing
};

/// Appends a sketch of an image of one or three channels.
Contrast add_sketch(std::string& letters, const Image& image) {
  Contrast contrast;
  const auto texels = static_cast<double>(image.pixel_count());
  const auto channels = static_cast<std::size_t>(image.channels);
  for (std::size_t i = 0; i < image.values.size(); ++i)
    contrast.mean[static_cast<Eigen::Index>(i % channels)] += image.values[i] / texels;
  std::array<double, parts * places> sketch{};
  for (std::size_t p = 0; p < image.pixel_count(); ++p) {
    Rng rng(p);
    for (std::size_t c = 0; c < channels; ++c) {
      std::uint64_t random = rng.next();
      const double value = image.values[channels * p + c] - contrast.mean[static_cast<Eigen::Index>(c)];
      contrast.energy += value * value;
      for (std::size_t part = 0; part < parts; ++part, random >>= 4)
        sketch[part * places + (random >> 1) % places] += random & 1 ? value : -value;
    }
  }
  contrast.ground = contrast.mean.square().sum() * texels;
  for (const double value : sketch)
    add_letter(letters, contrast.is_visible() ? value / std::sqrt(contrast.energy) : 0.0);
  return contrast;
}

/// Of a multiple of a light it is a multiple.
Image encoded_luma(const Image& radiance) {
  Image luma(radiance.width, radiance.height, 1);
  for (std::size_t i = 0; i < radiance.values.size(); ++i)
    luma.values[i / 3] +=
        std::array{0.299f, 0.587f, 0.114f}[i % 3] * std::pow(std::max(radiance.values[i], 0.0f), 1.0f / 2.2f);
  return luma;
}

std::ptrdiff_t level_of(char letter) {
  return static_cast<std::ptrdiff_t>(pattern_letters.find(letter));
}

}  // namespace

std::string pattern_of(const Image& radiance, bool is_jpeg) {
  std::string letters;
  const Contrast contrast = add_sketch(letters, radiance);
  const double mean = contrast.mean.matrix().norm(), all = contrast.energy + contrast.ground;
  for (const double value : contrast.mean) add_letter(letters, mean > 0.0 ? value / mean : 0.0);
  add_letter(letters, contrast.is_visible() ? std::sqrt(contrast.energy / all) : 0.0);
  const Contrast of_luma = add_sketch(letters, encoded_luma(radiance));
  return letters + (is_jpeg && of_luma.is_visible() ? 'J' : '-');
}

bool is_same_pattern(std::string_view a, std::string_view b) {
  const auto are_near = [&](std::size_t first, std::size_t count, std::ptrdiff_t most) {
    return std::ranges::equal(a.substr(first, count), b.substr(first, count),
                              [&](char x, char y) { return std::abs(level_of(x) - level_of(y)) <= most; });
  };
  if (std::min(a.size(), b.size()) < colour_letters) return false;
  if (are_near(0, colour_letters, 1)) return true;
  constexpr std::size_t end = colour_letters + parts * places;
  if (std::min(a.size(), b.size()) <= end || (a[end] != 'J' && b[end] != 'J')) return false;
  // Saturated blocks of 1 to 8 texels at JPEG qualities from 60 on: up to 0.13 and 0.10.
  if (!are_near(parts * places, 4, 6)) return false;
  constexpr double most = 0.3 * 31.5;  // up to 0.25 from quality 75 on; of other lights from 0.7
  double squared = 0.0;
  for (std::size_t i = colour_letters; i < end; ++i)
    squared += std::pow(level_of(a[i]) - level_of(b[i]), 2) / parts;
  return squared < most * most;
}

}  // namespace refield
