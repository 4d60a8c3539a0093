// SPDX-License-Identifier: Apache-2.0
#include "refield/hdr.h"

#include <limits>
#include <vector>

#include "acquire/import/bracket_response.h"
#include "core/base/errors.h"
#include "library/data.h"

namespace refield {

Photograph v0_2::merge_exposures(std::span<const std::filesystem::path> files,
                                 std::span<const double> seconds, const ExposureCamera& camera,
                                 const RunContext& run) {
  BracketCamera known;
  known.response = camera.response;
  known.full_scale_electrons = camera.full_scale_electrons;
  known.read_noise_electrons = camera.read_noise_electrons;
  const std::vector<Seconds> exposures(seconds.begin(), seconds.end());
  return guarded(run, [&] {
    Bracket bracket = read_bracket({files.begin(), files.end()}, known, exposures);
    const std::vector<BracketSamples> samples = {samples_of(bracket)};
    for (const std::string& note : settle_response(samples, known)) run.note(note);
    return merge_bracket(bracket, known);
  });
}

Photograph v0_2::merge_exposures(std::span<const ImageView> images, std::span<const double> seconds,
                                 const ExposureCamera& camera, const RunContext& run) {
  if (images.empty() || images.size() != seconds.size())
    throw InputError(std::to_string(images.size()) + " images and " + std::to_string(seconds.size()) +
                     " exposure times do not belong together; give one exposure time per image");
  for (const double exposure : seconds)
    if (!(exposure > 0.0)) throw InputError("exposures: " + std::to_string(exposure) + " is not above 0");
  const std::vector<Image> copies(images.begin(), images.end());
  const std::vector<Seconds> exposures(seconds.begin(), seconds.end());
  LinearSensor sensor;
  sensor.saturation = 1.0;
  sensor.electrons_per_value = camera.full_scale_electrons;
  sensor.read_noise_electrons = camera.read_noise_electrons;
  return guarded(
      run, [&] { return merge_linear_exposures(copies, exposures, sensor, with_unmeasured_saturation); });
}

}  // namespace refield
