// SPDX-License-Identifier: Apache-2.0
#include "refield/hdr.h"

#include "acquire/import/bracket_merge.h"
#include "library/data.h"

namespace refield {

namespace {

Photograph merged(Bracket bracket, BracketCamera camera, const RunContext& run) {
  const std::vector<BracketSamples> samples = {samples_of(bracket)};
  for (const std::string& note : settle_response(samples, camera)) run.note(note);
  return merge_bracket(bracket, camera);
}

}  // namespace

Photograph v0_2::merge_exposures(std::span<const fs::path> files, std::span<const double> seconds,
                                 const ExposureCamera& camera, const RunContext& run) {
  BracketCamera known;
  known.response = camera.response;
  known.full_scale_electrons = camera.full_scale_electrons;
  known.read_noise_electrons = camera.read_noise_electrons;
  const std::vector<Seconds> exposures(seconds.begin(), seconds.end());
  return guarded(run, [&] {
    return merged(read_bracket({files.begin(), files.end()}, known, exposures), known, run);
  });
}

Photograph v0_2::merge_exposures(std::span<const ImageView> images, std::span<const double> seconds,
                                 const ExposureCamera& camera, const RunContext& run) {
  if (images.empty() || images.size() != seconds.size())
    throw InputError(images.size(), " images and ", seconds.size(),
                     " exposure times do not belong together; give one exposure time per image");
  for (const double exposure : seconds)
    if (!(exposure > 0.0)) throw InputError("exposures: ", exposure, " is not above 0");
  Bracket bracket;
  for (std::size_t i = 0; i < images.size(); ++i) {
    bracket.paths.emplace_back("images[" + std::to_string(i) + "]");
    bracket.files.emplace_back().linear = Image(images[i]);
    bracket.exposures.emplace_back(seconds[i]);
    if (!bracket.files[i].linear.same_shape(bracket.files[0].linear))
      throw InputError(bracket.paths[i], ": is ", shape_text(bracket.files[i].linear), ", the first is ",
                       shape_text(bracket.files[0].linear), "; merge exposures of one camera");
  }
  BracketCamera known;
  known.saturation = 1.0;
  known.full_scale_electrons = camera.full_scale_electrons;
  known.read_noise_electrons = camera.read_noise_electrons;
  return guarded(run, [&] { return merged(std::move(bracket), known, run); });
}

}  // namespace refield
