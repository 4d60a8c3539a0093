// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "core/base/run_context.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"

namespace refield {

/// The samples b_ij of a band of rows: for each pixel and channel a contiguous vector over the images, as the
/// fit walks it. A sample that was not measured (clipped in every exposure) is NaN.
class ObservationBand {
 public:
  ObservationBand(int width, int first_row, int last_row, int images);

  int width() const { return width_; }
  int first_row() const { return first_row_; }
  int last_row() const { return last_row_; }
  int images() const { return images_; }
  /// Samples of a channel of pixel (x, y), y in [first_row, last_row): [stride], padding zero.
  float* samples(int x, int y, int channel) { return samples_.data() + index(x, y, channel); }
  const float* samples(int x, int y, int channel) const { return samples_.data() + index(x, y, channel); }

  /// Σσ² of a pixel's measured samples, as the photographs state it; nothing where one states none. Of
  /// samples without weights.
  std::optional<double> squared_noise(int x, int y) const;
  void add_noise(std::span<const float> squared);  ///< [rows × width], NaN where it is not known

  /// Multiplies all samples of image j by weights[j], [images].
  void weight_images(std::span<const float> weights);

  static std::uint64_t bytes(int width, int rows, int images);

 private:
  std::size_t index(int x, int y, int channel) const {
    return ((static_cast<std::size_t>(y - first_row_) * width_ + x) * 3 + channel) * stride_;
  }
  int width_, first_row_, last_row_, images_;
  std::size_t stride_;
  AlignedFloats samples_;
  std::vector<double> squared_noise_;  // [rows × width]
};

/// Samples and texels beyond this are faults of a file: the sun's disc has 1.6e9 cd/m².
inline constexpr float largest_radiance = 1e10f;

/// Reads rows [first_row, last_row) of the frames' photographs and undoes what the frames' corrections say.
/// Samples at or above `clip_level` count as not measured. Throws FormatError for a damaged file and
/// InputError for a radiance that is not finite or beyond `largest_radiance`, or a sigma that is no standard
/// deviation, naming file, pixel, channel and value.
ObservationBand read_observations(std::span<const CaptureFrame> frames, int width, int first_row,
                                  int last_row, float clip_level, const RunContext& run);

}  // namespace refield
