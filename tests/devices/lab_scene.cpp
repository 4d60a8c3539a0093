// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/lab_scene.h"

#include <bit>

#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/session/journal.h"

namespace refield::test {

namespace {

template <class T>
std::uint32_t checksum(const std::vector<T>& values) {
  return crc32_of({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
}

}  // namespace

LabScene::LabScene(const std::filesystem::path& truth, const std::filesystem::path& recipe, const char* log,
                   bool steady)
    : steady_(steady),
      recipe_(read_recipe(recipe)),
      transport_(read_reflectance_field(truth / "transport.rfield")),
      ambient_(read_image(truth / "ambient.exr")),
      log_(std::fopen(log, "w")) {
  if (!log_) throw InputError(std::string(log) + ": cannot be written");
}

LabScene::~LabScene() {
  std::fclose(log_);
}

std::vector<std::uint16_t> LabScene::expose(const DriveImage& first, const DriveImage& second,
                                            TimePoint start, Seconds exposure, double gain) {
  const bool clean = first.levels == second.levels;
  Image light = scene_under(first);
  if (!clean) {
    const Image& other = scene_under(second);
    const auto share = static_cast<float>(random_.uniform());
    for (std::size_t i = 0; i < light.values.size(); ++i)
      light.values[i] += share * (other.values[i] - light.values[i]);
  }
  for (std::size_t i = 0; i < light.values.size(); ++i) light.values[i] += ambient_.values[i];
  const std::uint64_t noise =
      steady_ && clean ? checksum(first.levels) + std::bit_cast<std::uint64_t>(exposure.count() * gain)
                       : random_.next();
  auto samples = recipe_.rig.sensor.expose(light, exposure, gain, noise);
  const auto stamp = std::chrono::floor<std::chrono::microseconds>(start.time_since_epoch());
  if (clean)
    std::fprintf(log_, "%08x %08x %.0f %lld\n", checksum(samples), checksum(first.levels),
                 exposure.count() * 1e6, static_cast<long long>(stamp.count()));
  else
    std::fprintf(log_, "%08x mixed %.0f %lld\n", checksum(samples), exposure.count() * 1e6,
                 static_cast<long long>(stamp.count()));
  std::fflush(log_);
  return samples;
}

const Image& LabScene::scene_under(const DriveImage& drive) {
  const std::uint32_t key = checksum(drive.levels);
  if (scenes_.size() > 8) scenes_.clear();
  auto [place, is_new] = scenes_.try_emplace(key);
  if (is_new) place->second = transport_.relight(recipe_.rig.monitor.emitted(drive));
  return place->second;
}

}  // namespace refield::test
