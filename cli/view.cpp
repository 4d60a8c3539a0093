// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/common/options.h"
#include "cli/dynamic/prepared_scene.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/light/monitor_placement.h"
#include "relight/viewer/viewer.h"

namespace refield::cli {

namespace {

struct ViewOptions {
  WindowOptions window;
  std::filesystem::path shown;
  std::string light, script, size;
  std::vector<std::string> placements;
};

void view(const ViewOptions& options) {
  const bool moves = options.shown.extension() == ".toml";
  if (moves && !options.placements.empty())
    throw InputError(
        "--placement: a dynamic scene has no monitor; it is supported for fields (.rfield) only");
  if (moves && !options.light.empty())
    throw InputError("--light " + options.light + ": a dynamic scene defines its area lights in " +
                     options.shown.string() + "; light maps are supported for fields (.rfield) only");
  if (moves)
    return run_scene_viewer(
        options.shown.filename().string(), [&] { return read_moving_scene(options.shown); }, options.window,
        run_context());
  const auto light =
      options.light.empty() ? std::nullopt : std::optional<std::filesystem::path>(options.light);
  run_viewer(options.shown, light, options.window, run_context());
}

}  // namespace

void add_view(CLI::App& app, const Common&, Action& action) {
  const auto options = std::make_shared<ViewOptions>();
  CLI::App* verb = app.add_subcommand(
      "view",
      "Relight a field or a dynamic scene in an interactive viewer.\n"
      "\n"
      "Fields: drag area lights over the light map to relight the scene; click a pixel to see which light "
      "reaches it; hold the right mouse button on the light map to see the contribution of that region. Drop "
      "light maps and fields onto the window to open them.\n"
      "\n"
      "Dynamic scenes: drag objects and area lights; Space plays the motion of the scene.\n"
      "\n"
      "F1 lists all keys.\n"
      "\n"
      "Examples:\n"
      "  refield view scene.rfield --light sky.exr\n"
      "  refield view datasets_synthetic/dynamic/room.toml");
  verb->add_option(
          "file", options->shown,
          "File: reflectance field (.rfield) or dynamic scene (.toml, docs/reference/scene-files.md)")
      ->required();
  verb->add_option("--light", options->light,
                   "Light maps: the file shown at first (EXR, HDR: linear; PNG, JPEG: sRGB; default: white)");
  add_placement_option(*verb, options->placements,
                       "Environment maps are seen through it (default: that of the field).");
  verb->add_option("--size", options->size, "Size of the picture in pixels (default: 1440x900)")
      ->type_name("WIDTHxHEIGHT");
  verb->add_option("--script", options->script,
                   "File of viewer commands to run, '-' for standard input (docs/guide/viewer.md)");
  verb->callback([options, &action] {
    action = [options] {
      WindowOptions& window = options->window;
      if (!options->placements.empty()) window.monitors = placements_from_texts(options->placements);
      if (!options->script.empty()) window.script = options->script;
      if (!options->size.empty()) {
        const PictureSize size = read_picture_size(options->size, {720, 520});
        window.width = size.width;
        window.height = size.height;
      }
      view(*options);
    };
  });
}

}  // namespace refield::cli
