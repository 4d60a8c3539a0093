// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"

namespace refield {

/// Some rows of a reflectance field, estimated on their own. The file is a field's with three attributes more
/// (docs/reference/reflectance-field-format.md); only merge_field_parts() and `refield info` read it.
struct FieldPart {
  ReflectanceField field;  ///< of the rows alone: height is rows.count()
  RowRange rows;           ///< of the whole picture
  int image_height = 0;    ///< of the whole picture
  /// Names everything that the whole result depends on: parts go together only where it is the same.
  std::string job;
  /// [pixels] or empty: what predict_errors() needs once all parts are merged.
  std::vector<ErrorEvidence> error_evidence{};
};

/// Whether a file is a part of a field. False for whole fields and for anything else.
bool is_field_part(const fs::path& path, const RunContext& run = {});

/// Writes a part, atomically. Throws DeviceError where the disk refuses.
void write_field_part(const fs::path& path, const FieldPart& part);

/// Reads a part and checks it as read_reflectance_field() does. Throws InputError for a whole field,
/// FormatError for anything else.
FieldPart read_field_part(const fs::path& path, const RunContext& run = {});
/// Reads a part without its boxes, transfer and statistics.
FieldPart read_field_part_outline(const fs::path& path, const RunContext& run);

/// Joins parts, given in any order, into the file of the field that one run over all rows makes, to the bit.
/// Each part is read twice, and one of them is held at a time; parts with light sources to interpolate
/// between are read once, and all are held. Returns the field, of whose transfer only row_start is certain to
/// be there. Throws InputError naming the files where rows are missing or held twice, or where parts come
/// from different captures, options or versions; else as write_reflectance_field().
ReflectanceField merge_field_parts(std::span<const fs::path> paths, const fs::path& output,
                                   const RunContext& run = {});

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
void write_reflectance_field(const fs::path& path, const FieldOutline& field, const TransferPieces& transfer,
                             const RunContext& run);
/// Writes a part; `part`'s own transfer is ignored.
void write_field_part(const fs::path& path, const FieldPart& part, const TransferPieces& transfer,
                      const RunContext& run);

}  // namespace refield
