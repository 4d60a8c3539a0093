// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/simulate.h"
#include "cli/common/options.h"
#include "cli/run_context.h"

#include <cstdio>

#include "cli/report/report.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"

namespace refield::cli {

namespace {

// A larger transport is left out unless asked for: reading it back takes twice as much memory.
constexpr std::uint64_t largest_automatic_transport = 2ull << 30;

struct Arguments {
  fs::path recipe;
  fs::path folder;
  std::string size, light_size;
  std::optional<int> train;
  std::vector<int> test;
  std::string kind;
  std::optional<std::int64_t> seed;
  std::optional<int> quality;
  double noise = 0.0;
  bool half = false;
  std::string transport = "auto";
};

Recipe recipe_of(const Arguments& arguments) {
  Recipe recipe = read_recipe(arguments.recipe);
  const auto replace = [](const auto& given, auto& value, const char* option, int low, int high) {
    if (!given) return;
    if (*given < low || *given > high)
      throw InputError(option, " ", *given, ": give a number from ", low, " to ", high);
    value = *given;
  };
  if (!arguments.size.empty()) {
    const PictureSize size = read_picture_size(arguments.size, {1, 1});
    recipe.scene.camera.width = size.width;
    recipe.scene.camera.height = size.height;
  }
  if (!arguments.light_size.empty()) {
    const PictureSize size = read_picture_size(arguments.light_size, {8, 8}, "--light-size");
    recipe.scene.monitor.texels.width = size.width;
    recipe.scene.monitor.texels.height = size.height;
  }
  replace(arguments.train, recipe.lights.train, "--train", 1, 9999);
  if (!arguments.test.empty()) {
    int* const counts[] = {&recipe.lights.natural, &recipe.lights.bars, &recipe.lights.squares};
    for (std::size_t i = 0; i < 3; ++i)
      replace(std::optional(arguments.test[i]), *counts[i], "--test", 0, i == 0 ? 9999 : 999);
  }
  if (!arguments.kind.empty()) recipe.lights.kind = arguments.kind;
  replace(arguments.seed, recipe.seed, "--seed", 0, 0x7fffffff);
  return recipe;
}

// What made the folder, and whether it is finished: tells our own output from anyone else's files.
constexpr const char* record_name = "simulation.json";

void write_record(const fs::path& folder, Json provenance, bool complete) {
  provenance["complete"] = complete;
  write_text_atomically(folder / record_name, json_text(provenance, 2) + "\n");
}

// An unfinished simulation may be replaced, a finished one with --force, anything else never.
void require_replaceable(const fs::path& folder, bool force) {
  if (fs::exists(folder) && !fs::is_directory(folder))
    throw InputError(folder, ": is a file; give the name of a folder");
  if (!fs::exists(folder) || fs::is_empty(folder)) return;
  if (!fs::exists(folder / record_name))
    throw InputError(folder, ": is not empty and was not created by 'refield simulate'; give another folder");
  const auto record = json_if_valid(read_text(folder / record_name));
  const bool unfinished = record.is_object() && record.contains("complete") && record["complete"] == false;
  if (!unfinished && !force)
    throw InputError(folder,
                     ": already contains a simulation; give another folder, or --force to replace it");
}

/// Whether a file is named as those of lights are: train_007.exr, test_natural_012.exr.
bool is_image_of_a_light(const fs::path& path) {
  const std::string stem = path.stem().string();
  const auto mark = stem.find_last_of('_');
  return path.extension() == ".exr" && mark != std::string::npos && stem.size() - mark > 3 &&
         stem.find_first_not_of("0123456789", mark + 1) == std::string::npos &&
         (stem.starts_with("train_") || stem.starts_with("test_"));
}

void remove_earlier(const fs::path& folder) {
  for (const char* name : {session_manifest_name, transport_file_name, ambient_file_name})
    fs::remove(folder / name);
  // Files of the user's stay, even among ours.
  for (const char* name : {"illumination", "observed"}) {
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(folder / name, ignored))
      if (is_image_of_a_light(entry.path()) || entry.path().filename().string().starts_with(".partial-"))
        fs::remove(entry.path());
    fs::remove(folder / name, ignored);
  }
}

void print(const SimulateSummary& summary, const fs::path& folder, bool json) {
  const double pixels = static_cast<double>(summary.width) * summary.height;
  const double rays_per_second = static_cast<double>(summary.rays) / std::max(1e-9, summary.trace_seconds);
  if (json)
    return print_json(Json{{"folder", folder.string()},
                           {"width", summary.width},
                           {"height", summary.height},
                           {"lights", summary.lights},
                           {"entries_per_pixel", summary.entries_per_pixel},
                           {"transport_bytes", summary.transport_bytes},
                           {"rays", summary.rays},
                           {"rays_per_second", rays_per_second},
                           {"light_seconds", summary.light_seconds},
                           {"trace_seconds", summary.trace_seconds},
                           {"write_seconds", summary.write_seconds}});
  std::printf("%s: %d photographs of %d×%d pixels\n", folder.c_str(), summary.lights, summary.width,
              summary.height);
  std::printf("transport: %.0f boxes per pixel", summary.entries_per_pixel);
  if (summary.transport_bytes > 0)
    std::printf(", %.0f MB in %s\n", static_cast<double>(summary.transport_bytes) / 1e6, transport_file_name);
  else
    std::printf(", not stored\n");
  std::printf(
      "time: light maps %.1f s, tracing %.1f s (%.1f million rays per second, %.0f per pixel), writing %.1f "
      "s\n",
      summary.light_seconds, summary.trace_seconds, rays_per_second / 1e6,
      static_cast<double>(summary.rays) / pixels, summary.write_seconds);
}

void simulate(const Arguments& arguments, const Common& common) {
  const Recipe recipe = recipe_of(arguments);
  const OutputLock lock(arguments.folder, {});
  require_replaceable(arguments.folder, common.force);
  SimulateOptions options;
  options.precision = arguments.half ? Precision::half : Precision::single;
  options.noise = arguments.noise;
  SimulatePlan plan = plan_simulate(recipe, options);
  const bool large = plan.transport_bytes > largest_automatic_transport;
  options.keep_transport = arguments.transport == "always" || (arguments.transport == "auto" && !large);
  options.quality = arguments.quality.value_or(large ? 1 : 2);
  options.check();
  plan = plan_simulate(recipe, options);
  if (!common.quiet) {
    if (large && arguments.transport == "auto")
      std::fprintf(
          stderr, "The transport would take about %.1f GB and is not stored; --transport always stores it.\n",
          static_cast<double>(plan_simulate(recipe, {}).transport_bytes) / 1e9);
    std::fprintf(stderr, "The simulation needs about %.0f MB of memory and %.0f MB of disk space.\n",
                 static_cast<double>(plan.memory_bytes) / 1e6, static_cast<double>(plan.disk_bytes) / 1e6);
  }
  const Json provenance{{"program", "refield " REFIELD_VERSION},
                        {"method", "ray traced transport"},
                        {"recipe", arguments.recipe.filename().string()},
                        {"seed", recipe.seed},
                        {"quality", options.quality},
                        {"noise", options.noise}};
  options.provenance = json_text(provenance);
  require_free_space(arguments.folder, plan.disk_bytes);
  create_folders(arguments.folder);
  write_record(arguments.folder, provenance, false);
  remove_earlier(arguments.folder);
  const SimulateSummary summary = simulate_session(recipe, options, arguments.folder, run_context());
  write_record(arguments.folder, provenance, true);
  report::write_run_log(arguments.folder, "simulate",
                        summary.light_seconds + summary.trace_seconds + summary.write_seconds,
                        {{"lights", summary.lights},
                         {"rays", summary.rays},
                         {"entries_per_pixel", summary.entries_per_pixel},
                         {"transport_bytes", summary.transport_bytes}});
  print(summary, arguments.folder, common.json);
}

}  // namespace

void add_simulate(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand(
      "simulate",
      "Create a synthetic data set with exact light transport by ray tracing.\n"
      "\n"
      "Traces the light transport from the monitor to every pixel of the recipe's scene once, and computes "
      "the photograph under each light map from it. The folder becomes a capture session (illumination/, "
      "observed/, session.toml) with these additional files:\n"
      "  transport.rfield   exact light transport: 'refield relight' renders the true image under any light\n"
      "  ambient.exr        image of the scene under the room light, for 'refield acquire run'\n"
      "\n"
      "Examples:\n"
      "  refield simulate datasets_synthetic/tabletop/recipe.toml -o truth\n"
      "  refield simulate recipe.toml -o quick --size 64x48 --train 60 --noise 0.005\n"
      "  refield simulate recipe.toml -o large --size 1024x768 --light-size 800x600 --half");
  verb->add_option("recipe", arguments->recipe,
                   "Description of the data set (.toml, docs/reference/synthetic-scenes.md)")
      ->required();
  verb->add_option("-o,--output", arguments->folder, "Folder to create")->required();
  verb->add_option("--size", arguments->size, "Size of the picture in pixels (default: from the recipe)")
      ->type_name("WIDTHxHEIGHT");
  verb->add_option("--light-size", arguments->light_size,
                   "Size of the light maps in texels (default: from the recipe)")
      ->type_name("WIDTHxHEIGHT");
  verb->add_option("--train", arguments->train,
                   "Number of light maps for estimation (default: from the recipe)");
  verb->add_option("--test", arguments->test,
                   "Numbers of held-out light maps: natural images, white bars, white squares (default: from "
                   "the recipe)")
      ->delimiter(',')
      ->expected(3)
      ->type_name("N,N,N");
  verb->add_option("--kind", arguments->kind,
                   "Training patterns: designed for estimation, or natural images as in the paper (default: "
                   "from the recipe)")
      ->check(CLI::IsMember({"designed", "natural"}));
  verb->add_option("--seed", arguments->seed,
                   "Seed of all random numbers of the simulation (default: from the recipe)");
  verb->add_option("--quality", arguments->quality,
                   "Quality of ray tracing: 1 fast, 2 balanced, 3 least noise (default: 2; 1 if the "
                   "transport is too large to be stored)");
  verb->add_option(
      "--noise", arguments->noise,
      "Relative standard deviation of Gaussian noise on the photographs, such as 0.005 (default: 0)");
  verb->add_flag("--half", arguments->half,
                 "Write 16-bit half-float images: half the disk space, relative rounding error 0.05 %");
  verb->add_option("--transport", arguments->transport,
                   "When to write transport.rfield: auto (up to 2 GiB), always or never")
      ->check(CLI::IsMember({"auto", "always", "never"}))
      ->capture_default_str();
  on_command(*verb, arguments, common, action, simulate);
}

}  // namespace refield::cli
