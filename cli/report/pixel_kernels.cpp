// SPDX-License-Identifier: Apache-2.0
#include "cli/report/pixel_kernels.h"

#include <algorithm>

#include "core/errors.h"
#include "core/run_context.h"
#include "estimate/estimate.h"

namespace refield::report {

namespace {

constexpr int subdivisions_of_the_paper[] = {1, 2, 3, 4, 5, 10, 20, 24};

}  // namespace

Image kernel_density(const LightDomain& domain, std::span<const Box> boxes,
                     std::span<const std::array<float, 3>> weights) {
  if (boxes.size() != weights.size())
    throw InputError(std::to_string(boxes.size()) + " boxes do not go with " +
                     std::to_string(weights.size()) + " weights");
  Image density(domain.width, domain.height, 1);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const float weight = (weights[k][0] + weights[k][1] + weights[k][2]) / 3.0f;
    if (weight == 0.0f) continue;
    for (int y = boxes[k].y0; y < boxes[k].y1; ++y)
      for (float& value : density.row(y).subspan(boxes[k].x0, boxes[k].width())) value += weight;
  }
  return density;
}

KernelStudy study_kernels(const ReportInput& input, const std::vector<ChosenPixel>& pixels,
                          const RunContext& run) {
  KernelStudy study;
  const auto images = static_cast<int>(input.session.frames_of(FrameRole::train).size());
  for (const int count : subdivisions_of_the_paper)
    if (count < images) study.subdivisions.push_back(count);
  if (study.subdivisions.empty() || pixels.empty()) return study;
  EstimateOptions options = input.fields.front().options;
  // As many kernels as the last panel needs, whatever cap the field was made with.
  study.kernels = options.kernels = study.subdivisions.back() + 1;
  Progress progress(run, "computing kernels of selected pixels", pixels.size());
  for (const ChosenPixel& pixel : pixels) {
    run.throw_if_stopped();
    PixelKernels kernels{pixel, {}, {}, {}};
    const auto history = kernel_history(input.session, options, pixel.x, pixel.y, study.subdivisions, run);
    for (const int count : study.subdivisions) {
      const auto snapshot = std::ranges::find(history, count, &KernelSnapshot::subdivisions);
      kernels.after.push_back(snapshot == history.end()
                                  ? std::optional<Image>()
                                  : kernel_density(input.session.light, snapshot->boxes, snapshot->weights));
    }
    const std::size_t index = static_cast<std::size_t>(pixel.y) * input.session.width + pixel.x;
    kernels.in_field = kernel_density(input.fields.front().field, index);
    if (input.transport) kernels.exact = kernel_density(*input.transport, index);
    study.pixels.push_back(std::move(kernels));
    progress.advance();
  }
  return study;
}

}  // namespace refield::report
