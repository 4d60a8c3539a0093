// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field/transfer_tiles.h"

namespace refield {

/// Lays a field's transfer out in tiles. Weights are rounded to the nearest step, the largest that a scale
/// holds for being 255 or 65 535 steps. Runs on all cores; the result does not depend on their number.
/// Throws InputError for a light map larger than small_box_limit.
template <class Weight>
TiledTransfer<Weight> tile_transfer(const ReflectanceField& field);
/// Gives the memory of the field's transfer back as it goes.
template <class Weight>
TiledTransfer<Weight> tile_transfer(ReflectanceField&& field);

/// Lays out a field that is never in memory as a whole. If its rows are not repeatable, all its kernels count
/// as common. Throws Interrupted, too.
template <class Weight>
TiledTransfer<Weight> tile_transfer(const FieldRows& rows, const RunContext& run);

extern template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const FieldRows&, const RunContext&);
extern template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const FieldRows&,
                                                                          const RunContext&);
extern template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const ReflectanceField&);
extern template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const ReflectanceField&);
extern template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(ReflectanceField&&);
extern template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(ReflectanceField&&);

}  // namespace refield
