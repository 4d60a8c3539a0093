// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/hdf5_values.h"
#include "core/hdf5_writer.h"
#include "core/reflectance_field.h"

/// What the files of fields with precomputed transport hold besides: measure and harmonics of the basis, and
/// the mesh. Captured fields have none of it, and their files no trace of it.
namespace refield {

void write_precomputed(const Hdf5Writer& writer, const ReflectanceField& field);
std::uint64_t precomputed_bytes(const ReflectanceField& field);
/// Fills in what the file holds of it; sizes and domain must stand. Throws FormatError.
void read_precomputed(const Hdf5Values& values, ReflectanceField& field);

/// Names of the data sets.
inline constexpr const char* mesh_data_set_names[] = {"mesh/positions", "mesh/normals", "mesh/colours",
                                                      "mesh/triangles", "mesh/camera"};

}  // namespace refield
