// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

namespace refield {

/// What read_hdf5_outline() finds, as CBOR; the arguments are the file and the names of the data sets. HDF5's
/// library (1.10) crashes on many damaged files: where files may be hostile, call it in a process of its own.
/// Not for several threads at once. Throws where the file is no HDF5 file.
std::string describe_hdf5(const std::vector<std::string>& arguments);

}  // namespace refield
