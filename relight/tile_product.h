// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "core/aligned_memory.h"
#include "core/image.h"
#include "core/summed_area_table.h"
#include "relight/fixed_point_table.h"
#include "relight/tile_vectors.h"
#include "relight/tiled_transfer.h"

namespace refield {

/// Light under kernels, three floats each, and one more, so that each can be read as four.
using Coefficients = AlignedFloats;

/// `sums` [boxes × 4]: of the light under each box, a channel each; the fourth means nothing.
void sum_boxes(const FixedPointTable& table, std::span<const SmallBox> boxes, float* sums);
void sum_boxes(const SummedAreaTable& table, std::span<const SmallBox> boxes, float* sums);

/// image [height × width × 3] = transfer · light. `common` [common kernels × 3 + 1]: their coefficients; the
/// others' light is summed through `table`. Runs on all cores; each output is summed in a fixed order.
template <class Weight, class Table>
void multiply(const TiledTransfer<Weight>& transfer, const Coefficients& common, const Table& table,
              Image& image);

/// Writes a tile's `groups` (a bit each) into the image at (x0, y0), or, with `add`, adds them; what lies
/// beyond the image's edges is left out.
void store_tile(const TileSums& sums, std::uint32_t groups, bool add, int x0, int y0, Image& image);

}  // namespace refield
