// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/verbs.h"
#include "core/errors.h"
#include "relight/viewer/viewer.h"

namespace refield::cli {

namespace {

struct ViewOptions {
  ViewerOptions viewer;
  std::string light, script, size;
};

/// "1440x900".
void read_size(const std::string& text, ViewerOptions& viewer) {
  char rest = '\0';
  if (std::sscanf(text.c_str(), "%dx%d%c", &viewer.width, &viewer.height, &rest) != 2 || viewer.width < 720 ||
      viewer.height < 520 || viewer.width > 16384 || viewer.height > 16384)
    throw InputError("--size " + text + ": give width x height in pixels, 720x520 to 16384x16384");
}

}  // namespace

void add_view(CLI::App& app, const Common&, Action& action) {
  const auto options = std::make_shared<ViewOptions>();
  CLI::App* verb = app.add_subcommand("view", "Relight a captured scene by hand, in a window");
  verb->add_option("field", options->viewer.field, "Reflectance field (.rfield)")->required();
  verb->add_option("--light", options->light, "Light map to begin with (EXR, HDR: linear; PNG, JPEG: sRGB)");
  verb->add_option("--size", options->size, "Of the window, WIDTHxHEIGHT (default 1440x900)");
  verb->add_option("--script", options->script,
                   "Drive the viewer by a file of commands, '-' for standard input (docs/viewer.md)");
  verb->footer(
      "Drag lamps over the light map and see the scene follow; click a pixel to see where its light comes "
      "from; hold\nthe right button on the light map to see what that part alone lights. Drop light maps and "
      "fields onto the window.\nF1 shows all keys.");
  verb->callback([options, &action] {
    action = [options] {
      ViewerOptions& viewer = options->viewer;
      if (!options->light.empty()) viewer.light = options->light;
      if (!options->script.empty()) viewer.script = options->script;
      if (!options->size.empty()) read_size(options->size, viewer);
      run_viewer(viewer);
    };
  });
}

}  // namespace refield::cli
