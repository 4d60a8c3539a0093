// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/errors.h"
#include "core/base/isolated.h"
#include "core/field/drift.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/rig/rig_model.h"
#include "library/data.h"
#include "refield/compare.h"
#include "refield/estimate.h"
#include "relight/held_out.h"

namespace refield {

IsolatedReader v0_2::isolated_reader(const std::filesystem::path& program, const std::atomic<bool>* stop) {
  return [program, run = RunContext{.stop = stop}](const IsolatedReading& reading) {
    return read_in_process(program, reading, run);
  };
}

std::shared_ptr<const RigModel> v0_2::rig_model(const std::string& text, const std::string& name) {
  return std::make_shared<const RigModel>(rig_from_text(text, name));
}

Field v0_2::estimate(const Session& session, const EstimateOptions& options, const RunContext& run) {
  options.check();
  return guarded(run, [&] { return public_field(estimate_field(session.internal(), options, run)); });
}

Field v0_2::estimate(const CaptureArrays& capture, const EstimateOptions& options, const RunContext& run) {
  options.check();
  if (!capture.lights.empty()) check_placements(capture.monitors, capture.lights[0].domain(), "monitor");
  return guarded(run, [&] {
    ReflectanceField field =
        estimate(capture.lights, capture.photographs, capture.sigma, capture.mask, options, run);
    field.monitors = capture.monitors;
    return public_field(std::move(field));
  });
}

// ---- comparison

namespace {

std::shared_ptr<const ReflectanceField> image_rows(const Field& field) {
  if (field.has_mesh())
    throw InputError(field.internal().name +
                     ": is a mesh field, but an image field is required; use 'refield relight' or 'refield "
                     "view' for mesh fields");
  return field.internal().rows();
}

/// Integer formats carry no noise; floats may.
Photograph read_image_of_series(const std::filesystem::path& file) {
  return file.extension() == ".exr" ? read_photograph(file) : Photograph{read_image(file), {}};
}

/// Blackens pixels that do not count, and checks the others.
void require_comparable(Image& image, const std::filesystem::path& file, const Mask& mask) {
  for (std::size_t p = 0; p < mask.size() && p < image.pixel_count(); ++p)
    if (!mask[p]) std::fill_n(image.values.begin() + 3 * p, 3, 0.0f);
  require_finite(image, file.string(), true, "repair that pixel or exclude it with --mask");
}

}  // namespace

std::vector<HeldOutError> v0_2::compare(const Field& field, const Session& given, const Field* truth,
                                        double noise_scale, const RunContext& run) {
  return guarded(run, [&] {
    CaptureSession session = given.internal();
    const auto rows = image_rows(field), exact = truth ? image_rows(*truth) : nullptr;
    mark_held_out(session, rows->provenance);
    if (!truth) remove_drift(session, run);
    correct_held_out(rows->provenance, session);
    auto errors = held_out_errors(*rows, session, exact.get(), FrameRole::test, noise_scale, run);
    if (const std::string warning = training_warning(errors); !warning.empty()) run.note(warning);
    return errors;
  });
}

HeldOutError v0_2::compare(const std::string& predicted, const std::string& observed,
                           const std::filesystem::path& mask_file, const RunContext& run) {
  return guarded(run, [&] {
    const auto pairs = pair_files(predicted, observed, "prediction", "observed image");
    const ImageHeader first = read_image_header(pairs.front().second);
    const Mask mask = mask_file.empty() ? Mask{} : read_mask(mask_file, first.width, first.height);
    SeriesError series(mask);
    std::vector<HeldOutImage> per_image;
    Progress progress(run, "compare", pairs.size());
    for (const auto& [predicted_file, observed_file] : pairs) {
      run.throw_if_stopped();
      Image image = read_image_of_series(predicted_file).radiance;
      Photograph reference = read_image_of_series(observed_file);
      if (!image.same_shape(reference.radiance))
        throw InputError(predicted_file.string() + ": is " + shape_text(image) + ", " +
                         observed_file.string() + " is " + shape_text(reference.radiance) +
                         "; the images must have the same size");
      require_comparable(image, predicted_file, mask);
      require_comparable(reference.radiance, observed_file, mask);
      series.add(image, reference.radiance, reference.sigma);
      per_image.push_back({predicted_file.filename().string(), observed_file,
                           image_error(image, reference.radiance, mask, reference.sigma)});
      progress.advance();
    }
    return error_of(series, std::move(per_image));
  });
}

HeldOutError v0_2::compare(std::span<const ImageView> predicted, std::span<const ImageView> observed,
                           std::span<const ImageView> sigma, const Mask& mask) {
  if (predicted.empty() || predicted.size() != observed.size() ||
      (!sigma.empty() && sigma.size() != predicted.size()))
    throw InputError(std::to_string(predicted.size()) + " predicted and " + std::to_string(observed.size()) +
                     " observed images do not belong together; give as many of both");
  SeriesError series(mask);
  std::vector<HeldOutImage> per_image;
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    const Image a(predicted[i]), b(observed[i]), s = sigma.empty() ? Image() : Image(sigma[i]);
    series.add(a, b, s);
    for (std::size_t k = 0; k < b.values.size(); ++k)
      if ((!std::isfinite(a.values[k]) || !std::isfinite(b.values[k])) &&
          (s.empty() || !std::isinf(s.values[k])) && (mask.empty() || mask[k / 3] != 0))
        throw InputError(std::string(std::isfinite(b.values[k]) ? "predicted" : "observed") + "[" +
                         std::to_string(i) +
                         "]: has a sample that is not finite; exclude it by the mask, or mark " +
                         "it as unmeasured (sigma = inf)");
    per_image.push_back({std::to_string(i), {}, image_error(a, b, mask, s)});
  }
  return error_of(series, std::move(per_image));
}

}  // namespace refield
