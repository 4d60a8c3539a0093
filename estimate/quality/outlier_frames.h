// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/image/metrics.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"
#include "estimate/fit/light_groups.h"
#include "estimate/fit/sample_pooling.h"

namespace refield {

/// A few thousand pixels of all photographs, spread over the whole picture in small cells: enough to assess
/// frames by, at a fraction of the cost of reading everything. Which pixels does not depend on options, rows
/// or threads.
struct PixelSample {
  struct Cell {
    int x = 0, y = 0;  ///< its upper left corner
    int width = 0, height = 0;
    std::vector<int> pixels;  ///< numbers in the sample
  };
  int images = 0;
  int pixels = 0;
  std::vector<Cell> cells;
  std::vector<float> values;  ///< [3][pixels][images], NaN where not measured
  /// Adjacent pixels at the corners of cells, for measuring noise; those inside the mask.
  std::vector<SampleWindow> windows;

  float* series(int channel, int pixel) {
    return values.data() + (static_cast<std::size_t>(channel) * pixels + pixel) * images;
  }
  const float* series(int channel, int pixel) const {
    return values.data() + (static_cast<std::size_t>(channel) * pixels + pixel) * images;
  }
  /// Mean square of the measured samples of the images that are not left out; 0 without any.
  double mean_square(std::span<const int> left_out) const;
};

/// Reads at most 12 × 16 cells of at most 12 pixels, inside the mask. Samples at or above `clip_level` count
/// as not measured. Reads about 12 blocks of 16 rows of each photograph. Errors as read_observations().
PixelSample read_pixel_sample(std::span<const CaptureFrame> frames, int width, int height, const Mask& mask,
                              float clip_level, const RunContext& run);

/// What lights say about each other: for each channel a few Gram matrices of the lights, seen coarsely and
/// through blurs of several widths. They are the kernels of a cheap predictor of any pixel under one light
/// from the same pixel under the others (ridge regression in its dual form; a blur stands for transport that
/// is smooth over the light map).
struct LightGrams {
  /// [channel][blur], [images × images], mean of the diagonal 1.
  std::array<std::vector<Eigen::MatrixXd>, 3> of_channel;
  int images = 0;
  std::vector<std::vector<int>> repeats;  ///< images of one light each, repeats_in()
};

/// Lights seen coarsely, and how they change with the exponent of their tone curve.
struct LightFeatures {
  int columns = 0, rows = 0;  ///< of the grid
  /// [channel][derivative]: [cells × images], summed radiance l of each cell, and the sums of l ln(l / white)
  /// and l ln²(l / white): light of white · (l / white)^(1 + ε) has f₀ + ε f₁ + ε²/2 f₂.
  std::array<std::array<Eigen::MatrixXd, 3>, 3> of_channel;
  double white = 0.0;       ///< largest radiance
  std::vector<int> groups;  ///< light_groups(), [images]

  Eigen::Index images() const { return of_channel[0][0].cols(); }
};

/// Reads the lights. Throws InputError for one that is black, not finite or of another size.
LightFeatures light_features(std::span<const CaptureFrame> frames, const LightDomain& domain,
                             const RunContext& run);
LightGrams light_grams(const LightFeatures& features);

/// Gaussian weights [cells × cells] between cells along one axis, rows summing to one; `sigma` in cells.
Eigen::MatrixXd blur_matrix(Eigen::Index cells, double sigma);

/// (gram + ridge)⁻¹ of the images that are not left out.
Eigen::MatrixXd ridge_inverse(const Eigen::MatrixXd& gram, double ridge);

/// Leave-one-out residuals of `series` [images × series], one channel: what each sample is more than the
/// others predict of it. NaN stands for samples that were not measured; their residual is 0 and they enter no
/// prediction. Frames with `left_out` set predict nothing; their own residual is that of a new frame. Frames
/// of one of `repeats` do not predict each other.
/// Each series takes the blur and ridge that predict it best.
struct LeaveOneOut {
  Eigen::MatrixXf residual;      ///< [images × series]
  Eigen::MatrixXf standardised;  ///< the same over its standard deviation: of the model by leverage, of the
                                 ///< series by its median
};
LeaveOneOut leave_one_out(const std::vector<Eigen::MatrixXd>& grams, const Eigen::MatrixXf& series,
                          const std::vector<char>& left_out, const std::vector<std::vector<int>>& repeats,
                          const RunContext& run = {});

/// A photograph that does not show what the others predict under its light.
struct OutlierFrame {
  enum class Kind {
    brightness,  ///< the whole picture is brighter or darker: a flicker, a wrong exposure
    light,       ///< the whole picture differs: taken under another light than its light map says
    region       ///< a part of it differs: someone walked by, something moved
  };
  int frame = 0;  ///< number among the frames examined
  Kind kind = Kind::light;
  double times_typical = 0.0;  ///< residual over that of a typical frame; region: in its worst cell
  double residual = 0.0;  ///< median over pixels of |observed − predicted| / predicted; region: in its cells
  std::array<double, 3> brightness{};  ///< median over pixels of observed / predicted − 1, each channel
  double share = 1.0;                  ///< of the picture's cells that differ
  int x = 0, y = 0;                    ///< region: the middle of what differs, pixels
};

/// "41 times the usual residual in 9 % of the picture around (88, 61)": for people.
std::string description_of(const OutlierFrame& outlier);

/// Fewer frames say too little about each other to be assessed.
inline constexpr int min_frames_to_assess = 10;

struct OutlierSearch {
  std::vector<OutlierFrame> outliers;  ///< in the order of frames
  double typical_residual = 0.0;       ///< median over frames and pixels, relative
  std::vector<double> residuals;       ///< [frames], the same for each
  /// More than a quarter of the frames disagree with the rest: there is no majority to trust. They are listed
  /// all the same.
  bool too_many = false;
};

/// Finds frames that do not fit. Each pixel of the sample is predicted under each light from the other frames
/// (light_predictor.h), which is good to the noise for most pixels; frames are then compared by the median
/// standardised residual over the whole picture, and over the worst of its cells, with the spread of the same
/// over all frames (median and MAD of its logarithm). Unusual lights are no outliers: the prediction knows
/// how sure it can be of each. What is found is left out and the search repeated, so that one bad frame
/// neither hides nor makes another. Deterministic.
OutlierSearch find_outlier_frames(const LightGrams& grams, const PixelSample& sample, const RunContext& run);

}  // namespace refield
