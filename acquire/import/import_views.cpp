// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_views.h"

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

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

std::vector<ImportedView> with_lights_by_order(const ImportRequest& request,
                                               const std::vector<BracketGroup>& groups) {
  if (groups.size() != request.lights.size())
    throw InputError(
        std::to_string(groups.size()) + " brackets (the last begins with " +
        groups.back().paths.front().string() + ") but " + std::to_string(request.lights.size()) +
        " lights (the last is " + request.lights.back().string() +
        "); give as many of each (--ambient-first takes the first bracket out), pair them by name "
        "with --pattern, or by time with 'refield acquire match'");
  std::vector<ImportedView> views;
  for (std::size_t i = 0; i < groups.size(); ++i)
    views.push_back({groups[i], request.lights[i].stem().string(), request.lights[i], {}});
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
      throw InputError(bracket.paths.front().string() + ": there is no light named '" + bracket.name +
                       "'; add it, or pair brackets and lights by --lights-by order");
    views.push_back({bracket, bracket.name, *light, {}});
    used.insert(bracket.name);
  }
  for (const fs::path& light : request.lights)
    if (!used.contains(light.stem().string()))
      throw InputError(light.string() + ": no bracket is named '" + light.stem().string() +
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
    throw InputError(std::to_string(groups.size()) + " photographs (the last is " +
                     groups.back().paths.front().string() + ") but " + std::to_string(stage.sources.size()) +
                     " light sources in " + stage.file.string() +
                     "; give as many of each, or name the photographs in "
                     "filenames.txt beside it");
  std::vector<ImportedView> views;
  std::vector<bool> used(groups.size(), false);
  for (std::size_t i = 0; i < stage.sources.size(); ++i) {
    const LightSource& source = stage.sources[i];
    const std::string& name = source.photograph;
    const auto bracket = named ? bracket_of(name, groups) : i;
    if (!bracket)
      throw InputError(stage.file.string() + ":" + std::to_string(source.line) + ": the photograph '" + name +
                       "' is not among the " + std::to_string(groups.size()) + " given (the first is " +
                       groups.front().paths.front().string() +
                       "); add it, or take its light source out of the list");
    if (used[*bracket])
      throw InputError(groups[*bracket].paths.front().string() + ": belongs to two light sources of " +
                       stage.file.string() + ", the second is '" + name +
                       "'; give each one photograph or bracket");
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
  if (request.ambient_first) {
    if (!request.ambient.empty())
      throw InputError("the ambient photographs are given twice: give --ambient or --ambient-first");
    if (groups.size() < 2)
      throw InputError(groups.front().paths.front().string() +
                       ": is the only bracket; besides the ambient one there must be others");
    request.ambient = groups.front().paths;
    groups.erase(groups.begin());
  }
  std::vector<ImportedView> views = !request.makes_session() ? without_lights(groups)
                                    : request.ball           ? without_lights(groups)
                                    : !request.stage.sources.empty()
                                        ? with_light_sources(request.stage, groups)
                                    : request.lights_by_order ? with_lights_by_order(request, groups)
                                                              : with_lights_by_name(request, groups);
  std::set<std::string> names;
  for (ImportedView& view : views) {
    if (!names.insert(view.name).second)
      throw InputError(view.bracket.paths.front().string() + ": two photographs would be named '" +
                       view.name + "'; rename one");
    view.time = capture_time(view.bracket.paths.front());
  }
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
  if (name.starts_with("test")) return FrameRole::test;
  if (name.starts_with("reference")) return FrameRole::reference;
  const auto every = static_cast<std::size_t>(request.test_every);
  return every > 0 && (place + 1) % every == 0 ? FrameRole::test : FrameRole::train;
}

namespace fs = std::filesystem;

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
  std::ostringstream text;
  text << plan << "\n";
  return text.str();
}

}  // namespace refield
