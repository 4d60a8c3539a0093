// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/reflectance_field_file.h"

#include "core/base/files.h"
#include "core/field_io/field_content.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/packed_field.h"

namespace refield {

namespace {

/// `part` is null for a whole field, else it says which rows these are.
void write_field(const fs::path& path, const FieldOutline& field, const TransferPieces& transfer,
                 const FieldPart* part, const RunContext& run) {
  const std::uint64_t pixels = static_cast<std::uint64_t>(field.width) * field.height;
  require_readable(fault_of_outline(field), path);
  if (transfer.row_start.size() != pixels + 1)
    require_readable("transfer/row_start does not fit the image size", path);
  require_readable(fault_of_statistics(field), path);
  std::span<const ErrorEvidence> evidence;
  if (part) evidence = part->error_evidence;
  if (!evidence.empty() && evidence.size() != pixels)
    require_readable("statistics/error_evidence does not fit the image size", path);
  // HDF5 1.10 does not survive a full disk gracefully when it closes the file: look before.
  const std::uint64_t entries = transfer.row_start.back();
  require_free_space(fs::absolute(path).parent_path(),
                     outline_bytes(field) + transfer.row_start.size_bytes() + evidence.size_bytes() +
                         entries * (sizeof(std::uint32_t) + 3 * sizeof(float)));
  write_atomically(path, [&](const fs::path& temporary) {
    Hdf5Writer writer(temporary, path);
    for (const char* group : {"basis", "transfer", "statistics"}) writer.group(group);
    write_outline(writer, field, reflectance_field_version, part);
    writer.dataset("transfer/row_start", transfer.row_start.data(), {transfer.row_start.size()});
    {
      Hdf5DataSetWriter<std::uint32_t> column(writer, "transfer/column", {entries});
      Hdf5DataSetWriter<float> weight(writer, "transfer/weight", {entries, 3});
      std::uint64_t rows = 0, before = 0;
      for (std::size_t i = 0; i < transfer.count; ++i) {
        run.throw_if_stopped();
        const SparseTransfer& piece = transfer.piece(i);
        require_readable(fault_of_transfer(piece, piece.rows(), field.basis.size()), path);
        rows += piece.rows();
        before += piece.entries();
        if (rows > pixels || transfer.row_start[rows] != before)
          require_readable("transfer/row_start does not fit transfer/column", path);
        column.append(piece.column);
        weight.append(piece.weight);
      }
      if (rows != pixels) require_readable("transfer/row_start does not fit the image size", path);
      column.finish();
      weight.finish();
    }
    write_statistics(writer, field.quality, evidence);
    writer.finish();
  });
}

TransferPieces one_piece(const SparseTransfer& transfer) {
  return {transfer.row_start, 1, [&](std::size_t) -> const SparseTransfer& { return transfer; }};
}

/// Fills in the numbers; `field.height` must be that of the rows held.
void read_content(const Hdf5Values& values, ReflectanceField& field, std::uint64_t map_from) {
  read_boxes(values, field);
  SparseTransfer& transfer = field.transfer;
  transfer.row_start = values.dataset<std::uint64_t>("transfer/row_start", 1);
  transfer.column = values.file_vector<std::uint32_t>("transfer/column", 1, map_from);
  transfer.weight = values.file_vector<float>("transfer/weight", 3, map_from);
  if (const std::string fault = fault_of_rows(field); !fault.empty()) values.fail(fault);
  read_statistics(values, field);
}

FieldPart read_part(const fs::path& path, bool with_content, const RunContext& run) {
  const FieldFile file = open_field(path, run);
  const Hdf5Values& values = file.values;
  if (!file.part)
    throw InputError(path,
                     ": is a complete field, not a shard; give files written by 'refield estimate --rows'");
  FieldPart part;
  part.field = {read_outline(values), {}};
  part.image_height = part.field.height;
  part.rows = {values.number("first_row"), values.number("last_row")};
  if (part.rows.first < 0 || part.rows.first >= part.rows.last || part.rows.last > part.image_height)
    values.fail("states impossible rows");
  part.field.height = part.rows.count();
  part.job = values.text("job");
  if (with_content) {
    // Merging renumbers its kernels.
    read_content(values, part.field, std::numeric_limits<std::uint64_t>::max());
    part.error_evidence = read_error_evidence(values, part.field.transfer.rows());
  }
  return part;
}

FieldFile open_whole_field(const fs::path& path, const RunContext& run) {
  FieldFile file = open_field(path, run);
  if (!file.part) return file;
  const Hdf5Values& values = file.values;
  throw InputError(path, ": holds rows ", values.number("first_row"), " to ", values.number("last_row") - 1,
                   " of a field of ", values.number("height"),
                   " rows; merge all shards with 'refield merge SHARDS -o WHOLE.rfield' and give the result");
}

ReflectanceField read_rows(const FieldFile& file, std::uint64_t map_from) {
  ReflectanceField field{read_outline(file.values), {}};
  read_content(file.values, field, map_from);
  return field;
}

}  // namespace

void write_reflectance_field(const fs::path& path, const ReflectanceField& field) {
  require_readable(fault_of_rows(field), path);
  write_field(path, field, one_piece(field.transfer), nullptr, {});
}

void write_reflectance_field(const fs::path& path, const FieldOutline& field, const TransferPieces& transfer,
                             const RunContext& run) {
  write_field(path, field, transfer, nullptr, run);
}

ReflectanceField read_reflectance_field(const fs::path& path, const RunContext& run, std::uint64_t map_from) {
  const FieldFile file = open_whole_field(path, run);
  return file.version == packed_field_version ? expand(read_packed(file.values)) : read_rows(file, map_from);
}

ReflectanceField read_image_field(const fs::path& path, const RunContext& run) {
  ReflectanceField field = read_reflectance_field(path, run);
  if (field.mesh)
    throw InputError(path,
                     ": is a mesh field, but an image field is required; use 'refield relight' or 'refield "
                     "view' for mesh fields");
  return field;
}

std::variant<ReflectanceField, PackedField> read_either_field(const fs::path& path, const RunContext& run) {
  const FieldFile file = open_whole_field(path, run);
  if (file.version == packed_field_version) return read_packed(file.values);
  return read_rows(file, large_transfer_bytes);
}

bool is_field_part(const fs::path& path, const RunContext& run) {
  try {
    return open_field(path, run).part;
  } catch (const Error&) {
    return false;
  }
}

void write_field_part(const fs::path& path, const FieldPart& part) {
  require_readable(fault_of_rows(part.field), path);
  write_field(path, part.field, one_piece(part.field.transfer), &part, {});
}

void write_field_part(const fs::path& path, const FieldPart& part, const TransferPieces& transfer,
                      const RunContext& run) {
  write_field(path, part.field, transfer, &part, run);
}

FieldPart read_field_part(const fs::path& path, const RunContext& run) {
  return read_part(path, true, run);
}

FieldPart read_field_part_outline(const fs::path& path, const RunContext& run) {
  return read_part(path, false, run);
}

}  // namespace refield
