// SPDX-License-Identifier: Apache-2.0
#include "core/light/light_map.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "core/base/rng.h"
#include "core/light/cube_map.h"

namespace refield {

std::string_view v0_2::name_of(Parameterisation parameterisation) {
  constexpr std::array names = {"monitor", "lat_long", "cube"};
  return names.at(static_cast<std::size_t>(parameterisation));
}

Parameterisation v0_2::parameterisation_from_name(std::string_view name) {
  for (auto p : {Parameterisation::monitor, Parameterisation::lat_long, Parameterisation::cube})
    if (name == name_of(p)) return p;
  throw InputError("unknown light map parameterisation '", name, "'; use monitor, lat_long or cube");
}

void require_domain(const LightMapView& light, const LightDomain& domain) {
  const LightDomain given = light.domain();
  if (given != domain)
    throw InputError("the light map is ", given.width, "×", given.height, " (",
                     name_of(given.parameterisation), "), the field expects ", domain.width, "×",
                     domain.height, " (", name_of(domain.parameterisation),
                     "); resample the map to that size");
}

Eigen::Vector3d lat_long_direction(double column, double row, int width, int height) {
  const double phi = 2.0 * std::numbers::pi * column / width;
  const double theta = std::numbers::pi * row / height;
  return {-std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi)};
}

Eigen::Vector2d lat_long_position(const Eigen::Vector3d& direction, int width, int height) {
  double turn = std::atan2(-direction.x(), -direction.z()) / (2.0 * std::numbers::pi);
  if (turn < 0.0) turn += 1.0;
  if (turn >= 1.0) turn = 0.0;
  const double theta = std::acos(std::clamp(direction.y(), -1.0, 1.0));
  return {turn * width, theta / std::numbers::pi * height};
}

Eigen::Array3f radiance_towards(const LightMap& map, const Eigen::Vector3d& direction) {
  const int width = map.radiance.width, height = map.radiance.height;
  if (map.parameterisation == Parameterisation::monitor)
    throw InputError("a monitor's light map has no radiance by direction; give a lat-long or cube map");
  const bool is_cube = map.parameterisation == Parameterisation::cube;
  const Eigen::Vector2d place =
      is_cube ? cube_position(direction, width) : lat_long_position(direction, width, height);
  const double column = place.x() - 0.5, row = place.y() - 0.5;
  const int first_row = is_cube ? static_cast<int>(place.y()) / width * width : 0;
  const int last_row = (is_cube ? first_row + width : height) - 1;
  const int x = static_cast<int>(std::floor(column)), y = static_cast<int>(std::floor(row));
  const auto right = static_cast<float>(column - x), down = static_cast<float>(row - y);
  const auto texel = [&](int at_x, int at_y) {
    at_x = is_cube ? std::clamp(at_x, 0, width - 1) : (at_x + width) % width;
    at_y = std::clamp(at_y, first_row, last_row);
    return Eigen::Array3f(map.radiance.at(at_x, at_y, 0), map.radiance.at(at_x, at_y, 1),
                          map.radiance.at(at_x, at_y, 2));
  };
  return (1.0f - down) * ((1.0f - right) * texel(x, y) + right * texel(x + 1, y)) +
         down * ((1.0f - right) * texel(x, y + 1) + right * texel(x + 1, y + 1));
}

std::string_view kind_of_light(const Image& radiance) {
  const float largest = *std::ranges::max_element(radiance.values);
  if (!(largest > 0.0f)) return "black";
  const float equal = 1e-3f * largest;
  const auto is_lit = [&](int x, int y) {
    return radiance.at(x, y, 0) > equal || radiance.at(x, y, 1) > equal || radiance.at(x, y, 2) > equal;
  };
  Box lit{radiance.width, radiance.height, 0, 0};
  for (int y = 0; y < radiance.height; ++y)
    for (int x = 0; x < radiance.width; ++x)
      if (is_lit(x, y))
        lit = {std::min(lit.x0, x), std::min(lit.y0, y), std::max(lit.x1, x + 1), std::max(lit.y1, y + 1)};
  for (int y = lit.y0; y < lit.y1; ++y)
    for (int x = lit.x0; x < lit.x1; ++x)
      for (int c = 0; c < 3; ++c)
        if (std::abs(radiance.at(x, y, c) - radiance.at(lit.x0, lit.y0, c)) > equal) return "natural";
  const bool is_wide = lit.width() == radiance.width, is_high = lit.height() == radiance.height;
  if (!is_wide || !is_high) return is_wide || is_high ? "bar" : "square";
  int channels = 0;
  for (int c = 0; c < 3; ++c) channels += radiance.at(0, 0, c) > equal;
  return channels == 1 ? "primary" : "white";
}

double lat_long_solid_angle(int row, int width, int height) {
  const double step = std::numbers::pi / height;
  return 2.0 * std::numbers::pi / width * (std::cos(step * row) - std::cos(step * (row + 1)));
}

Eigen::Matrix3d cube_face_axes(int face) {
  Eigen::Matrix3d axes;
  switch (face) {
    case 0:
      axes << 0, 0, -1, 0, 1, 0, 1, 0, 0;
      return axes;
    case 1:
      axes << 0, 0, 1, 0, 1, 0, -1, 0, 0;
      return axes;
    case 2:
      axes << 1, 0, 0, 0, 0, -1, 0, 1, 0;
      return axes;
    case 3:
      axes << 1, 0, 0, 0, 0, 1, 0, -1, 0;
      return axes;
    case 4:
      return Eigen::Matrix3d::Identity();
    case 5:
      axes << -1, 0, 0, 0, 1, 0, 0, 0, -1;
      return axes;
    default:
      throw InputError("a cube has no face ", face, "; faces are 0 to 5");
  }
}

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
