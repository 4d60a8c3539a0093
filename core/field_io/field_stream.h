// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>

#include "core/base/run_context.h"
#include "core/field_io/field_shard.h"

namespace refield {

/// A transfer that is too large to stand in memory as a whole; pieces are some rows each, in order.
struct TransferPieces {
  std::span<const std::uint64_t> row_start;  ///< of all pieces, [rows + 1]
  std::size_t count = 0;
  /// Called once for each piece, in order; the result is used until the next call.
  std::function<const SparseTransfer&(std::size_t piece)> piece;
};

/// Writes a field whose transfer comes in pieces, to the same bytes as write_reflectance_field(): no more
/// than one piece is held. A file of that name appears, or changes, only once all of it is written. Throws
/// DeviceError where the disk refuses (asked for the space of all pieces before the first), SolverError for
/// pieces that do not fit the field, Interrupted.
void write_reflectance_field(const std::filesystem::path& path, const FieldOutline& field,
                             const TransferPieces& transfer, const RunContext& run);
/// The same for a part, whose own transfer is not looked at.
void write_field_part(const std::filesystem::path& path, const FieldPart& part,
                      const TransferPieces& transfer, const RunContext& run);

}  // namespace refield
