// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/field/mesh.h"
#include "core/field/reflectance_field.h"
#include "core/light/monitor_placement.h"
#include "relight/environment/environment.h"
#include "relight/environment/sky.h"
#include "relight/relight.h"
#include "relight/sequence.h"

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

/// The cameras of FieldPictures. Throws InputError for a camera that cannot be, and for camera options with a
/// field that has no mesh.
std::vector<PinholeCamera> cameras_of(const CameraOptions& options, const ReflectanceField& field,
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
  VideoOptions video;  ///< its exposure goes for PNG files too

  /// Whether the light fades from each environment to the next.
  bool fades() const {
    return frames > 0 && !rotate && (environments.size() > 1 || (!environments.empty() && !camera.turntable));
  }
};

/// How much of each environment the monitor's windows saw, so that no one takes a part for the whole.
class SeenShares {
 public:
  /// From any thread.
  void add(const std::string& light, const EnvironmentShare& share);

  /// One line a light; of many, one line for all.
  void print() const;
  nlohmann::ordered_json json() const;

 private:
  struct Entry {
    std::string light;
    EnvironmentShare share;
  };
  std::mutex mutex_;
  std::vector<Entry> entries_;  // by name, as threads do not come in order
};

/// One of the lights to show a field under.
struct SeriesLight {
  std::string name;                             ///< its image's, without extension
  std::optional<std::filesystem::path> source;  ///< the file that it comes from, where it is one file's
  LightFunction make;                           ///< reads or computes it; from several threads at a time
};

/// What the options ask a field to be lit by.
struct LightSeries {
  std::vector<SeriesLight> lights{};
  bool is_sequence = false;  ///< frames of a motion, not files of their own
  /// Filled in as environments are put onto the monitor's window; null where there is none.
  std::shared_ptr<SeenShares> seen{};
};

/// Reads nothing but headers, and maps that a whole sequence shares. Throws InputError for options that do
/// not fit together or to the field.
LightSeries light_series(const RelightOptions& options, const ReflectanceField& field);

}  // namespace refield::cli
