// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field_rows.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::prt {

/// The transfer as a field over cube maps of `map_resolution` texels a face, which sums harmonics of the
/// light and relights as all fields do. Output s is number s mod outputs of vertex s ∕ outputs; a positive
/// value goes to the kernel of its harmonic, a negative one to that of its opposite. Provenance is the
/// caller's.
FieldRows harmonic_field(const Scene& scene, HarmonicTransfer transfer, int map_resolution);

}  // namespace refield::prt
