// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/units.h"
#include "simulate/rig/device_models.h"
#include "simulate/tabletop/scene.h"

namespace refield {

/// How many light maps of each kind to make.
struct LightPlan {
  int train = 180;               ///< for estimation
  std::string kind = "natural";  ///< of the training lights: "natural" or "designed"
  int natural = 12;              ///< held out, from panoramas that no training light shows
  int coloured = 0;              ///< held out, such views in one or two of the three primaries
  int bars = 8;                  ///< white, an eighth of the width, sliding from left to right
  int squares = 6;               ///< white, a sixteenth of the width
  int white = 1;
  int black = 1;
};

/// The exposures of one photograph, for the capture stage.
struct ExposureSeries {
  int count = 4;
  double ratio = 4.0;              ///< of one exposure to the next shorter
  std::optional<Seconds> longest;  ///< else metered
  int frames = 1;                  ///< averaged for each exposure
  int ambient_frames = 0;          ///< of the ambient photograph; 0: a number by that of the lights
};

/// What virtual devices the scene is photographed with.
struct RigRecipe {
  MonitorModel monitor;
  SensorModel sensor;
  ExposureSeries exposures;
  Disturbances disturbances;
  int reference_every = 20;  ///< lights between two frames of the reference light; 0: none are taken
};

/// One synthetic data set, as datasets_synthetic/<name>/recipe.toml describes it.
struct Recipe {
  fs::path path;  ///< for messages
  fs::path base;  ///< the recipe that it extends; empty: none
  std::uint64_t seed = 1;
  SceneDescription scene;
  LightPlan lights;
  RigRecipe rig;
};

/// Reads and checks a recipe, with what it does not say itself from that which it names as its `base`. Throws
/// InputError naming the file, line, key, value and remedy; a key that is not known is an error.
/// docs/reference/synthetic-scenes.md lists all keys.
Recipe read_recipe(const fs::path& path);

}  // namespace refield
