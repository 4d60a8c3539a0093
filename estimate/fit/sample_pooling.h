// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/refit.h"

namespace refield {

/// Pooling looks at square windows of this side, in pixels; their corners are at most `window_step_px` apart.
inline constexpr int window_side_px = 5;
inline constexpr int window_step_px = 2;
/// How far a pixel's pooled samples depend on others.
inline constexpr int pooling_reach_px = window_side_px - 1;

/// The share that is kept of a component of a noisy matrix whose squared singular value is `energy` per row,
/// noise having variance 1: the optimal rule of Gavish and Donoho 2017 ("Optimal shrinkage of singular
/// values", Frobenius loss). `ratio`: columns by rows of the matrix.
double kept_share(double energy, double ratio);

/// All samples of adjacent pixels.
struct SampleWindow {
  int pixels = 0;
  std::vector<float> values;  ///< [pixels][3][images]
};

/// How noisy photographs are, each multiplied by its weight: the variance of a sample's noise relative to the
/// pixel's mean square, which falls with brightness.
struct NoiseModel {
  std::vector<double> log_level;     ///< logarithms of mean squares, ascending; empty: unknown
  std::vector<double> log_variance;  ///< of the relative variance at these levels
  /// Independent noise samples that an image holds of a pixel: 3 if the channels' noise is independent, 1 if
  /// it is the same in all (Monte Carlo renderers).
  double samples_per_image = 3.0;
  /// For each image not left out, the reciprocal of its noise, scaled so that the samples keep their mean
  /// square. Empty: all 1, because images are equally noisy, hardly noisy, or it is not known.
  std::vector<float> image_weights = {};

  double relative_variance(double mean_square) const;
};

/// Measures noise by the weakest components of windows that are spread over the picture: their pixels see
/// nearly the same, so most components of the matrix of images × pixels hold noise alone, and the lower
/// quartile of the eigenvalues follows the law of Marchenko and Pastur 1967. The median window of similar
/// brightness counts. Images `left_out` are ignored. Unknown if there are too few images or windows. The
/// noise of an image is its part of the weakest components, in the median window.
NoiseModel measure_noise(std::span<const SampleWindow> windows, int images, std::span<const int> left_out);

/// Reduces the noise of samples by what pixels have in common with their neighbours. The matrix of images ×
/// pixels of a window, scaled to unit noise, has low rank except for noise; its singular values are shrunk
/// (kept_share()). A pixel takes the mean of the windows that contain it. Windows of pixels that have little
/// in common (mirrors, edges) and pixels with little noise keep their samples.
class SamplePool {
 public:
  SamplePool(NoiseModel noise, int images);

  /// Samples of a picture of width × height pixels; null pointers for pixels outside the mask.
  using Observed = std::function<PixelSamples(int x, int y)>;
  /// Pooled samples of a tile's pixels, row by row; those of pixels that are not changed are the observed
  /// ones. Needs the pixels up to `pooling_reach_px` from the tile. Does not depend on how the picture is
  /// divided into tiles. The result is valid until the next call.
  std::vector<PixelSamples> pool(const PixelTile& tile, int width, int height, const Observed& observed);

 private:
  struct Pixel {
    PixelSamples observed{};
    double noise = 0.0;            // relative standard deviation; 0: not pooled
    std::array<float, 3> scale{};  // to unit noise
  };
  /// Weights of the pixels around one, and the number of windows that they are summed over.
  struct Filter {
    std::vector<float> weights;  // [offsets]
    int windows = 0;
    bool changes = false;
  };
  void load(const PixelTile& region, const Observed& observed);
  void correlate();
  void add_window(int x, int y, const PixelTile& tile);
  double product(int p, int q) const;

  const NoiseModel noise_;
  const int images_;
  const std::size_t stride_;
  std::vector<double> bulk_;  // lower quartile of the eigenvalues of noise, by pixels of a window
  PixelTile region_{};
  int region_width_ = 0;
  std::vector<Pixel> pixels_;     // of the region
  AlignedFloats scaled_;          // [region][3 × stride]
  std::vector<float> products_;   // [region][offsets forward]
  std::vector<Filter> filters_;   // of the tile
  AlignedFloats pooled_, zeros_;  // [tile][3 × stride]
  std::vector<const float*> pointers_;
};

}  // namespace refield
