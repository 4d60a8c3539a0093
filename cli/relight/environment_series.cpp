// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "cli/relight/light_series.h"
#include "cli/run_context.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/run_context.h"
#include "relight/environment.h"
#include "relight/sequence.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;

/// Brings environments into the form that a field is lit by, and keeps count of what the monitor sees of
/// them.
struct Projection {
  std::shared_ptr<const EnvironmentProjector> projector;
  std::shared_ptr<SeenShares> seen;
  bool exact = false;
  bool box_sums = false;  ///< the field needs no light map

  SceneLight operator()(const std::string& name, std::shared_ptr<const PreparedEnvironment> environment,
                        const Turn& turn) const {
    if (box_sums && environment->has_path_sums()) return TurnedEnvironment{std::move(environment), turn};
    return light_map(name, *environment, turn);
  }

  LightMap light_map(const std::string& name, const PreparedEnvironment& environment,
                     const Turn& turn) const {
    EnvironmentLight result = exact ? projector->project_exactly(environment.map(), turn, run_context())
                                    : projector->project(environment, turn, run_context());
    if (seen) seen->add(name, result.share);
    return std::move(result.light);
  }
};

std::shared_ptr<const PreparedEnvironment> prepared(LightMap environment) {
  return std::make_shared<const PreparedEnvironment>(std::move(environment), run_context());
}

Projection projection_of(const RelightOptions& options, const ReflectanceField& field) {
  const auto monitors = options.monitors.empty() ? field.monitors : placements_from_texts(options.monitors);
  const LightDomain& domain = field.basis.domain;
  const bool has_window = domain.parameterisation == Parameterisation::monitor;
  if (has_window && monitors.empty())
    throw InputError(options.field.string() +
                     ": does not contain the placement of the monitor, which environment maps require; give "
                     "width x height @ distance from the scene in mm, such as --monitor 520x320@600,yaw=90 "
                     "(see docs/guide/relighting.md)");
  if (!has_window && !options.monitors.empty())
    throw InputError(options.field.string() + ": has a " + std::string(name_of(domain.parameterisation)) +
                     " light map that covers all directions; remove --monitor");
  check_placements(monitors, domain, options.monitors.empty() ? options.field.string() : "--monitor");
  return {std::make_shared<const EnvironmentProjector>(domain, monitors, run_context()),
          has_window ? std::make_shared<SeenShares>() : nullptr, options.exact,
          !options.exact && box_sums_suffice(field.basis)};
}

void add_maps(const RelightOptions& options, const Projection& project, LightSeries& series) {
  for (const fs::path& file : expand_globs(options.environments))
    series.lights.push_back({file.stem().string(), file, [=, turn = options.turn] {
                               return project(file.stem().string(),
                                              prepared(read_environment(file, run_context())), turn);
                             }});
}

void add_rotation(const RelightOptions& options, const Projection& project, LightSeries& series) {
  const fs::path file = only_file(options.environments, "--env");
  const auto environment = prepared(read_environment(file, run_context()));
  for (int i = 0; i < options.frames; ++i) {
    Turn turn = options.turn;
    turn.yaw += 360.0 * i / options.frames;
    const std::string name = frame_name("rotation", i);
    series.lights.push_back({name, file, [=] { return project(name, environment, turn); }});
  }
}

void add_day(const RelightOptions& options, const Projection& project, LightSeries& series) {
  options.sky.check();
  for (int i = 0; i < options.frames; ++i) {
    const std::string name = frame_name("day", i);
    const double done = options.frames == 1 ? 0.5 : static_cast<double>(i) / (options.frames - 1);
    series.lights.push_back({name, std::nullopt, [=, sky = options.sky, turn = options.turn] {
                               return project(name, prepared(clear_sky(sun_direction(done, sky), sky)), turn);
                             }});
  }
}

/// Light adds up, so maps are put onto the light map once, and their lights mixed.
void add_fade(const RelightOptions& options, const Projection& project, LightSeries& series) {
  const auto files = expand_globs(options.environments);
  if (files.size() < 2)
    throw InputError("--fade requires at least two environment maps; give them with --env");
  const auto lights = std::make_shared<std::vector<LightMap>>();
  Progress progress(run_context(), "projecting maps", files.size());
  for (const fs::path& file : files) {
    lights->push_back(project.light_map(
        file.stem().string(), PreparedEnvironment(read_environment(file, run_context()), run_context()),
        options.turn));
    progress.advance();
  }
  for (int i = 0; i < options.frames; ++i) {
    const double last = static_cast<double>(files.size()) - 1.0;
    const double place = options.frames == 1 ? 0.0 : last * i / (options.frames - 1);
    const auto from = std::min(static_cast<std::size_t>(place), files.size() - 2);
    series.lights.push_back(
        {frame_name("fade", i), files[from],
         [=] { return mixed((*lights)[from], (*lights)[from + 1], place - static_cast<double>(from)); }});
  }
}

}  // namespace

LightSeries environment_series(const RelightOptions& options, const ReflectanceField& field) {
  const Projection project = projection_of(options, field);
  LightSeries series{.is_sequence = options.rotate || options.fade || options.day, .seen = project.seen};
  if (options.day)
    add_day(options, project, series);
  else if (options.fade)
    add_fade(options, project, series);
  else if (options.rotate)
    add_rotation(options, project, series);
  else
    add_maps(options, project, series);
  return series;
}

}  // namespace refield::cli
