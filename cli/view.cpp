// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/dynamic/scene_by_hand.h"
#include "cli/picture_size.h"
#include "cli/verbs.h"
#include "core/errors.h"
#include "relight/viewer/viewer.h"

namespace refield::cli {

namespace {

struct ViewOptions {
  WindowOptions window;
  std::filesystem::path shown;
  std::string light, script, size;
};

void view(const ViewOptions& options) {
  const bool moves = options.shown.extension() == ".toml";
  if (moves && !options.light.empty())
    throw InputError("--light " + options.light + ": a moving scene has its lamps in " +
                     options.shown.string() + "; maps are for fields (.rfield)");
  if (moves)
    return run_scene_viewer(
        options.shown.filename().string(), [&] { return read_moving_scene(options.shown); }, options.window);
  const auto light =
      options.light.empty() ? std::nullopt : std::optional<std::filesystem::path>(options.light);
  run_viewer(options.shown, light, options.window);
}

}  // namespace

void add_view(CLI::App& app, const Common&, Action& action) {
  const auto options = std::make_shared<ViewOptions>();
  CLI::App* verb =
      app.add_subcommand("view",
                         "Relight a scene by hand, or move objects and lamps about in it, in a window\n\n"
                         "  refield view scene.rfield --light sky.exr\n"
                         "  refield view datasets_synthetic/dynamic/room.toml");
  verb->add_option(
          "scene", options->shown,
          "Reflectance field (.rfield), or a scene that moves (.toml, docs/reference/mesh-scenes.md)")
      ->required();
  verb->add_option("--light", options->light, "Light map to begin with (EXR, HDR: linear; PNG, JPEG: sRGB)");
  verb->add_option("--size", options->size, "Of the window, WIDTHxHEIGHT (default 1440x900)");
  verb->add_option("--script", options->script,
                   "Drive the viewer by a file of commands, '-' for standard input (docs/guide/viewer.md)");
  verb->footer(
      "Fields: drag lamps over the light map and see the scene follow; click a pixel to see where its light "
      "comes "
      "from; hold\nthe right button on the light map to see what that part alone lights. Drop light maps and "
      "fields onto the window.\nMoving scenes: drag objects and lamps; Space plays the scene's own "
      "motion.\nF1 shows all keys.");
  verb->callback([options, &action] {
    action = [options] {
      WindowOptions& window = options->window;
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
