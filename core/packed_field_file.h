// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "core/hdf5_values.h"
#include "core/packed_field.h"

namespace refield {

/// Writes a packed field (.rfield), atomically. Equal fields give equal bytes. Throws DeviceError where the
/// disk refuses.
void write_packed_field(const std::filesystem::path& path, const PackedField& packed);

/// Reads a packed field from an open file and checks all of it; throws FormatError. read_either_field() opens
/// files of both kinds.
PackedField read_packed(const Hdf5Values& values);

}  // namespace refield
