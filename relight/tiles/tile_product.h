// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <span>

#include "core/base/aligned_memory.h"
#include "core/image/image.h"
#include "relight/tiles/box_sums.h"
#include "relight/tiles/tile_vectors.h"
#include "relight/tiles/tiled_transfer.h"

namespace refield {

/// Where pixels go: [height × width × 3] floats without gaps, which another user owns. Each is multiplied by
/// `mixing` (FieldOutline::output_from_primaries) where that is not null.
struct PixelTarget {
  float* values = nullptr;
  int width = 0;
  int height = 0;
  const Eigen::Matrix3f* mixing = nullptr;

  PixelTarget(float* first, int width_px, int height_px, const Eigen::Matrix3f* by = nullptr)
      : values(first), width(width_px), height(height_px), mixing(by) {}
  PixelTarget(Image& image)  // NOLINT(google-explicit-constructor): wherever pixels go
      : PixelTarget(image.values.data(), image.width, image.height) {}
  float* at(int x, int y) const { return values + (static_cast<std::size_t>(y) * width + x) * 3; }
};

/// Light under kernels, three floats each, and one more, so that each can be read as four.
using Coefficients = AlignedFloats;

/// image [height × width × 3] = transfer · light. `common` [common kernels × 3 + 1]: their coefficients; the
/// others' light is `light`'s. Runs on all cores; each output is
/// summed in a fixed order.
template <class Weight>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const BoxSums& light,
              const PixelTarget& image);

/// Writes a tile's `groups` (a bit each) into the image at (x0, y0), or, with `add`, adds them; what lies
/// beyond the image's edges is left out.
void store_tile(const TileSums& sums, std::uint32_t groups, bool add, int x0, int y0,
                const PixelTarget& image);

}  // namespace refield
