// SPDX-License-Identifier: Apache-2.0
#include "cli/relight/light_series.h"

#include <cstdio>

#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"
#include "relight/environment.h"
#include "relight/sequence.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

void require_light_size(const fs::path& light, const LightDomain& domain) {
  const ImageHeader header = read_image_header(light);
  if (header.width != domain.width || header.height != domain.height)
    throw InputError(light.string() + ": is " + std::to_string(header.width) + "×" +
                     std::to_string(header.height) + " texels, the field expects a " +
                     std::string(name_of(domain.parameterisation)) + " light map of " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) +
                     "; resample it to that size, or give it by --env if it shows the surroundings");
}

std::string frame_name(const char* what, int frame) {
  char name[64];
  std::snprintf(name, sizeof name, "%s_%04d", what, frame);
  return name;
}

fs::path only_file(const std::vector<std::string>& patterns, const char* option) {
  const auto files = expand_globs(patterns);
  if (files.size() != 1) throw InputError(std::string("--rotate turns one map; give exactly one ") + option);
  return files[0];
}

LightSeries series_of_lights(const RelightOptions& options, const LightDomain& domain) {
  LightSeries series;
  for (const fs::path& file : expand_globs(options.lights)) {
    require_light_size(file, domain);
    series.lights.push_back(
        {file.stem().string(), file, [=] { return read_light_map(file, domain.parameterisation); }});
  }
  return series;
}

LightSeries series_of_rotated_light(const RelightOptions& options, const LightDomain& domain) {
  const fs::path file = only_file(options.lights, "--light");
  require_light_size(file, domain);
  const auto light = std::make_shared<const LightMap>(read_light_map(file, domain.parameterisation));
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

/// Puts environments onto a field's light map and keeps count of what the monitor sees of them.
struct Projection {
  std::shared_ptr<const EnvironmentProjector> projector;
  std::shared_ptr<SeenShares> seen;

  LightMap operator()(const std::string& name, const LightMap& environment, const Turn& turn) const {
    EnvironmentLight result = projector->project(environment, turn);
    if (seen) seen->add(name, result.share);
    return std::move(result.light);
  }
};

Projection projection_of(const RelightOptions& options, const ReflectanceField& field) {
  const auto monitors = options.monitors.empty() ? field.monitors : placements_from_texts(options.monitors);
  const LightDomain& domain = field.basis.domain;
  const bool has_window = domain.parameterisation == Parameterisation::monitor;
  if (has_window && monitors.empty())
    throw InputError(
        options.field.string() +
        ": does not say where the monitor stood, and --env needs that; give the screen's width x "
        "height @ distance from the scene in mm by --monitor 520x320@600,yaw=90 (see "
        "docs/relighting.md)");
  if (!has_window && !options.monitors.empty())
    throw InputError(options.field.string() + ": has a " + std::string(name_of(domain.parameterisation)) +
                     " light map, seen from everywhere; leave --monitor out");
  check_placements(monitors, domain, options.monitors.empty() ? options.field.string() : "--monitor");
  return {std::make_shared<const EnvironmentProjector>(domain, monitors),
          has_window ? std::make_shared<SeenShares>() : nullptr};
}

LightSeries series_of_environments(const RelightOptions& options, const ReflectanceField& field) {
  const Projection project = projection_of(options, field);
  LightSeries series{.seen = project.seen};
  for (const fs::path& file : expand_globs(options.environments))
    series.lights.push_back({file.stem().string(), file, [=, turn = options.turn] {
                               return project(file.stem().string(), read_environment(file), turn);
                             }});
  return series;
}

LightSeries series_of_rotated_environment(const RelightOptions& options, const ReflectanceField& field) {
  const Projection project = projection_of(options, field);
  const fs::path file = only_file(options.environments, "--env");
  const auto environment = std::make_shared<const LightMap>(read_environment(file));
  LightSeries series{.is_sequence = true, .seen = project.seen};
  for (int i = 0; i < options.frames; ++i) {
    Turn turn = options.turn;
    turn.yaw += 360.0 * i / options.frames;
    const std::string name = frame_name("rotation", i);
    series.lights.push_back({name, file, [=] { return project(name, *environment, turn); }});
  }
  return series;
}

void check(const RelightOptions& options) {
  const int kinds =
      (options.bar > 0.0 ? 1 : 0) + (options.lights.empty() ? 0 : 1) + (options.environments.empty() ? 0 : 1);
  if (kinds != 1)
    throw InputError("nothing or too much to relight with; give one of --light, --env and --bar");
  if ((options.bar > 0.0 || options.rotate) != (options.frames > 0))
    throw InputError("--frames goes with --bar or --rotate; give the sequence's number of frames");
  if (options.environments.empty() && (!options.turn.is_none() || !options.monitors.empty()))
    throw InputError("--yaw, --pitch, --roll and --monitor go with --env; leave them out");
}

}  // namespace

LightSeries light_series(const RelightOptions& options, const ReflectanceField& field) {
  check(options);
  const LightDomain& domain = field.basis.domain;
  if (options.bar > 0.0) return series_of_bar(options, domain);
  if (!options.environments.empty())
    return options.rotate ? series_of_rotated_environment(options, field)
                          : series_of_environments(options, field);
  return options.rotate ? series_of_rotated_light(options, domain) : series_of_lights(options, domain);
}

}  // namespace refield::cli
