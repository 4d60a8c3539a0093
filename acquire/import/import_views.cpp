// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_series.h"

#define TOML_EXCEPTIONS 1

#include <tbb/parallel_for.h>
#include <toml++/toml.h>

#include <ranges>
#include <set>
#include <sstream>

#include "acquire/import/bracket_pairing.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_facts.h"
#include "core/image/image_io.h"

namespace refield {

namespace {

constexpr std::size_t max_names = 3;  // of files that a note lists

bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error);
}

std::vector<BracketGroup> group(const std::vector<fs::path>& photographs, const ImportRequest& request,
                                const RunContext& run) {
  std::vector<fs::path> files;
  for (const fs::path& file : photographs)
    if (std::ranges::none_of(request.ambient, [&](const fs::path& other) { return same_file(file, other); }))
      files.push_back(file);
  std::vector<std::optional<Seconds>> exposures(files.size());
  GroupRule rule = request.rule;
  if (rule.pattern.empty() && rule.count == 0 && request.has_light_sources()) rule.count = 1;
  if (rule.pattern.empty() && rule.count == 0) {
    Progress progress(run, "reading exposure times", files.size());
    for (std::size_t i = 0; i < files.size(); ++i) {
      run.throw_if_stopped();
      exposures[i] = stated_exposure(files[i]);
      progress.advance();
    }
  }
  return group_brackets(files, exposures, rule);
}

std::vector<ImportedView> without_lights(const std::vector<BracketGroup>& groups) {
  std::vector<ImportedView> views;
  for (std::size_t i = 0; i < groups.size(); ++i) views.push_back({groups[i], groups[i].name, {}, {}, i});
  return views;
}

/// Brightness of one exposure of each bracket and of the lights, and their times.
OrderedSeries read_series(const ImportRequest& request, const std::vector<BracketGroup>& groups,
                          const RunContext& run) {
  OrderedSeries series;
  series.first_is_black = request.ambient_first;
  series.photographs.resize(groups.size());
  const auto layout = layout_of(request.camera.layout);
  const auto means_of = [&](const std::vector<fs::path>& paths) {
    const BracketFile file = read_bracket_file(paths[paths.size() / 2], layout);
    const double seconds = file.exposure.value_or(Seconds(1.0)).count();
    const double black = request.camera.black.value_or(file.raw_levels ? file.raw_levels->black : 0.0);
    const auto table =
        file.bits > 0 ? bracket_calibration(request.camera, file.bits).linear_from_dn : std::vector<float>{};
    return BlockMeans(block_means(file, table, black) / static_cast<float>(seconds));
  };
  Progress progress(run, "checking the order", groups.size());
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t i) {
    run.throw_if_stopped();
    series.photographs[i] = means_of(groups[i].paths);
    progress.advance();
  });
  if (!request.ambient.empty()) series.black = means_of(request.ambient);
  for (const BracketGroup& group : groups) series.taken.push_back(capture_time(group.paths.front()));
  const auto shown = read_times(request.lights.front().parent_path());
  for (const fs::path& light : request.lights) {
    series.lights.push_back(block_means(read_light_map(light, request.parameterisation, run).radiance));
    const auto time = shown.find(light.stem().string());
    series.shown.push_back(time == shown.end() ? std::nullopt : std::optional(time->second));
  }
  return series;
}

/// Makes the first bracket without light, or the darkest where that has much more light, the ambient one.
void choose_ambient(ImportRequest& request, const std::vector<BracketGroup>& groups,
                    const OrderedSeries& series, const OrderedPairing& pairing) {
  const auto file = [&](std::size_t i) { return groups[i].paths.front().string(); };
  auto& notes = request.stage.notes;
  if (pairing.black.empty()) {
    if (request.ambient_first)
      throw InputError(file(0),
                       ": the first bracket shows a light and is not the ambient one; leave out "
                       "--ambient-first, or photograph black");
    return;
  }
  if (request.ambient.empty()) {
    const auto brightness = [&](std::size_t i) { return series.photographs[i].sum(); };
    constexpr float uneven = 1.3f;
    const float level = uneven * brightness(*std::ranges::min_element(pairing.black, {}, brightness));
    const std::size_t chosen =
        *std::ranges::find_if(pairing.black, [&](std::size_t i) { return brightness(i) <= level; });
    if (chosen != pairing.black.front()) {
      notes.push_back(file(pairing.black.front()) + ": is brighter than " + file(chosen) +
                      ", although both show black: the room light was on. The darker one is subtracted");
    } else if (!request.ambient_first || chosen != 0) {
      notes.push_back(file(chosen) + ": is black and is subtracted as the ambient light");
    }
    request.ambient = groups[chosen].paths;
  }
  std::vector<std::string> others;
  for (const std::size_t i : pairing.black)
    if (groups[i].paths != request.ambient) others.push_back(file(i));
  if (!others.empty())
    notes.push_back("further black brackets, which are left out: " + listed(others, max_names));
}

std::vector<ImportedView> with_lights_by_order(ImportRequest& request, std::vector<BracketGroup> groups,
                                               const RunContext& run) {
  constexpr std::size_t enough = 10;  // for brightness to say something
  const std::size_t lights = request.lights.size();
  OrderedPairing pairing;
  std::optional<OrderedSeries> series;
  if (lights >= enough) {
    series = read_series(request, groups, run);
    pairing = pair_in_order(*series);
  }
  const std::size_t first = request.ambient_first ? 1 : 0;
  if (!pairing.is_certain && groups.size() != lights + first)
    throw InputError(
        groups.size() - first, " brackets (the last begins with ", groups.back().paths.front(), ") but ",
        lights, " lights (the last is ", request.lights.back(),
        "), and their brightness does not tell which belong together; give as many of each (--ambient-first "
        "takes the first bracket out), pair them by name with --names, or by time with --pair-by time");
  std::vector<ImportedView> views;
  if (!pairing.is_certain) {
    if (first == 1) request.ambient = groups.front().paths;
    for (std::size_t j = 0; j < lights; ++j)
      views.push_back({groups[j + first], request.lights[j].stem().string(), request.lights[j], {}});
    return views;
  }
  choose_ambient(request, groups, *series, pairing);
  std::vector<std::string> missing, doubled, stray;
  for (std::size_t j = 0; j < lights; ++j)
    if (const auto bracket = pairing.bracket_of[j])
      views.push_back({groups[*bracket], request.lights[j].stem().string(), request.lights[j], {}});
    else
      missing.push_back(request.lights[j].stem().string());
  for (const auto& [bracket, light] : pairing.doubled)
    doubled.push_back(groups[bracket].paths.front().string() + " (" + request.lights[light].stem().string() +
                      ")");
  for (const std::size_t bracket : pairing.stray) stray.push_back(groups[bracket].paths.front().string());
  for (const auto& [what, names] :
       {std::pair{"lights without photographs, which are left out: ", &missing},
        {"brackets that repeat the one before or after, which are left out: ", &doubled},
        {"brackets that show none of the lights, which are left out: ", &stray}})
    if (!names->empty()) request.stage.notes.push_back(what + listed(*names, max_names));
  return views;
}

std::vector<ImportedView> with_lights_by_name(const ImportRequest& request,
                                              const std::vector<BracketGroup>& groups) {
  std::vector<ImportedView> views;
  std::set<std::string> used;
  for (const BracketGroup& bracket : groups) {
    const auto light = std::ranges::find(request.lights, bracket.name,
                                         [](const fs::path& path) { return path.stem().string(); });
    if (light == request.lights.end())
      throw InputError(bracket.paths.front(), ": there is no light named '", bracket.name,
                       "'; add it, or pair brackets and lights by --pair-by order");
    views.push_back({bracket, bracket.name, *light, {}});
    used.insert(bracket.name);
  }
  for (const fs::path& light : request.lights)
    if (!used.contains(light.stem().string()))
      throw InputError(light, ": no bracket is named '", light.stem(),
                       "'; add its photographs, or take the light out of the folder");
  return views;
}

/// Index of the bracket that has a file of that name or else, for lists that name another format, is named
/// like it without extension.
std::optional<std::size_t> bracket_of(const std::string& photograph,
                                      const std::vector<BracketGroup>& groups) {
  const auto has_file = [&](const BracketGroup& group) {
    return std::ranges::any_of(group.paths,
                               [&](const fs::path& path) { return path.filename() == photograph; });
  };
  const std::string stem = fs::path(photograph).stem().string();
  auto found = std::ranges::find_if(groups, has_file);
  if (found == groups.end())
    found = std::ranges::find_if(
        groups, [&](const BracketGroup& group) { return group.name == photograph || group.name == stem; });
  if (found == groups.end()) return std::nullopt;
  return static_cast<std::size_t>(found - groups.begin());
}

std::vector<ImportedView> with_light_sources(LightStage& stage, const std::vector<BracketGroup>& groups) {
  const bool named = !stage.sources.front().photograph.empty();
  if (!named && groups.size() != stage.sources.size())
    throw InputError(groups.size(), " photographs (the last is ", groups.back().paths.front(), ") but ",
                     stage.sources.size(), " light sources in ", stage.file,
                     "; give as many of each, or name the photographs in filenames.txt beside it");
  std::vector<ImportedView> views;
  std::vector<bool> used(groups.size(), false);
  for (std::size_t i = 0; i < stage.sources.size(); ++i) {
    const LightSource& source = stage.sources[i];
    const std::string& name = source.photograph;
    const auto bracket = named ? bracket_of(name, groups) : i;
    if (!bracket)
      throw InputError(stage.file, ":", source.line, ": the photograph '", name, "' is not among the ",
                       groups.size(), " given (the first is ", groups.front().paths.front(),
                       "); add it, or take its light source out of the list");
    if (used[*bracket])
      throw InputError(groups[*bracket].paths.front(), ": belongs to two light sources of ", stage.file,
                       ", the second is '", name, "'; give each one photograph or bracket");
    used[*bracket] = true;
    views.push_back({groups[*bracket], groups[*bracket].name, {}, {}, i});
  }
  const auto left_out = std::ranges::count(used, false);
  if (left_out > 0) {
    const auto first = static_cast<std::size_t>(std::ranges::find(used, false) - used.begin());
    stage.notes.push_back(
        "photographs without a light source, which were left out: " + std::to_string(left_out) +
        " (first: " + groups[first].paths.front().string() + ")");
  }
  return views;
}

/// Gives each view the white card of its name or, where no name is the same, of its place.
void assign_cards(ImportRequest& request, std::vector<ImportedView>& views, const RunContext& run) {
  const auto cards = group(request.flat_fields, request, run);
  const auto card_of = [&](const ImportedView& view) {
    return std::ranges::find(cards, view.bracket.name, &BracketGroup::name);
  };
  const ImportedView* without = nullptr;
  std::size_t found = 0;
  for (ImportedView& view : views) {
    if (const auto card = card_of(view); card != cards.end()) {
      view.card = *card;
      ++found;
    } else if (!without) {
      without = &view;
    }
  }
  if (!without) return;
  if (found > 0 || cards.size() != views.size())
    throw InputError(
        without->bracket.paths.front().string() + ": none of the " + std::to_string(cards.size()) +
        " photographs of a white card (--flat-fields, the first is " + cards.front().paths.front().string() +
        ") is named '" + without->name + "'; give one card for each of the " + std::to_string(views.size()) +
        " light sources, under the name of its photograph");
  for (std::size_t i = 0; i < views.size(); ++i) views[i].card = cards[i];
  request.stage.notes.emplace_back(
      "the photographs of the white card have other names; they are assigned in the order of names");
}

/// What the plan records of a view's light.
std::string source_text(const LightStage& stage, std::size_t index) {
  const LightSource& source = stage.sources[index];
  std::ostringstream text;
  text << "texel " << source.column << " " << source.row << " of " << stage.domain.width << "×"
       << stage.domain.height << ", intensity";
  for (const float value : source.intensity) text << " " << value;
  return text.str();
}

}  // namespace

std::vector<ImportedView> views_of(ImportRequest& request, const RunContext& run) {
  auto groups = group(request.photographs, request, run);
  const bool in_order = !request.lights.empty() && request.lights_by_order;
  if (request.ambient_first) {
    if (!request.ambient.empty())
      throw InputError("the ambient photographs are given twice: give --ambient or --ambient-first");
    if (groups.size() < 2)
      throw InputError(groups.front().paths.front(),
                       ": is the only bracket; besides the ambient one there must be others");
    if (!in_order) {
      request.ambient = groups.front().paths;
      groups.erase(groups.begin());
    }
  }
  std::vector<ImportedView> views = !request.makes_session() ? without_lights(groups)
                                    : request.ball           ? without_lights(groups)
                                    : !request.stage.sources.empty()
                                        ? with_light_sources(request.stage, groups)
                                    : in_order ? with_lights_by_order(request, groups, run)
                                               : with_lights_by_name(request, groups);
  std::set<std::string> names;
  for (ImportedView& view : views) {
    if (!names.insert(view.name).second)
      throw InputError(view.bracket.paths.front(), ": two photographs would be named '", view.name,
                       "'; rename one");
    view.time = capture_time(view.bracket.paths.front());
  }
  if (const fs::path& first = views.front().bracket.paths.front(); !is_camera_raw(first))
    if (const int orientation = read_image_facts(first).orientation; orientation != 1)
      request.stage.notes.push_back("photographs are turned as their EXIF orientation, " +
                                    std::to_string(orientation) + ", says");
  if (!request.flat_fields.empty()) assign_cards(request, views, run);
  return views;
}

std::vector<BracketSamples> sample_series(const std::vector<ImportedView>& views,
                                          const ImportRequest& request, std::size_t max_brackets,
                                          const RunContext& run) {
  const std::size_t count = std::min(views.size(), max_brackets);
  std::vector<BracketSamples> brackets;
  Progress progress(run, "checking the response", count);
  for (std::size_t i = 0; i < count; ++i) {
    run.throw_if_stopped();
    brackets.push_back(samples_of(
        read_bracket(views[i * views.size() / count].bracket.paths, request.camera, request.exposures)));
    progress.advance();
  }
  return brackets;
}

FrameRole role_of(const ImportRequest& request, const std::string& name, std::size_t place) {
  const FrameRole role = role_of_light(name);
  const auto every = static_cast<std::size_t>(request.test_every);
  return role == FrameRole::train && every > 0 && (place + 1) % every == 0 ? FrameRole::test : role;
}

std::string plan_of(const ImportRequest& request, const std::vector<ImportedView>& views) {
  const auto file_text = [](const fs::path& path) {
    std::error_code error;
    const auto bytes = fs::file_size(path, error);
    return path.filename().string() + " " + (error ? "missing" : std::to_string(bytes));
  };
  const auto list_of = [&](const std::vector<fs::path>& paths) {
    toml::array list;
    for (const fs::path& path : paths) list.push_back(file_text(path));
    return list;
  };
  toml::array frames, exposures;
  for (std::size_t i = 0; i < views.size(); ++i) {
    toml::table frame{{"name", views[i].name},
                      {"role", std::string(name_of(role_of(request, views[i].name, i)))},
                      {"light", request.stage.sources.empty() ? file_text(views[i].light)
                                                              : source_text(request.stage, views[i].source)},
                      {"photographs", list_of(views[i].bracket.paths)}};
    if (!views[i].card.paths.empty()) frame.insert("white_card", list_of(views[i].card.paths));
    frames.push_back(std::move(frame));
  }
  for (const Seconds exposure : request.exposures) exposures.push_back(exposure.count());
  const BracketCamera& camera = request.camera;
  const auto optional_text = [](const std::optional<double>& value) {
    return value ? std::to_string(*value) : "";
  };
  toml::array monitors;
  for (const MonitorPlacement& monitor : request.monitors) monitors.push_back(text_of(monitor));
  toml::table plan{
      {"format", "refield import"},
      {"version", 1},
      {"response", fs::is_regular_file(camera.response) ? file_text(camera.response) : camera.response},
      {"layout", camera.layout},
      {"black", optional_text(camera.black)},
      {"saturation", optional_text(camera.saturation)},
      {"full_scale_electrons", camera.full_scale_electrons},
      {"read_noise_electrons", camera.read_noise_electrons},
      {"exposures", exposures},
      {"lights_hold", request.light_content == LightContent::radiance ? "radiance" : "drive levels"},
      {"parameterisation", std::string(name_of(request.parameterisation))},
      {"half", request.precision == Precision::half},
      {"mask", request.mask ? file_text(*request.mask) : ""},
      {"ambient", list_of(request.ambient)},
      {"frame", frames}};
  if (!monitors.empty()) plan.insert("monitors", monitors);
  std::ostringstream text;
  text << plan << "\n";
  return text.str();
}

}  // namespace refield
