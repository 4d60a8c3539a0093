// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/errors.h"
#include "core/base/isolated.h"
#include "core/field/drift.h"
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

std::vector<HeldOutError> v0_2::compare(const Field& field, const Session& given, const Field* truth,
                                        const RunContext& run) {
  return guarded(run, [&] {
    CaptureSession session = given.internal();
    const auto rows = field.internal().rows();
    if (std::ranges::none_of(session.frames, [](const auto& f) { return f.role == FrameRole::test; }))
      mark_held_out(session, *rows);
    if (!truth) remove_drift(session, run);
    correct_held_out(rows->provenance, session);
    const auto exact = truth ? truth->internal().rows() : nullptr;
    auto errors = held_out_errors(*rows, session, exact.get(), FrameRole::test, 1.0, run);
    if (const std::string warning = training_warning(errors); !warning.empty()) run.note(warning);
    return errors;
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
