// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/reflectance_field_file.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <string>
#include <utility>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field_io/field_content.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/packed_field.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

std::uint64_t content_bytes(const ReflectanceField& field) {
  return outline_bytes(field) + field.transfer.row_start.size() * sizeof(std::uint64_t) +
         field.transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float));
}

/// `part` is null for a whole field, else it says which rows these are.
void write_field(const fs::path& path, const ReflectanceField& field, const FieldPart* part) {
  require_readable(fault_of_rows(field), path);
  require_readable(fault_of_statistics(field), path);
  // HDF5 1.10 does not survive a full disk gracefully when it closes the file: look before.
  std::span<const ErrorEvidence> evidence;
  if (part) evidence = part->error_evidence;
  if (!evidence.empty() && evidence.size() != field.transfer.rows())
    require_readable("statistics/error_evidence does not fit the image size", path);
  require_free_space(fs::absolute(path).parent_path(), content_bytes(field) + evidence.size_bytes());
  write_atomically(path, [&](const fs::path& temporary) {
    Hdf5Writer writer(temporary, path);
    for (const char* group : {"basis", "transfer", "statistics"}) writer.group(group);
    write_outline(writer, field, reflectance_field_version, part);
    const SparseTransfer& transfer = field.transfer;
    writer.dataset("transfer/row_start", transfer.row_start.data(), {transfer.row_start.size()});
    writer.dataset("transfer/column", transfer.column.data(), {transfer.column.size()});
    writer.dataset("transfer/weight", transfer.weight.data(), {transfer.column.size(), 3});
    write_statistics(writer, field.quality, evidence);
    writer.finish();
  });
}

/// Fills in the numbers; `field.height` must be that of the rows held.
void read_content(const Hdf5Values& values, ReflectanceField& field) {
  read_boxes(values, field);
  SparseTransfer& transfer = field.transfer;
  transfer.row_start = values.dataset<std::uint64_t>("transfer/row_start", 1);
  transfer.column = values.dataset<std::uint32_t>("transfer/column", 1);
  transfer.weight = values.dataset<float>("transfer/weight", 3);
  if (const std::string fault = fault_of_rows(field); !fault.empty()) values.fail(fault);
  read_statistics(values, field);
}

FieldPart read_part(const fs::path& path, bool with_content, const RunContext& run) {
  const FieldFile file = open_field(path, run);
  const Hdf5Values& values = file.values;
  if (!file.part)
    throw InputError(path.string() +
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
    read_content(values, part.field);
    part.error_evidence = read_error_evidence(values, part.field.transfer.rows());
  }
  return part;
}

FieldFile open_whole_field(const fs::path& path, const RunContext& run) {
  FieldFile file = open_field(path, run);
  if (!file.part) return file;
  const Hdf5Values& values = file.values;
  throw InputError(path.string() + ": holds rows " + std::to_string(values.number("first_row")) + " to " +
                   std::to_string(values.number("last_row") - 1) + " of a field of " +
                   std::to_string(values.number("height")) +
                   " rows; merge all shards with 'refield merge SHARDS -o WHOLE.rfield' and give the result");
}

ReflectanceField read_rows(const FieldFile& file) {
  ReflectanceField field{read_outline(file.values), {}};
  read_content(file.values, field);
  return field;
}

}  // namespace

void write_reflectance_field(const fs::path& path, const ReflectanceField& field) {
  write_field(path, field, nullptr);
}

ReflectanceField read_reflectance_field(const fs::path& path, const RunContext& run) {
  const FieldFile file = open_whole_field(path, run);
  return file.version == packed_field_version ? expand(read_packed(file.values)) : read_rows(file);
}

ReflectanceField read_image_field(const fs::path& path, const RunContext& run) {
  ReflectanceField field = read_reflectance_field(path, run);
  if (field.mesh)
    throw InputError(path.string() +
                     ": is a mesh field, but an image field is required; use 'refield relight' or 'refield "
                     "view' for mesh fields");
  return field;
}

std::variant<ReflectanceField, PackedField> read_either_field(const fs::path& path, const RunContext& run) {
  const FieldFile file = open_whole_field(path, run);
  if (file.version == packed_field_version) return read_packed(file.values);
  return read_rows(file);
}

bool is_field_part(const fs::path& path, const RunContext& run) {
  try {
    return open_field(path, run).part;
  } catch (const Error&) {
    return false;
  }
}

void write_field_part(const fs::path& path, const FieldPart& part) {
  write_field(path, part.field, &part);
}

FieldPart read_field_part(const fs::path& path, const RunContext& run) {
  return read_part(path, true, run);
}

FieldPart read_field_part_outline(const fs::path& path, const RunContext& run) {
  return read_part(path, false, run);
}

}  // namespace refield
