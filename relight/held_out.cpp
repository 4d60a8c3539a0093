// SPDX-License-Identifier: Apache-2.0
#include "relight/held_out.h"

#include <cmath>
#include <set>

#include "core/base/json.h"
#include "core/field/light_error.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/light/light_map.h"

namespace refield {

namespace {

Photograph reference_for(const CaptureFrame& frame, const LightMap& light, const ReflectanceField* truth) {
  if (truth) return {truth->relight(light), {}};
  Photograph photograph = read_observed(frame);
  require_finite(photograph.radiance, frame.observed.string(), true,
                 "repair that pixel or leave it out by a mask");
  return photograph;
}

std::vector<ImageError> errors_of(const std::vector<HeldOutImage>& images) {
  std::vector<ImageError> errors;
  for (const HeldOutImage& image : images) errors.push_back(image.error);
  return errors;
}

/// The names that a field's provenance lists under `key`.
std::set<std::string> names_in(const Json& provenance, const char* key) {
  std::set<std::string> names;
  if (provenance.is_object() && provenance.contains(key) && provenance[key].is_array())
    for (const auto& name : provenance[key])
      if (name.is_string()) names.insert(name.get<std::string>());
  return names;
}

/// Sums for one kind of light.
struct KindSums {
  SeriesError error;
  std::vector<HeldOutImage> per_image = {};
  bool has_sigma = true;            // every photograph carries its noise
  std::vector<double> noise = {};   // [pixels], Σσ² over measured samples
  std::vector<double> signal = {};  // [pixels], Σ observed²
  std::vector<double> own = {};     // [pixels], Σ own_squared_error_under(), empty where that is not known

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
    const double trained_noise = std::pow(field.quality.photograph_noise[p], 2);
    const double noise =
        sums.has_sigma ? sums.noise[p] / sums.signal[p] : noise_scale * noise_scale * trained_noise;
    const double own = sums.own.empty()
                           ? std::max(std::pow(field.quality.predicted_error[p], 2) - trained_noise, 0.0)
                           : sums.own[p] / sums.signal[p];
    predicted.push_back(static_cast<float>(std::sqrt(own + noise)));
    true_error.push_back(actual.values[p]);
    ratios.push_back(predicted.back() / true_error.back());
  }
  return {rank_correlation(predicted, true_error), quantile(ratios, 0.5), quantile(predicted, 0.5)};
}

}  // namespace

ErrorSpread spread_of(const std::vector<HeldOutImage>& images) {
  return spread_of(std::span<const ImageError>(errors_of(images)));
}

HeldOutError error_of(const SeriesError& series, std::vector<HeldOutImage> per_image, const std::string& kind,
                      std::optional<std::size_t> trained_on) {
  const double psnr_db = tone_mapped_psnr_db(std::span<const ImageError>(errors_of(per_image)));
  return {kind,
          series.images(),
          trained_on,
          series.relative_rmse(),
          series.pixel_quantile(0.5),
          series.pixel_quantile(0.9),
          psnr_db,
          std::nullopt,
          std::move(per_image),
          series.relative_rmse_map()};
}

std::string text_of(const CaptureSession& session) {
  if (!session.folder.empty() || session.frames.empty()) return session.folder.string();
  const auto folder = session.frames.front().observed.parent_path();
  return folder.empty() ? "the photographs" : folder.string();
}

void hold_out_every(CaptureSession& session, int every) {
  if (every < 2)
    throw InputError("--hold-out ", every, ": give 2 or more, for example 10 to hold out every tenth image");
  int place = 0, held_out = 0;
  for (CaptureFrame& frame : session.frames)
    if (frame.role == FrameRole::train && ++place % every == 0) {
      frame.role = FrameRole::test;
      ++held_out;
    }
  if (held_out == 0)
    throw InputError("--hold-out ", every, ": there are ", place,
                     " images to train from, so none would be held out; give a smaller number");
}

void mark_held_out(CaptureSession& session, const std::string& field_provenance) {
  const auto provenance = json_if_valid(field_provenance);
  if (!session.folder.empty()) {
    const std::set<std::string> held_out = names_in(provenance, "held_out");
    for (CaptureFrame& frame : session.frames)
      if (frame.role == FrameRole::train && held_out.contains(frame.name)) frame.role = FrameRole::test;
    return;
  }
  if (!session.frames_of(FrameRole::test).empty()) return;  // the caller chose
  std::set<std::string> known = names_in(provenance, "frames");
  known.merge(names_in(provenance, "left_out"));
  const auto is_known = [&](const CaptureFrame& frame) { return known.contains(frame.name); };
  const auto overlap = static_cast<std::size_t>(std::ranges::count_if(session.frames, is_known));
  const bool of_this_estimate = !known.empty() && overlap == known.size() && overlap < session.frames.size();
  for (CaptureFrame& frame : session.frames)
    frame.role = of_this_estimate && is_known(frame) ? FrameRole::train : FrameRole::test;
}

std::string training_warning(const std::vector<HeldOutError>& errors) {
  std::size_t images = 0, trained = 0;
  bool is_known = true;
  for (const HeldOutError& error : errors) {
    images += error.images;
    is_known = is_known && error.trained_on;
    trained += error.trained_on.value_or(0);
  }
  if (!is_known)
    return "warning: the field does not name the photographs that it was estimated from. If these are among "
           "them, the errors are training errors";
  if (trained == 0) return "";
  return "warning: " + std::to_string(trained) + " of the " + std::to_string(images) +
         " photographs have the names or light maps of images that the field was estimated from. If they are "
         "these images, the errors are training errors; estimate with --hold-out 10 to measure errors on new "
         "images";
}

std::vector<HeldOutError> held_out_errors(const ReflectanceField& field, const CaptureSession& session,
                                          const ReflectanceField* truth, FrameRole role, double noise_scale,
                                          const RunContext& run) {
  const ThreadLimit limit(run);
  const auto frames = session.frames_of(role);
  if (frames.empty())
    throw InputError(text_of(session), ": has no frame of role '", name_of(role), "' to compare with");
  if (session.width != field.width || session.height != field.height)
    throw InputError(text_of(session), ": the photographs are ", session.width, "×", session.height,
                     ", the field is ", field.width, "×", field.height,
                     "; compare a field with the session it was estimated from");
  if (!truth && session.colour_space() != field.colour_space)
    throw InputError(text_of(session), ": the photographs are in ", name_of(session.colour_space()),
                     ", the field is in ", name_of(field.colour_space),
                     "; estimate the field again from this session");
  const Mask mask = session.mask ? read_mask(*session.mask, session.width, session.height) : Mask{};

  const bool predicts = !field.quality.predicted_error.empty();
  const auto provenance = json_if_valid(field.provenance);
  const std::set<std::string> trained = names_in(provenance, "frames"),
                              lights = names_in(provenance, "lights");
  const auto is_trained = [&](const CaptureFrame& frame) {
    if (trained.contains(frame.name)) return true;
    if (lights.empty()) return false;
    const std::string pattern = pattern_of(frame, session.light.parameterisation, run);
    return std::ranges::any_of(lights, [&](const auto& light) { return is_same_pattern(light, pattern); });
  };
  const bool is_exact = provenance.is_object() && provenance.contains("program");  // simulated, not estimated
  if (truth) noise_scale = 0.0;
  std::vector<std::string> kinds;
  for (const CaptureFrame& frame : frames)
    if (std::ranges::find(kinds, frame.kind) == kinds.end()) kinds.push_back(frame.kind);
  std::vector<HeldOutError> errors;
  Progress progress(run, "comparing held-out frames", frames.size());
  for (const std::string& kind : kinds) {  // one after the other: sums take 40 bytes per pixel
    KindSums sums{SeriesError(mask)};
    std::size_t trained_on = 0;
    for (const CaptureFrame& frame : frames) {
      if (frame.kind != kind) continue;
      run.throw_if_stopped();
      const LightMap light = read_illumination(frame, session.light.parameterisation, run);
      const Photograph reference = reference_for(frame, light, truth);
      const Image predicted = field.relight(light);
      sums.error.add(predicted, reference.radiance, reference.sigma);
      sums.per_image.push_back(
          {frame.name, frame.observed, image_error(predicted, reference.radiance, mask, reference.sigma)});
      if (predicts) {
        sums.add_noise(reference);
        const std::vector<double> own = own_squared_error_under(field, light.radiance);
        sums.own.resize(own.size());
        std::ranges::transform(sums.own, own, sums.own.begin(), std::plus<>());
      }
      trained_on += is_trained(frame);
      progress.advance();
    }
    const bool is_known = !trained.empty() || !lights.empty() || is_exact;
    errors.push_back(
        error_of(sums.error, sums.per_image, kind, is_known ? std::optional(trained_on) : std::nullopt));
    if (predicts) errors.back().prediction = check_prediction(field, sums, mask, noise_scale);
  }
  return errors;
}

}  // namespace refield
