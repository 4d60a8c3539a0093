// SPDX-License-Identifier: Apache-2.0
#include "estimate/field_assembler.h"

#include <cmath>

#include "estimate/estimate_band.h"

namespace refield {

FieldAssembler::FieldAssembler(const EstimateJob& job, const EstimateOptions& options)
    : with_evidence_(options.predict_errors), is_whole_(!options.rows) {
  field_.width = job.session.width;
  field_.height = job.rows.count();
  field_.basis.domain = job.session.light;
  field_.monitors = job.session.monitors;
  field_.basis.hats = hats_of(options, job.session.light, static_cast<int>(job.frames.size()));
  field_.provenance = provenance_of(job, options);
}

void FieldAssembler::append(std::span<const PixelKernels> kernels) {
  std::vector<std::uint32_t> columns;
  std::vector<float> weights;
  for (const PixelKernels& pixel : kernels) {
    columns.clear();
    weights.clear();
    for (std::size_t h = 0; 3 * h < pixel.smooth.size(); ++h) {
      const float* w = pixel.smooth.data() + 3 * h;
      if (w[0] <= 0.0f && w[1] <= 0.0f && w[2] <= 0.0f) continue;
      columns.push_back(static_cast<std::uint32_t>(h));
      weights.insert(weights.end(), w, w + 3);
    }
    weights.insert(weights.end(), pixel.weights.begin(), pixel.weights.end());
    for (const Box& box : pixel.boxes) {
      const auto [entry, is_new] = numbers_.try_emplace(box, static_cast<std::uint32_t>(field_.basis.size()));
      if (is_new) field_.basis.boxes.push_back(box);
      columns.push_back(entry->second);
    }
    field_.transfer.append_row(columns, weights);
    field_.training_error.push_back(
        pixel.squared_samples > 0.0
            ? static_cast<float>(std::sqrt(pixel.squared_residual / pixel.squared_samples))
            : 0.0f);
    if (with_evidence_) field_.error_evidence.push_back(pixel.evidence);
  }
}

ReflectanceField FieldAssembler::take() {
  if (is_whole_) {
    predict_errors(field_);
    field_.error_evidence = {};
  }
  return std::move(field_);
}

}  // namespace refield
