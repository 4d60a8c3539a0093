// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_capture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "tests/support/random_data.h"

namespace refield::test {

std::vector<LightMap> random_lights(int count, int width, int height, std::uint64_t seed) {
  std::vector<LightMap> lights;
  for (int j = 0; j < count; ++j) {
    Rng rng(seed, j);
    LightMap light{Image(width, height, 3, static_cast<float>(rng.uniform(0.0, 0.2))),
                   Parameterisation::monitor};
    for (int k = 0; k < 60; ++k) {
      const int w = 1 + static_cast<int>(width * std::pow(rng.uniform(), 2.0) * 0.6);
      const int h = 1 + static_cast<int>(height * std::pow(rng.uniform(), 2.0) * 0.6);
      const int x0 = static_cast<int>(rng.below(width));
      const int y0 = static_cast<int>(rng.below(height));
      const float colour[3] = {static_cast<float>(rng.uniform()), static_cast<float>(rng.uniform()),
                               static_cast<float>(rng.uniform())};
      for (int y = y0; y < std::min(y0 + h, height); ++y)
        for (int x = x0; x < std::min(x0 + w, width); ++x)
          for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = colour[c];
    }
    lights.push_back(std::move(light));
  }
  return lights;
}

ReflectanceField field_of_boxes(int width, int height, LightDomain light, const std::vector<Box>& boxes,
                                std::uint64_t seed) {
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis = {light, {}, boxes};
  std::vector<std::uint32_t> columns(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) columns[k] = static_cast<std::uint32_t>(k);
  for (int p = 0; p < width * height; ++p) {
    Rng rng(seed, p);
    std::vector<float> weights(3 * boxes.size());
    for (float& w : weights) w = static_cast<float>(rng.uniform(0.5, 1.5)) / (light.width * light.height);
    field.transfer.append_row(columns, weights);
  }
  return field;
}

CaptureSession write_capture(const std::filesystem::path& folder, const ReflectanceField& field,
                             const std::vector<LightMap>& lights, double noise) {
  CaptureSession session;
  session.folder = folder;
  session.light = field.basis.domain;
  session.width = field.width;
  session.height = field.height;
  create_folders(folder / "illumination");
  create_folders(folder / "observed");
  for (std::size_t j = 0; j < lights.size(); ++j) {
    char name[32];
    std::snprintf(name, sizeof name, "train_%03zu", j);
    const std::string file = std::string(name) + ".exr";
    Image photograph = field.relight(lights[j]);
    Rng rng(77, j);
    for (float& value : photograph.values) value *= static_cast<float>(1.0 + noise * rng.normal());
    write_exr(folder / "illumination" / file, lights[j].radiance);
    write_exr(folder / "observed" / file, photograph);
    session.frames.push_back(
        {name, FrameRole::train, "natural", folder / "illumination" / file, folder / "observed" / file});
  }
  write_session_manifest(session);
  return session;
}

SmallCapture::SmallCapture(std::uint64_t seed) {
  Rng rng(seed);
  truth = random_field(rng, 6, 5, domain, 10, 3);
  for (int i = 0; i < images; ++i) lights.push_back(random_light(rng, domain));
}

}  // namespace refield::test
