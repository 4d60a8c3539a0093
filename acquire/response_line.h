// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace refield {

/// From where on an exposure's samples count as clipped.
struct ClipLevel {
  float electrons;       ///< above black
  float floor_variance;  ///< there, of what does not depend on light
};

/// Fits the response lines of many samples at once: electrons over exposure, through the origin. A decoded
/// sample has electrons above black and the variance that does not depend on light; an infinite variance
/// marks a clipped sample, whose weight becomes zero without a branch.
///
/// Weighted least squares with predicted variances, see merge_exposures(). Where a clipped sample lies within
/// the noise of its clipping level, that it clipped is information, and leaving it out would favour those
/// that came out low: there the likelihood of the samples that were measured and of the clipping together is
/// maximised (a censored or Tobit regression: Tobin 1958; Amemiya 1984, eq. 6), by Newton's method with
/// expected information.
class ResponseLines {
 public:
  ResponseLines(std::size_t exposures, std::size_t size);

  // [size] of each exposure, to be filled in.
  float* electrons(std::size_t i) { return electrons_.data() + i * size_; }
  float* floor(std::size_t i) { return floor_.data() + i * size_; }

  /// `per_radiance` [exposures]: electrons that radiance 1 gives. `useful` [exposures] counts samples for
  /// which an exposure holds a fair share of the information, `clipped` those without any measurement: their
  /// sigma is infinite and their radiance the clipping level of the shortest exposure.
  void fit(std::span<const float> per_radiance, std::span<const ClipLevel> clip, std::span<float> radiance,
           std::span<float> sigma, std::span<std::uint32_t> useful, std::uint32_t& clipped);

 private:
  void predict(std::span<const float> per_radiance);
  void refine_where_clipping_tells(std::span<const float> per_radiance, std::span<const ClipLevel> clip,
                                   std::span<float> radiance, std::span<float> sigma);
  void refine(std::size_t x, std::span<const float> per_radiance, std::span<const ClipLevel> clip,
              float& radiance, float& sigma) const;
  std::uint32_t count_useful(std::size_t i, float per_radiance) const;

  std::size_t exposures_;
  std::size_t size_;
  std::vector<float> electrons_;
  std::vector<float> floor_;
  std::vector<float> predicted_;
  std::vector<float> numerator_;
  std::vector<float> information_;  // Σ weight · t²: the inverse variance of the slope
};

}  // namespace refield
