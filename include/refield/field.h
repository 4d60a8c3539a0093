// SPDX-License-Identifier: Apache-2.0
#pragma once

/// A reflectance field: B = T L with T = transfer · basis (Matusik et al. 2004, equations 1 to 4).
///
/// Public: ReflectanceField with its parts (LightBasis, SparseTransfer [pixels × kernels], FieldQuality with
/// maps [pixels] of relative RMSE, the OutputMesh of precomputed fields), PackedField, and the .rfield file:
/// read_reflectance_field(), read_either_field(), write_reflectance_field(), write_packed_field(). Readers
/// check all of a file and throw FormatError; writers replace the file as a whole and throw DeviceError where
/// the disk refuses. docs/reference/reflectance-field-format.md describes the file.
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
