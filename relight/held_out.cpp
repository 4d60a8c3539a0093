// SPDX-License-Identifier: Apache-2.0
#include "relight/held_out.h"

#include <algorithm>
#include <utility>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/metrics.h"
#include "core/progress.h"

namespace refield {

namespace {

Photograph reference_for(const CaptureFrame& frame, const LightMap& light, const ReflectanceField* truth) {
  if (truth) return {truth->relight(light), {}};
  Photograph photograph = read_photograph(frame.observed);
  require_finite(photograph.radiance, frame.observed.string(), true,
                 "repair that pixel or leave it out by a mask");
  return photograph;
}

}  // namespace

std::vector<HeldOutError> held_out_errors(const ReflectanceField& field, const CaptureSession& session,
                                          const ReflectanceField* truth, FrameRole role) {
  const auto frames = session.frames_of(role);
  if (frames.empty())
    throw InputError(session.folder.string() + ": has no frame of role '" + std::string(name_of(role)) +
                     "' to compare with");
  if (session.width != field.width || session.height != field.height)
    throw InputError(session.folder.string() + ": the photographs are " + std::to_string(session.width) +
                     "×" + std::to_string(session.height) + ", the field is " + std::to_string(field.width) +
                     "×" + std::to_string(field.height) +
                     "; compare a field with the session it was estimated from");
  const Mask mask = session.mask ? read_mask(*session.mask, session.width, session.height) : Mask{};

  std::vector<std::pair<std::string, SeriesError>> kinds;
  Progress progress("compare held-out frames", frames.size());
  for (const CaptureFrame& frame : frames) {
    throw_if_interrupted();
    auto kind = std::ranges::find(kinds, frame.kind, &std::pair<std::string, SeriesError>::first);
    if (kind == kinds.end()) kind = kinds.emplace(kinds.end(), frame.kind, SeriesError(mask));
    const LightMap light = read_light_map(frame.illumination, session.light.parameterisation);
    const Photograph reference = reference_for(frame, light, truth);
    kind->second.add(field.relight(light), reference.radiance, reference.sigma);
    progress.advance();
  }
  std::vector<HeldOutError> errors;
  for (const auto& [kind, error] : kinds)
    errors.push_back({kind, error.images(), error.relative_rmse(), error.pixel_quantile(0.5),
                      error.pixel_quantile(0.9), error.psnr_db()});
  return errors;
}

}  // namespace refield
