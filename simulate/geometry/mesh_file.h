// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/geometry/mesh_import.h"

namespace refield::prt {

/// Looks at what the first lines of an OFF or PLY file promise, before any library reserves memory for it.
/// Throws FormatError where they count more vertices or faces than a file of this size can hold, or where the
/// header of a PLY has no end. Other
/// formats have no counts and pass.
void check_mesh_header(const std::filesystem::path& path, const std::string& format);

/// Normals from the triangles: at each vertex the mean of theirs, weighted by area. A vertex whose triangles
/// cancel out takes the first one's.
void compute_normals(Mesh& mesh);

struct MeshFileOptions {
  std::optional<ColourCoding> coding{};  ///< of vertex colours; none: usual_colour_coding()
  bool materials = true;                 ///< whether colours include the base colours of the file's materials
};

struct MeshFile {
  Mesh mesh;
  bool has_base_colours = false;  ///< colours are all of the reflectance, not factors of it
};

/// Reads a mesh (import_mesh()) into the axes of core/field/mesh.h: z is negated and triangles are turned
/// around. Vertices of equal position, colour and material become one, unless the file gives them normals
/// that differ: so its hard edges stay hard. Normals are computed anew, weighted by area, over colours and
/// materials. Triangles without area and vertices without triangle are left out, which run.note tells.
/// Colours are those of the vertices, clamped to [0, 1], times base_colours(); a file without is white.
/// Throws as import_mesh(), and FormatError where no triangle is left.
MeshFile read_mesh_file(const std::filesystem::path& path, const MeshFileOptions& options = {},
                        const RunContext& run = {});

}  // namespace refield::prt
