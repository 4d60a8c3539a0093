// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>

namespace refield::prt {

/// Looks at what the first lines of an OFF or PLY file promise, before any library reserves memory for it.
/// Throws FormatError where they count more vertices or faces than a file of this size can hold, or where the
/// header of a PLY has no end. Other
/// formats have no counts and pass.
void check_mesh_header(const std::filesystem::path& path, const std::string& format);

}  // namespace refield::prt
