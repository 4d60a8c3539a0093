// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field/transfer_tiles.h"

namespace refield {

/// Lays a field's transfer out in tiles with weights of `bits`, 8 or 16, rounded to the nearest step: the
/// largest that a scale holds for is 255 or 65 535 steps. Runs on all cores; the result does not depend on
/// their number. Throws InputError for a light map larger than small_box_limit.
TransferTiles tile_transfer(const ReflectanceField& field, int bits);
/// Gives the memory of the field's transfer back as it goes.
TransferTiles tile_transfer(ReflectanceField&& field, int bits);

/// Lays out a field that is never in memory as a whole. If its rows are not repeatable, all its kernels count
/// as common. Throws Interrupted, too.
TransferTiles tile_transfer(const FieldRows& rows, int bits, const RunContext& run);

}  // namespace refield
