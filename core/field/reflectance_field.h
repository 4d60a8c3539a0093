// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/field/light_basis.h"
#include "core/field/mesh.h"
#include "core/field/predicted_error.h"
#include "core/field/transfer_matrix.h"
#include "core/image/image.h"
#include "core/light/monitor_placement.h"

namespace refield {

/// Rows [first, last) of an image, counted from the top.
struct RowRange {
  int first = 0;
  int last = 0;

  int count() const { return last - first; }
  bool operator==(const RowRange&) const = default;
};

/// How a scene turns incident light into pixels: B = T L with T = transfer · basis (Matusik et al. 2004, eqs.
/// 1–4). A row of the transfer is a pixel, row-major, top row first; a pixel outside the mask has an empty
/// row.
struct ReflectanceField {
  int width = 0;
  int height = 0;
  LightBasis basis;
  SparseTransfer transfer;
  /// [pixels], relative RMSE over the images it was estimated from; empty where the field was not estimated.
  std::vector<float> training_error;
  /// [pixels] or empty: what predict_errors() predicts from. Whole fields do without once it has; parts of a
  /// field keep it.
  std::vector<ErrorEvidence> error_evidence;
  /// [pixels] or empty: relative RMSE to be expected on new photographs, as noisy as the training images and
  /// under light of their kind.
  std::vector<float> predicted_error;
  /// [pixels] or empty: the part of it that is the photographs' own noise.
  std::vector<float> photograph_noise;
  /// Error against the share of the training images; empty where it was not measured.
  std::vector<LearningPoint> learning_curve;
  /// JSON text: inputs, options, version of the program that made it. Holds no time or host, so that equal
  /// inputs give equal files.
  std::string provenance = "{}";
  /// Where the monitor stood, for a basis over monitor texels, one placement for each window of the light map
  /// (check_placements()); empty where that is not known.
  std::vector<MonitorPlacement> monitors;
  /// Where the outputs are no pixels but a mesh' vertices: that mesh; else empty. Its outputs stand in an
  /// image of output_image_width (core/field/mesh.h).
  Mesh mesh;
  /// 0: a vertex has one output, its radiance towards everyone (before its colour). n > 0: n² of them, the
  /// harmonics of its radiance (core/light/harmonics.h) over the direction in which the line of sight is
  /// mirrored.
  int outgoing_order = 0;
  std::optional<PinholeCamera> camera;  ///< from where the mesh is to be shown first
  std::size_t mesh_outputs() const {
    return mesh.positions.size() * static_cast<std::size_t>(std::max(1, harmonics_of(outgoing_order)));
  }

  /// The scene under `light`, [height × width × 3]. Throws InputError when the light does not fit the basis'
  /// domain.
  Image relight(const LightMap& light) const;
};

/// A field whose transfer is too large to stand in rows as a whole: it is asked for some image rows at a
/// time.
struct FieldRows {
  ReflectanceField outline;  ///< all but the transfer
  /// The transfer of some rows of the image, pixel by pixel. May be called once for each range, ranges
  /// ascending.
  std::function<SparseTransfer(RowRange)> rows;
};

}  // namespace refield
