// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"
#include "core/light/light_map.h"

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

// What pack_field() chooses by.

/// Lights of one kind, to measure by them how far two fields' pictures lie apart.
struct ProbeLights {
  std::string kind;
  std::vector<LightMap> lights;
};

/// The kinds, the same for equal domains: `white`; `texels`, one of a hundred texels in a random colour;
/// `bar`, white bars an eighth of the map wide or high; `square`, white squares of a twentieth of the map's
/// shorter side, in five places; `smooth`, coloured noise whose detail falls with its frequency, as in
/// nature.
std::vector<ProbeLights> probe_lights(const LightDomain& domain);

/// Leaving out those kernels of a pixel that carry little of its energy: |weight| × area of the kernel, which
/// is what it adds under white light, in its brightest channel. What they carried goes to the pixel's other
/// kernels, each channel by one factor, so that white light gives the same picture; not where the field has
/// negative weights. Every pixel keeps its
/// strongest kernel.
class Pruning {
 public:
  /// Thresholds lie a quarter of an octave apart; level 0 prunes nothing.
  static constexpr int levels = 112;

  /// Measures the error of all levels in one pass. `field` must outlive this.
  Pruning(const ReflectanceField& field, const std::vector<ProbeLights>& probes, const RunContext& run = {});

  /// Squared relative error under each kind of probe lights.
  const std::vector<double>& squared_errors(int level) const {
    return squared_errors_[static_cast<std::size_t>(level)];
  }
  /// The transfer of some rows of the picture without what lies below a level. Runs on all cores.
  SparseTransfer prune(int level, RowRange rows) const;

 private:
  void measure(const std::vector<ProbeLights>& probes, const RunContext& run);

  const ReflectanceField& field_;
  std::vector<float> area_;                          // [kernels]
  bool has_negative_ = false;                        // some weight is
  double unit_ = 0.0;                                // root mean square of the pixels' energies
  std::vector<std::vector<double>> squared_errors_;  // [levels][kinds]
};

}  // namespace refield
