// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/box.h"
#include "core/image.h"
#include "relight/changed_texels.h"
#include "relight/kernel_blocks.h"
#include "relight/tiled_transfer.h"

namespace refield {

/// A light that changed inside one rectangle.
template <class Table>
struct LightChange {
  Box within;
  const ChangedTexels& changed;  ///< inside `within`
  const Table& difference;       ///< new less old radiance there
  std::vector<double> smooth;    ///< [smooth kernels × 3], what the change adds to their coefficients
};

/// image += transfer · change. Of kernels that the change does not reach nothing is looked at but the bounds
/// of their blocks (`blocks`, of this transfer), and weights only of kernels under which texels changed.
template <class Weight, class Table>
void add_change(const TiledTransfer<Weight>& transfer, const KernelBlocks& blocks,
                const LightChange<Table>& change, Image& image);

}  // namespace refield
