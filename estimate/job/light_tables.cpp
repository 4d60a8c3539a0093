// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/light_tables.h"

#include "core/base/linear_algebra.h"
#include "estimate/quality/error_evidence.h"

namespace refield {

namespace {

/// Lights that are sums of one another tell less than their number promises.
void note_few_lights(const BoxTable& table, std::size_t cells, const RunContext& run) {
  const int lights = count_of(table.light_groups());
  if (lights < min_lights_for_errors)
    return run.note("only ", lights, " of the ", table.images(),
                    " light maps differ by more than brightness: the field is determined poorly, and its "
                    "error on new photographs cannot be predicted; photograph ",
                    min_lights_for_errors, " lights or more that differ, about 100 for most scenes");
  const int rank = table.light_rank();
  const int determined = static_cast<int>(std::min<std::size_t>(lights, cells > 0 ? cells : lights));
  if (rank < determined)
    run.note(
        "the ", lights, " light maps that differ are sums of ", rank,
        ": they tell no more of the scene than ", rank,
        " photographs, and the predicted error holds for such sums only; add lights that are independent");
}

}  // namespace

LightTables::LightTables(const EstimateJob& job, const EstimateOptions& options, const RunContext& run)
    : table_(job.frames, job.session.light,
             hats_of(options, job.session.light, static_cast<int>(job.frames.size())), run) {
  if (options.mode == EstimateMode::refined) {
    texels_.emplace(table_);
    note_few_lights(table_, texels_->cells().size(), run);
    // The regression gives each cell a weight.
    if (options.kernels > 0 && texels_->cells().size() > static_cast<std::size_t>(options.kernels))
      texels_.reset();
  } else {
    note_few_lights(table_, 0, run);
  }
  // Photographs of one light source at a time leave nothing unknown of the light that they were taken under;
  // for light in between see ReflectanceField::fit_interpolation().
  if (options.predict_errors && is_error_known(table_, texels_ ? texels_->of_all().get() : nullptr))
    light_error_ = light_error_model(table_, texels_ ? texels_->cells() : std::vector<Box>{});
  weighs_images_ = texels_ && texels_->cells().empty() && !job.noise.image_weights.empty();
  if (weighs_images_) table_.weight_images(job.noise.image_weights);
}

}  // namespace refield
