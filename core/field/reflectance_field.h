// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "core/field/light_basis.h"
#include "core/field/mesh.h"
#include "core/field/predicted_error.h"
#include "core/image/colour.h"
#include "core/image/image.h"
#include "core/light/monitor_placement.h"

namespace refield {

/// A sparse, non-negative transfer matrix by rows: outputs = transfer · coefficients.
/// One row an output (pixel or vertex); an entry holds a basis function's number and one weight a channel. A
/// weight multiplies the *sum* of texel values in its box.
struct SparseTransfer {
  std::vector<std::uint64_t> row_start{0};  ///< [rows + 1]
  FileVector<std::uint32_t> column;         ///< [entries], basis function
  FileVector<float> weight;                 ///< [entries × 3]

  std::size_t rows() const { return row_start.size() - 1; }
  std::size_t entries() const { return column.size(); }
  /// A copy of rows [first, last).
  SparseTransfer slice(std::size_t first, std::size_t last) const;
  /// Says that a pass is done with some rows, see pass_by().
  void pass_by_rows(std::size_t first, std::size_t last) const;

  /// Appends a row with `columns.size()` entries and `weights` [entries × 3].
  void append_row(std::span<const std::uint32_t> columns, std::span<const float> weights);

  /// `coefficients` [basis functions × 3] to `outputs` [rows × 3]. Runs on all cores; each output is summed
  /// in the order of its entries, so the result does not depend on the number of threads.
  void apply(std::span<const float> coefficients, std::span<float> outputs) const;
};

/// What is known of a field's errors. Each map is [pixels], row-major, relative RMSE, or empty where it was
/// not measured.
struct FieldQuality {
  std::vector<float> training_error;  ///< over the images that the field was estimated from
  /// To be expected on new photographs, as noisy as the training images and under light of their kind.
  std::vector<float> predicted_error;
  std::vector<float> photograph_noise;  ///< the part of predicted_error that is the photographs' own noise
  std::vector<float> training_signal;   ///< root of the mean, over training images, of a pixel's Σ b²
  LightErrorModel light_error;          ///< how the field's own part of predicted_error depends on the light
  std::vector<std::uint32_t> light_class;  ///< of light_error, of each pixel; empty where there is one class
  std::vector<LearningPoint> learning_curve;  ///< error against the share of the training images, or empty
};

/// The mesh whose vertices are a field's outputs. They stand in an image of output_image_width
/// (core/field/mesh.h).
struct OutputMesh : Mesh {
  /// 0: one output per vertex, its radiance in every direction (before its colour). n > 0: n² outputs per
  /// vertex, the harmonics of its radiance (core/light/harmonics.h) over the mirrored viewing direction.
  int outgoing_order = 0;
  std::optional<PinholeCamera> camera{};  ///< from where the mesh is to be shown first

  std::size_t outputs() const {
    return positions.size() * static_cast<std::size_t>(std::max(1, harmonics_of(outgoing_order)));
  }
};

/// All of a reflectance field but its transfer matrix.
struct FieldOutline {
  int width = 0;  ///< pixels
  int height = 0;
  LightBasis basis;
  FieldQuality quality;
  /// Where the monitor stood, for a basis over monitor texels: one placement for each window of the light map
  /// (check_placements()); empty where that is not known.
  std::vector<MonitorPlacement> monitors;
  /// Rectangles of the light map outside which all training lights were black: the field does not know what
  /// light from there does. Empty where light came from everywhere, or where that is not known.
  std::vector<Box> observed_light;
  ColourSpace colour_space = ColourSpace::camera;  ///< of the outputs
  /// Channels of the outputs from the primaries of the light, which the transfer holds: colour mixing between
  /// the illuminator and the camera (estimate/rig/rig_model.h). Outputs are multiplied by it, pixel by pixel.
  Eigen::Matrix3f output_from_primaries = Eigen::Matrix3f::Identity();
  bool mixes_colours() const { return output_from_primaries != Eigen::Matrix3f::Identity(); }
  std::optional<OutputMesh> mesh;  ///< where the outputs are no pixels of a camera
  /// JSON text: inputs, options, version of the program that made it. Holds no time or host, so that equal
  /// inputs give equal files.
  std::string provenance = "{}";

  /// Share of the energy of `radiance`, a light map of the basis' domain, that comes from outside
  /// observed_light; 0 where observed_light is empty. Without interpolation, energy is the sum over texels
  /// and channels.
  LightShares light_shares(const Image& radiance) const;
};

/// How a scene turns incident light into pixels: B = T L with T = transfer · basis (Matusik et al. 2004, eqs.
/// 1–4), multiplied by output_from_primaries. A row of the transfer is a pixel, row-major, top row first; a
/// pixel outside the mask has an empty row.
struct ReflectanceField : FieldOutline {
  SparseTransfer transfer;

  /// Outputs [pixels × 3] under light of these coefficients [basis functions × 3].
  void apply(std::span<const float> coefficients, std::span<float> outputs) const;

  /// Sets basis.interpolation from observed_light and up to 300 pixels, where can_interpolate().
  void fit_interpolation();

  /// The scene under `light`, [height × width × 3]. Throws InputError when the light does not fit the basis'
  /// domain.
  Image relight(const LightMap& light) const;
};

/// A field whose transfer is too large to stand in rows as a whole: it is read some image rows at a time.
struct FieldRows {
  FieldOutline outline;
  /// The transfer of some rows of the image, pixel by pixel. Called once for each range, ranges ascending;
  /// for `repeatable` rows, again from the first.
  std::function<SparseTransfer(RowRange)> rows;
  bool repeatable = false;
};

}  // namespace refield
