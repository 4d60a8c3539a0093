// SPDX-License-Identifier: Apache-2.0
#include "relight/pack/pack.h"

#include <cmath>
#include <unordered_map>

#include "core/base/json.h"
#include "core/base/number_text.h"
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

Json pack_figures(const PackCost& cost, double max_error) {
  auto by_kind = Json::object();
  for (const auto& error : cost.errors) by_kind[error.kind] = error.relative_rmse;
  return {{"max_error", max_error},   {"error", cost.worst_error()}, {"error_by_kind_of_light", by_kind},
          {"weight_bits", cost.bits}, {"weights", cost.entries},     {"pruned", cost.pruned}};
}

/// Says in the packed field what was done to it, beside how it was made.
std::string with_figures(const std::string& provenance, const Json& figures) {
  auto origin = json_if_valid(provenance);
  if (!origin.is_object()) origin = {{"field", provenance}};
  origin["pack"] = figures;
  return json_text(origin);
}

constexpr int tile_rows = TiledTransfer<std::uint8_t>::band_rows;

/// Relates the pictures of packed fields to the full field's, some rows of tiles at a time: pictures of all
/// lights would take more memory than the packed field. An error is infinite where the full field is black.
class ErrorOfPacked {
 public:
  ErrorOfPacked(const ReflectanceField& full, const std::vector<ProbeLights>& probes)
      : full_(full), probes_(probes) {
    for (const ProbeLights& probe : probes)
      for (const LightMap& light : probe.lights) coefficients_.push_back(full.basis.project(light));
    for (std::size_t k = full.basis.smooth(); k < full.basis.size(); ++k)
      numbers_.emplace(full.basis.box(k), static_cast<std::uint32_t>(k));
  }

  /// `tiles`: with the full field's numbers of common kernels. Advances `progress` once for each band.
  std::vector<PackCost::KindError> of(const TransferTiles& tiles, const RunContext& run,
                                      Progress& progress) const {
    std::vector<double> error(probes_.size(), 0.0), signal(probes_.size(), 0.0);
    const int tiles_down = std::visit([](const auto& of_bits) { return of_bits.tiles_down(); }, tiles);
    for (int row = 0; row < tiles_down; row += tile_rows, progress.advance()) {
      run.throw_if_stopped();
      const SparseTransfer shown = expand_tiles(tiles, {row, std::min(row + tile_rows, tiles_down)},
                                                [&](const Box& box) { return numbers_.at(box); });
      const std::size_t first = static_cast<std::size_t>(row) * tile_side_px * full_.width;
      const SparseTransfer full = full_.transfer.slice(first, first + shown.rows());
      full_.transfer.pass_by_rows(first, first + shown.rows());
      std::vector<float> expected(3 * full.rows()), picture(expected.size());
      auto coefficients = coefficients_.begin();
      for (std::size_t kind = 0; kind < probes_.size(); ++kind)
        for (std::size_t light = 0; light < probes_[kind].lights.size(); ++light, ++coefficients) {
          full.apply(*coefficients, expected);
          shown.apply(*coefficients, picture);
          for (std::size_t i = 0; i < expected.size(); ++i) {
            const double difference = double{picture[i]} - expected[i];
            error[kind] += difference * difference;
            signal[kind] += double{expected[i]} * expected[i];
          }
        }
    }
    std::vector<PackCost::KindError> errors;
    for (std::size_t kind = 0; kind < probes_.size(); ++kind)
      errors.push_back({probes_[kind].kind, error[kind] > 0.0 ? std::sqrt(error[kind] / signal[kind]) : 0.0});
    return errors;
  }

 private:
  const ReflectanceField& full_;
  const std::vector<ProbeLights>& probes_;
  std::vector<std::vector<float>> coefficients_;  // [lights of all kinds]
  std::unordered_map<Box, std::uint32_t, BoxHash> numbers_;
};

/// Looks for the smallest packed field of some error.
class Search {
 public:
  Search(const ReflectanceField& field, double error, const RunContext& run)
      : field_(field),
        allowed_(error * error),
        probes_(probe_lights(field.basis.domain)),
        error_(field, probes_),
        pruning_(field, probes_, run) {}

  /// nullopt where so few bits cannot do; then least_error() says what they can.
  std::optional<PackResult> with_bits(int bits, const RunContext& run) {
    // How much of the error falls to the bits is known when a field has been made.
    std::vector<double> of_bits(probes_.size(), 0.0);
    std::optional<PackResult> made;
    int level = highest_level(of_bits, 0.5), best_level = -1;
    for (int tries = 1;; ++tries) {
      made.reset();  // One packed field is in memory at a time: of a large picture it takes gigabytes.
      made = make(bits, level, run);
      const bool within = made->cost.worst_error() * made->cost.worst_error() <= allowed_;
      for (std::size_t kind = 0; kind < of_bits.size(); ++kind)
        of_bits[kind] = std::max(
            0.0, std::pow(made->cost.errors[kind].relative_rmse, 2) - pruning_.squared_errors(level)[kind]);
      if (within)
        best_level = std::max(best_level, level);
      else
        least_error_ = std::sqrt(std::ranges::max(of_bits));
      int next = highest_level(of_bits, 0.95);
      if (!within) next = std::min(next, level - 1);
      if (next <= best_level || tries == max_tries) break;
      level = next;
    }
    if (best_level < 0) return std::nullopt;
    if (level != best_level) {
      made.reset();
      made = make(bits, best_level, run);
    }
    return made;
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
    FieldRows pruned;
    pruned.outline.width = field_.width;
    pruned.outline.height = field_.height;
    pruned.outline.basis = field_.basis;
    pruned.repeatable = true;
    const int bands = (field_.height + tile_rows * tile_side_px - 1) / (tile_rows * tile_side_px);
    // Two passes lay out the tiles, the third measures their error.
    Progress progress(run, "packing with " + std::to_string(bits) + " bits",
                      3 * static_cast<std::size_t>(bands));
    std::size_t entries = 0;  // of the last pass
    pruned.rows = [&](RowRange rows) {
      if (rows.first == 0) entries = 0;
      SparseTransfer some = pruning_.prune(level, rows);
      entries += some.entries();
      progress.advance();
      return some;
    };
    PackResult result;
    result.field = pack_rows(pruned, bits, run);
    result.cost.bits = bits;
    result.cost.entries = field_.transfer.entries();
    result.cost.pruned = result.cost.entries - entries;
    result.cost.errors = error_.of(result.field.tiles, run, progress);
    std::visit([&](auto& tiles) { keep_common_boxes(result.field.outline.basis, tiles); },
               result.field.tiles);
    return result;
  }

  const ReflectanceField& field_;
  double allowed_;  // squared
  std::vector<ProbeLights> probes_;
  ErrorOfPacked error_;
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
      outline.output_from_primaries = field.output_from_primaries;
      outline.observed_light = field.observed_light;
      return std::move(*result);
    }
  throw InputError("weights of 16 bits leave an error of ", formatted("%.1e", search.least_error()),
                   " already; allow a larger error");
}

PackedField pack_rows(FieldRows rows, int bits, const RunContext& run) {
  PackedField packed;
  packed.tiles = tile_transfer(rows, bits, run);
  packed.outline = std::move(rows.outline);
  return packed;
}

}  // namespace refield
