// SPDX-License-Identifier: Apache-2.0
// Error of the fast projection of environment maps against the exact one, at random rotations, as CSV:
//
//   projection_error ROTATIONS FIELD.rfield MAP...
//
// For each map, and for a sun of one texel (1e5 over a sky of 1, 1024×512): the largest relative RMSE of the
// linear picture and of the light map over the rotations, and the mean time of both ways to the picture.
// Pictures are the field's outputs; both ways relight with the same precision.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/rng.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "relight/environment/environment.h"
#include "relight/relighter.h"

namespace {

using refield::Image;
using refield::LightMap;

double seconds_of(const auto& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

LightMap one_texel_sun() {
  LightMap map{Image(1024, 512, 3, 1.0f), refield::Parameterisation::lat_long};
  for (int c = 0; c < 3; ++c) map.radiance.at(341, 200, c) = 1e5f;
  return map;
}

/// A field that does not know its monitor: a screen of 52×32 cm at 60 cm.
std::vector<refield::MonitorPlacement> monitors_of(const refield::ReflectanceField& field) {
  const bool is_captured = field.basis.domain.parameterisation == refield::Parameterisation::monitor;
  if (is_captured && field.monitors.empty()) return {{520, 320, 600}};
  return field.monitors;
}

/// One field under all maps.
class Comparison {
 public:
  explicit Comparison(const refield::ReflectanceField& field)
      : relighter_(field, refield::RelightPrecision::fine),
        projector_(field.basis.domain, monitors_of(field)),
        boxes_(relighter_.box_projector()) {}

  void add(const std::string& name, const LightMap& map, int rotations, refield::Rng& rng) {
    double of_picture = 0.0, of_light = 0.0, fast_time = 0.0, exact_time = 0.0;
    const refield::PreparedEnvironment environment(map);
    for (int i = 0; i < rotations; ++i) {
      const refield::EulerAngles turn{rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)};
      Image fast, exact;
      LightMap exact_light;
      fast_time += seconds_of([&] {
        fast = boxes_ && environment.has_path_sums()
                   ? relighter_.relight(boxes_->project(environment, turn))
                   : relighter_.relight(projector_.project(environment, turn).light);
      });
      exact_time += seconds_of([&] {
        exact_light = projector_.project_exactly(environment, turn).light;
        exact = relighter_.relight(exact_light);
      });
      of_picture = std::max(of_picture, relative_rmse(fast, exact));
      of_light = std::max(of_light, relative_rmse(projector_.project(environment, turn).light.radiance,
                                                  exact_light.radiance));
    }
    std::printf("%s,%d,%.2g,%.2g,%.1f,%.1f\n", name.c_str(), map.radiance.width, of_picture, of_light,
                1e3 * fast_time / rotations, 1e3 * exact_time / rotations);
    std::fflush(stdout);
  }

 private:
  refield::TileRelighter relighter_;
  refield::EnvironmentProjector projector_;
  std::optional<refield::BoxProjector> boxes_;
};

}  // namespace

int main(int count, char** arguments) {
  if (count < 3) {
    std::fprintf(stderr, "usage: projection_error ROTATIONS FIELD.rfield MAP...\n");
    return 2;
  }
  try {
    const int rotations = std::max(1, std::atoi(arguments[1]));
    Comparison comparison(refield::read_reflectance_field(arguments[2]));
    refield::Rng rng(1);
    std::printf("map,width,max_rmse_of_picture,max_rmse_of_light_map,fast_ms,exact_ms\n");
    comparison.add("one-texel sun", one_texel_sun(), rotations, rng);
    for (int i = 3; i < count; ++i)
      comparison.add(std::filesystem::path(arguments[i]).stem(), refield::read_environment(arguments[i]),
                     rotations, rng);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
