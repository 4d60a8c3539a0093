// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "core/reflectance_field.h"

namespace refield {

/// The version of the file format that this program writes and reads. docs/reflectance-field-format.md
/// describes it.
inline constexpr int reflectance_field_version = 2;

/// Writes a field as one HDF5 file (.rfield), atomically. Equal fields give equal bytes.
/// Throws DeviceError where the disk refuses.
void write_reflectance_field(const std::filesystem::path& path, const ReflectanceField& field);

/// Reads a field and checks all of it: shapes, box bounds, entry numbers, finite non-negative weights.
/// Throws FormatError for another kind of file, another version or damaged content.
ReflectanceField read_reflectance_field(const std::filesystem::path& path);

}  // namespace refield
