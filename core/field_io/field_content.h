// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/hdf5_reader.h"
#include "core/field_io/hdf5_writer.h"

/// What the files of whole, packed and partial fields have in common.
namespace refield {

/// Name of the data set, [pixels] or none.
inline constexpr const char* light_class_name = "statistics/light_class";

/// Attributes of the root and the basis' boxes. `part`: null for a whole field.
void write_outline(const Hdf5Writer& writer, const FieldOutline& field, int version, const FieldPart* part);
/// `evidence`: of a part, else empty.
void write_statistics(const Hdf5Writer& writer, const FieldQuality& quality,
                      std::span<const ErrorEvidence> evidence = {});
/// Bytes that all but the transfer takes in a file, HDF5's own structures included.
std::uint64_t outline_bytes(const FieldOutline& field);

/// The first fault for which a reader would refuse a field kept as rows, or its statistics; "" where there is
/// none. Writers ask, too: what they wrote must be readable.
std::string fault_of_rows(const ReflectanceField& field);
/// The parts of the former: all but the transfer, and the transfer of some rows, each with `kernels` columns.
std::string fault_of_outline(const FieldOutline& field);
std::string fault_of_transfer(const SparseTransfer& transfer, std::uint64_t pixels, std::size_t kernels);
std::string fault_of_statistics(const FieldOutline& field);
/// Throws SolverError where a field about to be written has a fault.
void require_readable(const std::string& fault, const fs::path& destination);

/// A file of a field or of part of one.
struct FieldFile {
  Hdf5Values values;
  bool part = false;
  int version = 0;
};
/// Throws FormatError where it is no such file, or of a version that this program does not know.
FieldFile open_field(const fs::path& path, const RunContext& run);

/// Sizes, light and provenance: what a reader needs before it asks for the numbers.
FieldOutline read_outline(const Hdf5Values& values);
void read_boxes(const Hdf5Values& values, FieldOutline& field);
/// `field.height` must be that of the rows held.
void read_statistics(const Hdf5Values& values, FieldOutline& field);
/// Error evidence of a part; empty if it was estimated without.
std::vector<ErrorEvidence> read_error_evidence(const Hdf5Values& values, std::size_t pixels);

}  // namespace refield
