// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/panorama_lights.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "cli/run_context.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "simulate/panorama.h"

namespace refield::cli {

namespace {

float percentile_of(const Image& image, double percent) {
  std::vector<float> brightness;
  for (std::size_t i = 0; i < image.values.size(); i += 3)
    brightness.push_back(std::max({image.values[i], image.values[i + 1], image.values[i + 2]}));
  const auto place =
      static_cast<std::size_t>((static_cast<double>(brightness.size()) - 1.0) * percent / 100.0);
  std::ranges::nth_element(brightness, brightness.begin() + static_cast<std::ptrdiff_t>(place));
  return brightness[place];
}

}  // namespace

std::vector<CaptureLight> panorama_lights(const SessionLights& wanted, int width, int height, float white,
                                          const std::filesystem::path& folder) {
  Image panorama = read_image(wanted.panorama);
  if (panorama.channels != 3 || panorama.width != 2 * panorama.height)
    throw InputError(wanted.panorama.string() + ": is " + shape_text(panorama) +
                     "; a lat-long panorama must be twice as wide as high, with three channels");
  const float bright = percentile_of(panorama, wanted.white_percentile);
  if (!(bright > 0.0f))
    throw InputError(wanted.panorama.string() + ": is black up to the percentile " +
                     std::to_string(wanted.white_percentile) + "; increase white_percentile");
  for (float& value : panorama.values) value = std::clamp(value * white / bright, 0.0f, white);
  create_folders(folder);
  const double half_height = std::tan(radians_from_degrees(wanted.fov_degrees) / 2.0);
  const double horizontal_fov = degrees_from_radians(2.0 * std::atan(half_height * width / height));
  std::vector<CaptureLight> lights;
  Progress progress(run_context(), "rotating the panorama", static_cast<std::size_t>(wanted.rotations));
  for (int i = 0; i < wanted.rotations; ++i) {
    run_context().throw_if_stopped();
    char name[32];
    std::snprintf(name, sizeof name, "rotation_%05d", i);
    lights.push_back({name, FrameRole::train, "rotation", folder / (std::string(name) + ".exr")});
    const PanoramaView view{{.yaw = 360.0 * i / wanted.rotations}, horizontal_fov};
    write_exr(lights.back().wanted, view_of_panorama(panorama, view, width, height));
    progress.advance();
  }
  return lights;
}

}  // namespace refield::cli
