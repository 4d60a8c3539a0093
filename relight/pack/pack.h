// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"

namespace refield {

/// What packing a field cost.
struct PackCost {
  int bits = 0;
  std::size_t entries = 0;  ///< weights of three channels, of the full field
  std::size_t pruned = 0;   ///< of these, left out for their little energy
  struct KindError {
    std::string kind;
    double relative_rmse = 0.0;
  };
  /// Errors of relit pictures against the full field's, by kind of light (probe_lights()).
  std::vector<KindError> errors;
  double worst_error() const;
};

struct PackResult {
  PackedField field;
  PackCost cost;
};

/// Packs a field so that pictures relit from it differ from its own by a relative RMSE below `error` under
/// each kind of probe lights: with weights of 8 bits where that can do, else 16, and without as many weak
/// kernels (Pruning) as the error then has room for. Equal input gives equal output. The provenance gains a
/// member "pack": max_error, error, error_by_kind_of_light, weight_bits, weights, pruned. Throws InputError
/// where 16 bits are too few for `error` or the light map is larger than small_box_limit.
PackResult pack_field(const ReflectanceField& field, double error, const RunContext& run = {});

/// Packs a field that is never there as a whole, with weights of 8 or 16 bits and all its kernels.
/// Throws InputError where the light map is larger than small_box_limit, Interrupted.
PackedField pack_rows(FieldRows rows, int bits, const RunContext& run = {});

}  // namespace refield
