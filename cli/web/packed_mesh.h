// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield::web {

/// The transfer of a field over a mesh as a page holds it: each group of 16 successive outputs shares
/// kernels, and a weight is a byte times the scale of its kernel, as in packed fields.
struct PackedMesh {
  LightBasis basis;                    ///< used_basis() of the field
  int channels = 1;                    ///< 1 where all weights are grey, else 3
  std::vector<std::uint32_t> counts;   ///< [groups], entries of each
  std::vector<std::uint32_t> kernels;  ///< [entries], ascending in a group
  std::vector<float> scales;           ///< [entries]
  std::vector<std::uint8_t> weights;   ///< [entries × channels × 16]
};

/// Throws InputError where the field has no mesh or has negative weights.
PackedMesh pack_mesh(const ReflectanceField& field, const RunContext& run = {});

/// Outputs [image of the field] that the page shows under `light`.
Image relight(const PackedMesh& packed, const ReflectanceField& field, const LightMap& light);

}  // namespace refield::web
