// SPDX-License-Identifier: Apache-2.0
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "core/packed_field.h"

namespace refield {

namespace {

/// Looks at one tile; each check relies on those before it.
template <class Weight>
class TileCheck {
 public:
  TileCheck(const PackedField& packed, const TiledTransfer<Weight>& tiles, int at)
      : basis_(packed.outline.basis),
        tile_(tiles.tile(at)),
        columns_(std::min(tile_side_px, tiles.width - at % tiles.tiles_across() * tile_side_px)),
        rows_(std::min(tile_side_px, tiles.height - at / tiles.tiles_across() * tile_side_px)) {}

  const char* fault() const {
    if (!lengths_agree()) return "arrays whose lengths do not agree";
    if (!kernels_exist()) return "a kernel that does not exist or is outside the light map";
    if (!records_agree()) return "dense weights whose numbers do not agree";
    if (!pixels_exist()) return "a weight of a pixel outside the picture";
    if (!scales_are_numbers()) return "a scale that is not finite";
    return nullptr;
  }

 private:
  std::size_t kernels() const { return tile_.support.size(); }
  std::size_t records() const { return tile_.record_kernel.size(); }

  bool lengths_agree() const {
    if (tile_.common.size() > kernels() || tile_.scale.size() != kernels() ||
        tile_.dense_start.size() != tile_.dense_kernels.size() + 1 || tile_.places.size() != records() ||
        tile_.group.size() != groups_of_tile + 1 || tile_.record_scale.size() != records() ||
        tile_.record_weight.size() != records() * tile_.record_size())
      return false;
    std::uint64_t of_runs = 0, uses = 0;
    for (const KernelRun& run : tile_.runs) {
      of_runs += run.kernels;
      if (of_runs > kernels() || run.uses > tile_.sparse.size()) return false;
      uses += std::uint64_t{run.kernels} * run.uses;
      if (uses > tile_.sparse.size()) return false;
    }
    return of_runs == kernels() && uses == tile_.sparse.size();
  }

  bool kernels_exist() const {
    for (std::size_t k = 0; k < kernels(); ++k) {
      const SmallBox& small = tile_.support[k];
      const Box box = {small.x0, small.y0, small.x1, small.y1};
      if (!box.inside(basis_.domain.width, basis_.domain.height)) return false;
      if (k < tile_.common.size() &&
          (tile_.common[k] >= basis_.size() || basis_.support(tile_.common[k]) != box))
        return false;
    }
    return true;
  }

  bool records_agree() const {
    const auto& kernels_of = tile_.dense_kernels;
    const auto rises = [&](const auto& from) {
      return from.front() == 0 && from.back() == records() && std::ranges::is_sorted(from);
    };
    if (!rises(tile_.dense_start) || !rises(tile_.group)) return false;
    for (std::size_t d = 0; d < kernels_of.size(); ++d) {
      if (kernels_of[d] >= kernels() || (d > 0 && kernels_of[d] <= kernels_of[d - 1])) return false;
      for (std::size_t i = tile_.dense_start[d]; i < tile_.dense_start[d + 1]; ++i) {
        const std::uint32_t record = tile_.places[i] / groups_of_tile, g = tile_.places[i] % groups_of_tile;
        // That the records of a kernel rise makes each of them occur once.
        if (record >= records() || tile_.record_kernel[record] != d || record < tile_.group[g] ||
            record >= tile_.group[g + 1] ||
            (i > tile_.dense_start[d] && tile_.places[i] <= tile_.places[i - 1]))
          return false;
      }
    }
    return true;
  }

  bool pixels_exist() const {
    return std::ranges::all_of(tile_.sparse, [&](const SparseWeights<Weight>& weights) {
      return weights.pixel < tile_pixels && column_of_tile(weights.pixel) < columns_ &&
             row_of_tile(weights.pixel) < rows_;
    });
  }

  bool scales_are_numbers() const {
    const auto sound = [](float scale) {
      return std::isfinite(scale * static_cast<float>(std::numeric_limits<Weight>::max()));
    };
    return std::ranges::all_of(tile_.scale, sound) && std::ranges::all_of(tile_.record_scale, sound);
  }

  const LightBasis& basis_;
  Tile<Weight> tile_;
  int columns_, rows_;
};

template <class Weight>
std::string fault_of(const PackedField& packed, const TiledTransfer<Weight>& tiles) {
  const auto of_band = static_cast<std::size_t>(tiles.tiles_across()) * tiles.band_rows;
  std::atomic<int> first_fault = tiles.tiles();
  const auto fault_at = [&](int at) -> const char* {
    const auto& band = tiles.bands[static_cast<std::size_t>(at) / of_band];
    const std::size_t i = static_cast<std::size_t>(at) % of_band;
    if (band.start[i] >= band.start[i + 1]) return "no arrays";
    // Filled up to a whole cache line, and no further.
    const std::uint64_t stated = tiles.bytes_stated(at), bytes = band.start[i + 1] - band.start[i];
    if (stated > bytes || stated + cache_line_bytes <= bytes)
      return "arrays that are longer or shorter than itself";
    return TileCheck<Weight>(packed, tiles, at).fault();
  };
  tbb::parallel_for(0, tiles.tiles(), [&](int at) {
    if (at > first_fault.load() || fault_at(at) == nullptr) return;
    int before = first_fault.load();
    while (at < before && !first_fault.compare_exchange_weak(before, at)) {
    }
  });
  const int at = first_fault.load();
  if (at == tiles.tiles()) return "";
  return "tile " + std::to_string(at) + " holds " + fault_at(at);
}

}  // namespace

std::string fault_of_tiles(const PackedField& packed) {
  return std::visit([&](const auto& tiles) { return fault_of(packed, tiles); }, packed.tiles);
}

}  // namespace refield
