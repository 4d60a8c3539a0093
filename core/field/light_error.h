// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"

namespace refield {

/// Squared error under a training light that is left out, from that of cross-validation in five folds, whose
/// fits have a fifth fewer images. What a field misses beyond the photographs' `noise` is taken to fall with
/// the images to the power 1.5, squared: from 15 to 24 of 30 photographs of the tabletop 1.55 to 1.67.
double error_of_all_images(double cross_validated, double noise);

/// Whether the field's predicted errors follow the light: by its LightErrorModel, or between single light
/// sources (predict_errors_between()).
bool knows_light_error(const FieldOutline& field);
/// The field's own squared error of each pixel under `radiance`, a light map of its domain, summed over
/// channels: [pixels], empty unless knows_light_error(). Zero under single light sources that the field was
/// made from: how noisy their photographs are is not known.
std::vector<double> own_squared_error_under(const FieldOutline& field, const Image& radiance);

/// Relative RMSE that every pixel is expected to have on a photograph under `radiance`, a light map of the
/// field's domain, of which `relit` is the field's image [height × width × 3]: the field's own error under
/// this light, and photograph noise in proportion to the pixel. 0 where no error is known or the image is
/// black. Unless knows_light_error(), the prediction for the training images' kind of light.
std::vector<float> predicted_error_under(const FieldOutline& field, const Image& radiance,
                                         const Image& relit);

/// What pixels show of equal irradiance from each of a field's light sources.
class SourceResponses {
 public:
  /// The field must outlive this.
  SourceResponses(const ReflectanceField& field, const std::vector<Box>& sources);

  Eigen::Index sources() const { return count_; }
  /// [sources × 3]
  Eigen::MatrixXd of_pixel(std::size_t pixel) const;

 private:
  const SparseTransfer& transfer_;
  Eigen::Index count_;
  std::vector<std::vector<std::pair<Eigen::Index, double>>> of_kernels_;  // source, response of a weight of 1
};

/// For fields of photographs under single light sources, whose residuals tell nothing: sets predicted_error
/// to that of sources which are predicted from all others with `interpolation`, and training_signal to the
/// root mean square over the sources at irradiance 1.
void predict_errors_between(const LightInterpolation& interpolation, const LightDomain& domain,
                            const SourceResponses& responses, FieldQuality& quality);

}  // namespace refield
