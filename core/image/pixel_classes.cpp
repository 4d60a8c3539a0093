// SPDX-License-Identifier: Apache-2.0
#include "core/image/pixel_classes.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr int level_of_a_label = 50;

fs::path names_path(fs::path png) {
  return png.replace_extension(".json");
}

/// Level → name, from the file beside the picture.
std::vector<std::pair<int, std::string>> read_names(const fs::path& path) {
  const auto json = nlohmann::ordered_json::parse(read_text(path), nullptr, false);
  const std::string form = "write an object such as {\"50\": \"diffuse\", \"100\": \"glossy\"}";
  if (!json.is_object()) throw FormatError(path, "is not a JSON object; " + form);
  std::vector<std::pair<int, std::string>> names;
  for (const auto& [key, value] : json.items()) {
    const int level = number_from_text<int>(key).value_or(-1);
    if (level < 0 || level > 255 || !value.is_string())
      throw FormatError(path, "'" + key + "' does not name a grey level from 0 to 255; " + form);
    names.emplace_back(level, value.get<std::string>());
  }
  return names;
}

}  // namespace

Mask PixelKinds::mask_of(std::size_t kind, const Mask& mask) const {
  Mask result(labels.size());
  for (std::size_t p = 0; p < labels.size(); ++p)
    result[p] = labels[p] == kind + 1 && (mask.empty() || mask[p]) ? 1 : 0;
  return result;
}

void write_pixel_kinds(const fs::path& png, const PixelKinds& kinds) {
  if (kinds.names.size() * level_of_a_label > 255)
    throw InputError(png.string() + ": " + std::to_string(kinds.names.size()) +
                     " pixel classes are too many; give at most five");
  Image image(kinds.width, kinds.height, 1);
  for (std::size_t p = 0; p < kinds.labels.size(); ++p)
    image.values[p] = linear_from_srgb(static_cast<float>(kinds.labels[p] * level_of_a_label) / 255.0f);
  nlohmann::ordered_json names;
  for (std::size_t k = 0; k < kinds.names.size(); ++k)
    names[std::to_string((k + 1) * level_of_a_label)] = kinds.names[k];
  write_png(png, image);
  write_text_atomically(names_path(png), names.dump(2) + "\n");
}

PixelKinds read_pixel_kinds(const fs::path& png, int width, int height) {
  const Image image = read_image(png);
  if (image.width != width || image.height != height)
    throw InputError(png.string() + ": is " + shape_text(image) + ", the photographs are " +
                     std::to_string(width) + "×" + std::to_string(height));
  const auto names = read_names(names_path(png));
  PixelKinds kinds{width, height, {}, std::vector<std::uint8_t>(image.pixel_count(), 0)};
  for (const auto& [level, name] : names) kinds.names.push_back(name);
  for (std::size_t p = 0; p < kinds.labels.size(); ++p) {
    const float value = srgb_from_linear(image.values[p * static_cast<std::size_t>(image.channels)]);
    const int level = static_cast<int>(std::lround(255.0f * value));
    for (std::size_t k = 0; k < names.size(); ++k)
      if (names[k].first == level) kinds.labels[p] = static_cast<std::uint8_t>(k + 1);
  }
  return kinds;
}

}  // namespace refield
