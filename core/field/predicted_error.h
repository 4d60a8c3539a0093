// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <array>
#include <limits>

#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// Error of a field made from a share of its training images: relative RMSE of the median pixel.
struct LearningPoint {
  float share = 0.0f;
  float error = 0.0f;
};

/// Error against the number of images, e² = noise² + scale / shareᶜ: what more images of the same kind would
/// do. The photographs' noise is known (`noise`, of the median pixel); it is the floor that no number of
/// images gets below, and without it three points do not say where the curve will flatten.
class LearningCurve {
 public:
  /// Least squares of log(e² − noise²). Needs two points of different share; known() says whether there were.
  LearningCurve(std::span<const LearningPoint> points, double noise);

  bool known() const { return known_; }
  /// At `share` times the training images; 1 is the field itself.
  double error_at(double share) const;
  /// One sentence: whether twice the images would help.
  std::string advice() const;

 private:
  bool known_ = false;
  double floor_ = 0.0, scale_ = 0.0, exponent_ = 0.0;
};

/// How the error of a field depends on the light: the variance of e · δ under light e, where δ is what the
/// training lights leave unknown of a pixel's reflectance function. It follows from the lights alone, but for
/// the pixel's scale and its class: the prior covariance of δ and the ratio of noise to signal that describe
/// the pixel best. Of δ by one prior, Σ d (d · e) is the effect of light e along directions d in which the
/// classes of that prior differ by their variances only.
struct LightErrorModel {
  std::vector<Box> cells;         ///< of the light map; light outside them does not count
  std::vector<float> directions;  ///< [priors × directions × cells], as many directions as cells
  std::vector<float>
      variances;  ///< [classes × directions]; each prior has as many classes, one after another

  bool known() const { return !cells.empty(); }
  std::size_t classes() const { return known() ? variances.size() / cells.size() : 0; }
  /// Whether the sizes fit together, of at most 4096 cells.
  bool is_sound() const;
  /// For each class, the mean squared error under `radiance`, a light map of the field's domain, divided by
  /// that under light of the training images' kind.
  std::vector<double> variances_under(const Image& radiance) const;
};

/// Classes of the model for light with many degrees of freedom: ratios of noise to signal. That of a pixel is
/// a hundred times the noise of its photographs, squared and relative to Σ b²: what a field misses at first
/// is about a hundredth of the signal. Without noise only the first would be needed. With 3 % of noise, what
/// large lights leave unknown is mostly noise, and the error under small squares is 1.3 times too large by
/// the first class.
inline constexpr std::array<double, 4> light_noise_ratios = {0.01, 0.03, 0.1, 0.3};

struct FieldOutline;

/// What a pixel's training images tell about its error on images to come. All three are squared and relative
/// to Σ b² over the pixel's measured samples: a pixel without kernels misses all of it, one without light has
/// zeros.
struct ErrorEvidence {
  /// Residual of each image predicted by the final kernels with weights fitted without it. Too low, since the
  /// kernels themselves were chosen with it.
  float leave_one_out = 0.0f;
  /// The photographs' noise as they state it; NaN where they do not.
  float noise = std::numeric_limits<float>::quiet_NaN();
  float samples = 0.0f;  ///< that were measured
  /// What the field misses as the regression on light cells expects it; NaN for light with many degrees of
  /// freedom.
  float expected = std::numeric_limits<float>::quiet_NaN();
  /// Residual of images that the whole choice of kernels was made without; known on a lattice of pixels, NaN
  /// elsewhere.
  float cross_validated = std::numeric_limits<float>::quiet_NaN();
  /// Cross-validated errors of fits to a half and to a quarter of the images; known in every fourth lattice
  /// block.
  float from_half = std::numeric_limits<float>::quiet_NaN();
  float from_quarter = std::numeric_limits<float>::quiet_NaN();
  /// Of `leave_one_out`, what the pixel to the left shares: the product of both residuals. Noise is not
  /// shared, a wrong model is. NaN at the edges of tiles; files of parts leave it out.
  float shared = std::numeric_limits<float>::quiet_NaN();
  std::uint32_t light_class = 0;  ///< of the field's LightErrorModel; FieldQuality keeps it
};

/// Cross-validation is done on a lattice of small blocks of pixels, counted from the whole picture's corner:
/// one in 36, which with five folds costs a seventh of the fit, fewer in large pictures, where a few hundred
/// tell enough, and more in small ones, where one block of 16 pixels would decide. Pictures of fewer than 16
/// blocks have one at most.
class CrossValidationLattice {
 public:
  static constexpr int side_px = 4;  ///< of a block

  CrossValidationLattice(int width, int height) {
    const auto blocks = [&] { return static_cast<long>(width / step_px()) * (height / step_px()); };
    const bool is_tiny = blocks() < blocks_of_small;
    while (step_ < 3 && blocks() > blocks_of_small) ++step_;
    if (is_tiny || blocks() > blocks_of_small) step_ = 6;
    while (blocks() > max_blocks) step_ *= 2;
  }

  int step_px() const { return side_px * step_; }
  /// Place of the lattice's i-th block in either direction, in pixels.
  int corner(int i) const { return i * step_px() + offset() * side_px; }
  bool holds(int x, int y) const {
    return x / side_px % step_ == offset() && y / side_px % step_ == offset();
  }
  /// Whether the pixel lies in a block of every second column and row of the lattice, where fits to parts of
  /// the images are tried, too; not in small pictures.
  bool is_for_learning(int x, int y) const {
    return step_ >= 6 && holds(x, y) && x / step_px() % 2 == 0 && y / step_px() % 2 == 0;
  }

 private:
  static constexpr long max_blocks = 600, blocks_of_small = 16;
  int offset() const { return std::min(step_ / 3, 2); }
  int step_ = 1;  // blocks
};

/// Fills predicted_error, photograph_noise, learning_curve and, for light with many degrees of freedom,
/// light_class of `field.quality` from what each pixel's training images tell, [pixels]; empties them where
/// `evidence` is empty.
///
/// Every pixel's leave-one-out error is steadied by the median of its 3 × 3 neighbours (geometric mean of the
/// two) and corrected by the ratio of cross-validated to leave-one-out error found on lattice pixels that are
/// near in place and error. The prediction is error_of_all_images() of that, or the leave-one-out error where
/// it is larger; for light with few degrees of freedom the mean of the two squares
/// (docs/method/progressive.md). Noise is what the photographs state, but at most what the pixels that are
/// fitted best leave: among many, some have next to no other error. Where they state none, it is what the
/// best pixels of equal brightness leave. Runs on all cores; the result does not depend on their number.
void predict_errors(FieldOutline& field, std::span<const ErrorEvidence> evidence);

}  // namespace refield
