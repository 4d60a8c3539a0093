// SPDX-License-Identifier: Apache-2.0
#include "cli/relight/light_series.h"

#include <algorithm>
#include <cstdio>

#include "cli/run_context.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "relight/emitter_map.h"
#include "relight/sequence.h"
#include "simulate/prt/area_lights.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

void require_light_size(const fs::path& light, const LightDomain& domain) {
  const ImageHeader header = read_image_header(light);
  if (header.width != domain.width || header.height != domain.height)
    throw InputError(light.string() + ": is " + std::to_string(header.width) + "×" +
                     std::to_string(header.height) + " texels, but the field requires a " +
                     std::string(name_of(domain.parameterisation)) + " light map of " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) +
                     "; resample it to that size, or give it with --env if it is an environment map");
}

LightSeries series_of_lights(const RelightOptions& options, const LightDomain& domain) {
  LightSeries series;
  for (const fs::path& file : expand_globs(options.lights)) {
    require_light_size(file, domain);
    series.lights.push_back({file.stem().string(), file,
                             [=] { return read_light_map(file, domain.parameterisation, run_context()); }});
  }
  return series;
}

LightSeries series_of_rotated_light(const RelightOptions& options, const LightDomain& domain) {
  const fs::path file = only_file(options.lights, "--light");
  require_light_size(file, domain);
  const auto light =
      std::make_shared<const LightMap>(read_light_map(file, domain.parameterisation, run_context()));
  rotated(*light, 0.0);  // complains about a map that cannot turn before anything is written
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back({frame_name("rotation", i), file, [=, n = options.frames] {
                               return rotated(*light, static_cast<double>(i) / n);
                             }});
  return series;
}

LightSeries series_of_bar(const RelightOptions& options, const LightDomain& domain) {
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back(
        {frame_name("bar", i), std::nullopt,
         [=, width = options.bar, n = options.frames] { return sliding_bar(domain, width, i, n); }});
  return series;
}

LightSeries series_of_area_lights(const RelightOptions& options, const ReflectanceField& field) {
  if (field.mesh.empty() || field.basis.domain.parameterisation != Parameterisation::cube)
    throw InputError("--area-lights requires a mesh field; " + options.field.string() +
                     " is an image field: use --light or --env");
  const auto lamps =
      std::make_shared<const prt::AreaLights>(prt::read_area_lights(options.area_lights, run_context()));
  const Eigen::Vector3f middle = prt::middle(field.mesh);
  const double last = std::max(1, options.frames - 1), duration = lamps->duration();
  LightSeries series{.is_sequence = true};
  for (int i = 0; i < options.frames; ++i)
    series.lights.push_back({frame_name("lamps", i), options.area_lights,
                             [=, time = duration * i / last, resolution = field.basis.domain.width] {
                               return emitter_map(lamps->at(time), middle, resolution);
                             }});
  return series;
}

/// One light for all frames of a sequence in which the camera alone moves.
void hold_still(LightSeries& series, int frames) {
  if (series.lights.size() != 1)
    throw InputError("--turntable requires exactly one light map or one light sequence; give one map");
  const auto light = std::make_shared<const SceneLight>(series.lights[0].make());
  const auto source = series.lights[0].source;
  series.lights.clear();
  for (int i = 0; i < frames; ++i)
    series.lights.push_back({frame_name("turntable", i), source, [=] { return *light; }});
  series.is_sequence = true;
}

void check(const RelightOptions& options) {
  const int kinds = (options.bar > 0.0 ? 1 : 0) + (options.lights.empty() ? 0 : 1) +
                    (options.environments.empty() ? 0 : 1) + (options.day ? 1 : 0) +
                    (options.area_lights.empty() ? 0 : 1);
  if (kinds != 1)
    throw InputError(
        "exactly one kind of light is required; give one of --light, --env, --day, --bar and --area-lights");
  const bool is_motion = options.bar > 0.0 || options.rotate || options.fade || options.day ||
                         options.camera.turntable || !options.area_lights.empty();
  if (is_motion != (options.frames > 0))
    throw InputError(
        "--frames is required by, and only valid with, --bar, --rotate, --fade, --day, --area-lights or "
        "--turntable; give the number of images in the sequence");
  const bool is_environment = !options.environments.empty() || options.day;
  if (!is_environment && (!options.turn.is_none() || !options.monitors.empty() || options.exact))
    throw InputError(
        "--yaw, --pitch, --roll, --monitor and --exact require an environment; give --env or --day, or "
        "remove them");
  if (options.fade && (options.environments.empty() || options.rotate))
    throw InputError("--fade requires --env and excludes --rotate");
}

}  // namespace

std::string frame_name(const char* what, int frame) {
  char name[64];
  std::snprintf(name, sizeof name, "%s_%04d", what, frame);
  return name;
}

fs::path only_file(const std::vector<std::string>& patterns, const char* option) {
  const auto files = expand_globs(patterns);
  if (files.size() != 1)
    throw InputError(std::string("--rotate requires exactly one map; give one ") + option);
  return files[0];
}

LightSeries light_series(const RelightOptions& options, const ReflectanceField& field) {
  check(options);
  const LightDomain& domain = field.basis.domain;
  if (options.bar > 0.0) return series_of_bar(options, domain);
  if (!options.area_lights.empty()) return series_of_area_lights(options, field);
  const bool is_environment = options.day || !options.environments.empty();
  LightSeries series = is_environment   ? environment_series(options, field)
                       : options.rotate ? series_of_rotated_light(options, domain)
                                        : series_of_lights(options, domain);
  if (options.camera.turntable && !series.is_sequence) hold_still(series, options.frames);
  return series;
}

}  // namespace refield::cli
