// SPDX-License-Identifier: Apache-2.0
#include "relight/pack/pack.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/base/errors.h"
#include "core/base/json_text.h"
#include "core/base/run_context.h"
#include "core/image/metrics.h"
#include "relight/pack/prune.h"
#include "relight/tiles/tiled_transfer.h"

namespace refield {

namespace {

/// Numbers a packed field's kernels as its file does: common ones alone, in their order.
template <class Weight>
void keep_common_boxes(LightBasis& basis, TiledTransfer<Weight>& tiles) {
  std::vector<Box> common;
  for (std::uint32_t i = 0; i < tiles.common.size(); ++i) {
    if (!basis.is_smooth(tiles.common[i])) common.push_back(basis.box(tiles.common[i]));
    tiles.common[i] = i;
  }
  basis.boxes = std::move(common);
}

template <class Weight>
PackedField packed_with(ReflectanceField&& pruned) {
  auto tiles = tile_transfer<Weight>(std::move(pruned));
  // NOLINTNEXTLINE(bugprone-use-after-move): the transfer alone is gone.
  keep_common_boxes(pruned.basis, tiles);
  return {std::move(pruned), std::move(tiles)};
}

nlohmann::ordered_json pack_figures(const PackCost& cost, double max_error) {
  auto by_kind = nlohmann::ordered_json::object();
  for (const auto& error : cost.errors) by_kind[error.kind] = error.relative_rmse;
  return {{"max_error", max_error},   {"error", cost.worst_error()}, {"error_by_kind_of_light", by_kind},
          {"weight_bits", cost.bits}, {"weights", cost.entries},     {"pruned", cost.pruned}};
}

/// Says in the packed field what was done to it, beside how it was made.
std::string with_figures(const std::string& provenance, const nlohmann::ordered_json& figures) {
  auto origin = nlohmann::ordered_json::parse(provenance, nullptr, false);
  if (!origin.is_object()) origin = {{"field", provenance}};
  origin["pack"] = figures;
  return json_text(origin);
}

using Pictures = std::vector<std::vector<Image>>;  // [kinds][lights]

Pictures relight_probes(const ReflectanceField& field, const std::vector<ProbeLights>& probes) {
  Pictures pictures;
  for (const ProbeLights& probe : probes) {
    auto& of_kind = pictures.emplace_back();
    for (const LightMap& light : probe.lights) of_kind.push_back(field.relight(light));
  }
  return pictures;
}

/// Looks for the smallest packed field of some error.
class Search {
 public:
  Search(const ReflectanceField& field, double error, const RunContext& run)
      : field_(field),
        allowed_(error * error),
        probes_(probe_lights(field.basis.domain)),
        full_(relight_probes(field, probes_)),
        pruning_(field, probes_, run) {}

  /// nullopt where so few bits cannot do; then least_error() says what they can.
  std::optional<PackResult> with_bits(int bits, const RunContext& run) {
    // How much of the error falls to the bits is known when a field has been made.
    std::vector<double> of_bits(probes_.size(), 0.0);
    std::optional<PackResult> best;
    int level = highest_level(of_bits, 0.5), best_level = -1;
    for (int tries = 0; tries < max_tries; ++tries) {
      PackResult made = make(bits, level, run);
      const bool within = made.cost.worst_error() * made.cost.worst_error() <= allowed_;
      for (std::size_t kind = 0; kind < of_bits.size(); ++kind)
        of_bits[kind] = std::max(
            0.0, std::pow(made.cost.errors[kind].relative_rmse, 2) - pruning_.squared_errors(level)[kind]);
      if (within && level > best_level) {
        best = std::move(made);
        best_level = level;
      } else if (!within) {
        least_error_ = std::sqrt(std::ranges::max(of_bits));
      }
      int next = highest_level(of_bits, 0.95);
      if (!within) next = std::min(next, level - 1);
      if (next <= best_level) break;
      level = next;
    }
    return best;
  }
  double least_error() const { return least_error_; }

 private:
  static constexpr int max_tries = 6;

  /// The most pruning that leaves room for the errors of bits in a share of the error allowed (squares); −1
  /// where there is none.
  int highest_level(const std::vector<double>& of_bits, double share) const {
    for (int level = Pruning::levels - 1; level >= 0; --level) {
      bool fits = true;
      for (std::size_t kind = 0; kind < of_bits.size(); ++kind)
        fits = fits && of_bits[kind] + pruning_.squared_errors(level)[kind] <= share * allowed_;
      if (fits) return level;
    }
    return -1;
  }

  PackResult make(int bits, int level, const RunContext& run) const {
    run.throw_if_stopped();
    ReflectanceField pruned = pruning_.prune(level);
    PackResult result;
    result.cost.bits = bits;
    result.cost.entries = field_.transfer.entries();
    result.cost.pruned = result.cost.entries - pruned.transfer.entries();
    result.field = bits == 8 ? packed_with<std::uint8_t>(std::move(pruned))
                             : packed_with<std::uint16_t>(std::move(pruned));
    run.throw_if_stopped();
    PackedField copy = result.field;
    const Pictures pictures = relight_probes(expand(std::move(copy)), probes_);
    for (std::size_t kind = 0; kind < probes_.size(); ++kind)
      result.cost.errors.push_back({probes_[kind].kind, relative_rmse(pictures[kind], full_[kind])});
    return result;
  }

  const ReflectanceField& field_;
  double allowed_;  // squared
  std::vector<ProbeLights> probes_;
  Pictures full_;
  Pruning pruning_;
  double least_error_ = 0.0;
};

}  // namespace

double PackCost::worst_error() const {
  return std::ranges::max(errors, {}, &KindError::relative_rmse).relative_rmse;
}

PackResult pack_field(const ReflectanceField& field, double error, const RunContext& run) {
  const ThreadLimit limit(run);
  if (!(error > 0.0)) throw InputError("the maximum error must be above 0, for example 1e-3");
  Search search(field, error, run);
  for (const int bits : {8, 16})
    if (auto result = search.with_bits(bits, run)) {
      FieldOutline& outline = result->field.outline;
      outline.quality = field.quality;
      outline.provenance = with_figures(field.provenance, pack_figures(result->cost, error));
      outline.monitors = field.monitors;
      outline.colour_space = field.colour_space;
      outline.observed_light = field.observed_light;
      return std::move(*result);
    }
  char least[32];
  std::snprintf(least, sizeof least, "%.1e", search.least_error());
  throw InputError(std::string("weights of 16 bits leave an error of ") + least +
                   " already; allow a larger error");
}

PackedField pack_rows(FieldRows rows, int bits, const RunContext& run) {
  PackedField packed;
  if (bits == 8)
    packed.tiles = tile_transfer<std::uint8_t>(rows, run);
  else
    packed.tiles = tile_transfer<std::uint16_t>(rows, run);
  packed.outline = std::move(rows.outline);
  return packed;
}

}  // namespace refield
