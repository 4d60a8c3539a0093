// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/capture_session.h"
#include "core/reflectance_field.h"
#include "estimate/fit_pixel.h"
#include "estimate/refit.h"

namespace refield {

/// A field that takes in images which it was not made from.
class Refinement {
 public:
  /// Reads the field. `frames` are all training frames, its own and new ones. Throws InputError when sizes or
  /// light domain differ, when the field does not say what it was made from, when one of its frames is not
  /// among `frames`, or when none of these is new.
  Refinement(const std::filesystem::path& field, const CaptureSession& session,
             std::span<const CaptureFrame> frames);

  /// Says which frames the images of a fit are, once some have been left out.
  void use_frames(std::span<const CaptureFrame> frames);
  /// Whether the field has not seen an image of use_frames() yet.
  bool is_new(int image) const { return is_new_[image] != 0; }
  int known_images() const { return static_cast<int>(known_names_.size()); }
  const std::filesystem::path& path() const { return path_; }
  /// A pixel's kernels as the field has them; squared_residual is relative, of its own images.
  PixelKernels kernels(std::size_t pixel) const;
  /// Whether a pixel is among the tenth whose errors, in radiance, are largest: they make up most of the
  /// whole picture's error.
  bool matters(std::size_t pixel) const { return radiant_error_[pixel] >= error_that_matters_; }

 private:
  void weigh_errors();

  std::filesystem::path path_;
  ReflectanceField field_;
  std::set<std::string> known_names_;
  std::vector<char> is_new_;
  std::vector<float> radiant_error_;  // [pixels], of white light
  float error_that_matters_ = 0.0f;
};

/// Pixels are refined in groups of this many neighbours in a row, counted from the left edge, so that no
/// result depends on bands or tiles.
inline constexpr int refinement_group = 4;

struct PixelToRefine {
  std::size_t pixel;
  PixelSamples samples;
  PixelKernels* kernels;  ///< takes the result
};

/// Refines a group. All pixels get the old rectangles' weights fitted to all images. Those that matter, those
/// whose old kernels predict the new images far worse than their own, and the worst others until half of the
/// group is reached, are fitted anew as well and take the set that the information criterion prefers; the
/// rest learn from them in the sweep of spatial correction that follows.
void refine_pixels(const Refinement& refinement, std::span<const PixelToRefine> group, KernelCache& cache,
                   PixelFitter& tree, WeightFitter& weights);

}  // namespace refield
