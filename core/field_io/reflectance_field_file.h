// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"

namespace refield {

/// The version of the file format that this program writes; fields that were packed have one of their own.
/// docs/reference/reflectance-field-format.md describes both.
inline constexpr int reflectance_field_version = 2;
inline constexpr int packed_field_version = 3;

/// Writes a field as one HDF5 file (.rfield), atomically. Equal fields give equal bytes.
/// Throws DeviceError where the disk refuses.
void write_reflectance_field(const fs::path& path, const ReflectanceField& field);

inline constexpr std::uint64_t large_transfer_bytes = std::uint64_t{1} << 30;

/// Reads a field, packed or not, and checks all of it: shapes, box bounds, entry numbers, finite non-negative
/// weights. Throws FormatError for another kind of file, another version or damaged content. Columns and
/// weights of `map_from` bytes or more stay in the file (FileVector), which must not be written to in place
/// meanwhile: a picture of 24 megapixels takes 1 GiB then instead of 9.
ReflectanceField read_reflectance_field(const fs::path& path, const RunContext& run = {},
                                        std::uint64_t map_from = large_transfer_bytes);

/// Reads a field of a fixed camera. Throws InputError for a field over a mesh.
ReflectanceField read_image_field(const fs::path& path, const RunContext& run);

/// As read_reflectance_field(), but leaves a packed field as it is in the file.
std::variant<ReflectanceField, PackedField> read_either_field(const fs::path& path,
                                                              const RunContext& run = {});

}  // namespace refield
