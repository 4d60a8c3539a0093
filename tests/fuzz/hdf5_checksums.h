// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>

namespace refield::fuzz {

/// Makes the checksums of an HDF5 file's superblock and object headers (versions 2 and 3) fit their content
/// again, wherever these can still be recognised. HDF5 File Format Specification, II.A and IV.A.1.b.
void renew_hdf5_checksums(std::span<std::uint8_t> file);

}  // namespace refield::fuzz
