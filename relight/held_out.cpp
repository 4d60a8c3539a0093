// SPDX-License-Identifier: Apache-2.0
#include "relight/held_out.h"

#include <algorithm>
#include <cmath>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/metrics.h"
#include "core/progress.h"

namespace refield {

namespace {

Photograph reference_for(const CaptureFrame& frame, const LightMap& light, const ReflectanceField* truth) {
  if (truth) return {truth->relight(light), {}};
  Photograph photograph = read_observed(frame);
  require_finite(photograph.radiance, frame.observed.string(), true,
                 "repair that pixel or leave it out by a mask");
  return photograph;
}

/// Sums for one kind of light.
struct KindSums {
  std::string kind;
  SeriesError error;
  bool has_sigma = true;       // every photograph carries its noise
  std::vector<double> noise;   // [pixels], Σσ² over measured samples
  std::vector<double> signal;  // [pixels], Σ observed²

  void add_noise(const Photograph& reference) {
    has_sigma = has_sigma && !reference.sigma.empty();
    noise.resize(reference.radiance.pixel_count());
    signal.resize(noise.size());
    for (std::size_t i = 0; i < reference.radiance.values.size(); ++i) {
      const double sigma = reference.sigma.empty() ? 0.0 : reference.sigma.values[i];
      if (std::isinf(sigma)) continue;
      noise[i / 3] += sigma * sigma;
      signal[i / 3] += static_cast<double>(reference.radiance.values[i]) * reference.radiance.values[i];
    }
  }
};

PredictionCheck check_prediction(const ReflectanceField& field, const KindSums& sums, const Mask& mask,
                                 double noise_scale) {
  const Image actual = sums.error.relative_rmse_map();
  std::vector<float> predicted, true_error, ratios;
  for (std::size_t p = 0; p < actual.pixel_count(); ++p) {
    if ((!mask.empty() && mask[p] == 0) || !(sums.signal[p] > 0.0) || !(actual.values[p] > 0.0f)) continue;
    const double trained_noise = std::pow(field.photograph_noise[p], 2);
    const double noise =
        sums.has_sigma ? sums.noise[p] / sums.signal[p] : noise_scale * noise_scale * trained_noise;
    const double own = std::max(std::pow(field.predicted_error[p], 2) - trained_noise, 0.0);
    predicted.push_back(static_cast<float>(std::sqrt(own + noise)));
    true_error.push_back(actual.values[p]);
    ratios.push_back(predicted.back() / true_error.back());
  }
  return {rank_correlation(predicted, true_error), quantile(ratios, 0.5), quantile(predicted, 0.5)};
}

}  // namespace

std::vector<HeldOutError> held_out_errors(const ReflectanceField& field, const CaptureSession& session,
                                          const ReflectanceField* truth, FrameRole role, double noise_scale) {
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

  const bool predicts = !field.predicted_error.empty();
  if (truth) noise_scale = 0.0;
  std::vector<KindSums> kinds;
  Progress progress("compare held-out frames", frames.size());
  for (const CaptureFrame& frame : frames) {
    throw_if_interrupted();
    auto kind = std::ranges::find(kinds, frame.kind, &KindSums::kind);
    if (kind == kinds.end())
      kind = kinds.insert(kinds.end(), KindSums{frame.kind, SeriesError(mask), true, {}, {}});
    const LightMap light = read_light_map(frame.illumination, session.light.parameterisation);
    const Photograph reference = reference_for(frame, light, truth);
    kind->error.add(field.relight(light), reference.radiance, reference.sigma);
    if (predicts) kind->add_noise(reference);
    progress.advance();
  }
  std::vector<HeldOutError> errors;
  for (const KindSums& sums : kinds) {
    const SeriesError& error = sums.error;
    errors.push_back({sums.kind, error.images(), error.relative_rmse(), error.pixel_quantile(0.5),
                      error.pixel_quantile(0.9), error.psnr_db(), std::nullopt});
    if (predicts) errors.back().prediction = check_prediction(field, sums, mask, noise_scale);
  }
  return errors;
}

}  // namespace refield
