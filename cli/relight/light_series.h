// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>

#include "refield/relight.h"

namespace refield::cli {

/// From where a field over a mesh is shown; what is absent is as the field's own camera has it, or frames the
/// mesh.
struct CameraOptions {
  std::vector<float> position, target;  ///< three numbers or none
  std::optional<float> fov;             ///< degrees, vertical
  std::string size;                     ///< WIDTHxHEIGHT or empty
  bool turntable = false;               ///< goes once around the target
  bool show_environment = false;        ///< beside the mesh
};

void add_camera_options(CLI::App& verb, CameraOptions& options);

/// What PictureOptions::cameras takes. Throws InputError for a camera that cannot be, and for camera options
/// with a field that has no mesh.
std::vector<ViewCamera> cameras_of(const CameraOptions& options, const Field& field,
                                   const std::filesystem::path& path, int frames);

/// Options of `refield relight`.
struct RelightOptions {
  std::filesystem::path field;
  std::vector<std::string> lights;        ///< light maps of the field's own size
  std::vector<std::string> environments;  ///< maps of the environment, of any size
  std::vector<std::string> placements;    ///< placements, in place of the field's own
  EulerAngles turn;                       ///< of environments
  std::filesystem::path area_lights;      ///< area lights around a mesh, as a file describes them
  double bar = 0.0;                       ///< width as a fraction of the light map; 0: no bar
  bool rotate = false;
  bool day = false;  ///< a sky from sunrise to sunset
  SkyOptions sky;
  CameraOptions camera;
  int frames = 0;
  std::filesystem::path output;
  std::string format = "exr";
  PictureOptions pictures;

  /// Whether the light fades from each environment to the next.
  bool fades() const {
    return frames > 0 && !rotate && (environments.size() > 1 || (!environments.empty() && !camera.turntable));
  }
};

/// How much of an environment the monitor's windows saw, so that no one takes a part for the whole.
struct SeenShare {
  std::string light;
  EnvironmentShare share;
};
/// One line a light; of many, one line for all.
void print_seen(const std::vector<SeenShare>& seen);
nlohmann::ordered_json seen_figures(const std::vector<SeenShare>& seen);

/// One of the pictures to make.
struct SeriesPicture {
  std::string name;                             ///< of its file, without extension
  std::optional<std::filesystem::path> source;  ///< the file of its light, where it is one file's
};

/// What the options ask a field to be lit by.
struct LightSeries {
  void add(std::string name, std::optional<std::filesystem::path> source, IlluminationFunction light) {
    pictures.push_back({std::move(name), std::move(source)});
    lights.push_back(std::move(light));
  }

  std::vector<SeriesPicture> pictures{};
  std::vector<IlluminationFunction> lights{};  ///< [pictures], or one for all
  bool is_sequence = false;                    ///< frames of a motion, not files of their own
  std::vector<SeenShare> seen{};               ///< of environments that were projected already
};

/// Reads nothing but headers, and maps that a whole sequence shares. Throws InputError for options that do
/// not fit together or to the field.
LightSeries light_series(const RelightOptions& options, const Field& field);

}  // namespace refield::cli
