// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/predicted_error.h"
#include "estimate/fit/fit_block.h"

namespace refield {

/// How the error of a field that is estimated from the lights of `table` depends on the light: δ is a
/// Gaussian process over the light map, given that its effect under the training lights is known up to noise.
/// `cells`: light_cells(), for which the classes are those of PixelKernels::light_class; or empty for the
/// classes of light_noise_ratios on a grid of about 200 rectangles.
LightErrorModel light_error_model(const BoxTable& table, std::vector<Box> cells);

/// Whether photographs under these lights tell the error of a field that is estimated from them. Those of one
/// light source at a time, where the regression passes through all of them, do not tell how noisy they are;
/// fewer lights than min_lights_for_errors() do not tell what a field misses. `texels`: null for light with
/// many degrees of freedom.
bool is_error_known(const BoxTable& table, const TexelRegression* texels);

/// Part of the way from the squared error of leave-one-out to that of cross-validation at which the
/// prediction lies: a half. Kernels are selected from photographs as if each told something new; where they
/// repeat lights, leave-one-out is the more below the truth (0.4 of it for 10 lights shown twice, against
/// 0.6), and cross-validation alone is right.
double share_of_cross_validation(const BoxTable& table);

/// What a thread needs to assess fits by images that they have not seen. Samples and kernels are those of a
/// weighted fit where the table's images have weights; all errors are of samples without them.
class ErrorEvaluator {
 public:
  /// `mean_square`, `texels`: see BlockModel; null for none.
  ErrorEvaluator(const BoxTable& table, const EstimateOptions& options, double mean_square = 0.0,
                 TexelRegressions* texels = nullptr)
      : table_(table),
        options_(options),
        mean_square_(mean_square),
        texels_(texels),
        images_(table.images()),
        stride_(table.stride()),
        repeats_(repeats_in(table.light_groups())) {}

  /// Leave-one-out residuals of a pixel's final kernels: r_j / (1 − h_j), channel by channel, where h_j is
  /// the diagonal of the projection onto the columns with a weight above zero. Exact for least squares with
  /// that set of kernels (Allen 1974); what the hats take is left out of h, since their prior and pooling
  /// leave them little freedom. Images of one light (light_groups.h) are left out together. Writes [3 ×
  /// stride], zero where not measured, and returns their squared sum.
  double leave_one_out(const PixelKernels& kernels, KernelCache& cache, const MaskedSamples& samples,
                       float* residuals);
  /// See TexelRegression; nothing for light with many degrees of freedom.
  std::optional<double> expected_error(const PixelKernels& kernels, const MaskedSamples& samples);

  /// Squared error of each pixel of a block, over images and channels, of k-fold cross-validation: the block
  /// is fitted anew without each fold (groups j, j + k, … of light_groups.h), choice of kernels included, and
  /// predicts it. Of k folds there are at most as many as groups. `block`, `width`: as BlockModel::fit()
  /// takes them; `observed`: the same samples before pooling, which errors are measured against (empty:
  /// `block`).
  std::vector<double> cross_validate(std::span<const PixelSamples> block, int width, int folds = 5,
                                     const RunContext& run = {}, std::span<const PixelSamples> observed = {});
  /// The other way round, for fits to few images: each fold alone is fitted and predicts all others. The mean
  /// over the k − 1 predictions of each image, on the same scale.
  std::vector<double> validate_folds_alone(std::span<const PixelSamples> block, int width, int folds,
                                           const RunContext& run,
                                           std::span<const PixelSamples> observed = {});

  /// Sets the residual of kernels that were fitted to pooled or weighted samples to that of the photographs.
  void set_residual(const PixelSamples& observed, PixelKernels& kernels);

  /// Fits to parts of the images that estimate_band() asks for: five folds, two halves, four quarters. Light
  /// with few degrees of freedom has ten folds, of small tables.
  static constexpr int parts = 5 + 2 + 4;
  /// Each part's cache of columns is emptied beyond this.
  static constexpr std::size_t part_cache_bytes = 8u << 20;

 private:
  /// The same of a CellFit, whose channels share the weights: those of an image are left out together.
  double leave_images_out(const PixelKernels& kernels, const MaskedSamples& samples, float* residuals);
  /// A fit to some of the images.
  struct Part {
    Part(const BoxTable& all, std::vector<int> seen_images, const EstimateOptions& options,
         double mean_square, TexelRegressions* texels);
    std::vector<int> seen;
    BoxTable table;
    BlockModel model;
  };
  Part& part(int fold, int folds, bool alone);
  void add_errors_on_unseen(Part& part, std::span<const PixelSamples> block,
                            std::span<const PixelSamples> observed, int width, std::vector<double>& squared,
                            const RunContext& run);
  /// Samples of all images into predicted_, [3 × stride].
  void predict(const PixelKernels& kernels);

  const BoxTable& table_;
  EstimateOptions options_;
  double mean_square_;
  TexelRegressions* texels_;
  std::map<std::array<int, 3>, std::unique_ptr<Part>> parts_;  // by fold, number of folds, alone or not
  int images_;
  std::size_t stride_;
  std::vector<std::vector<int>> repeats_;
  AlignedFloats orthonormal_, vector_, predicted_, column_;
  std::vector<const float*> pointers_;
  std::vector<float> coefficients_;
};

}  // namespace refield
