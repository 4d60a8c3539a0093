// SPDX-License-Identifier: Apache-2.0
#include "core/field/transfer_tiles.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <cstring>

#include "core/field_io/packed_field.h"

namespace refield {

namespace {

constexpr std::size_t arrays_of_tile = 12;
using Lengths = std::array<std::uint32_t, arrays_of_tile>;

constexpr std::size_t whole_words(std::size_t bytes) {
  return (bytes + 7) / 8 * 8;
}

}  // namespace

template <class Weight>
void append_tile(const TileArrays<Weight, Vector>& tile, std::vector<std::byte>& memory) {
  std::size_t at = memory.size(), array = 0;
  std::size_t size = whole_words(sizeof(Lengths));
  Lengths lengths{};
  for_each_array(tile, [&](const auto& values) {
    lengths[array++] = static_cast<std::uint32_t>(values.size());
    size += whole_words(values.size() * sizeof(values[0]));
  });
  memory.resize(at + (size + cache_line_bytes - 1) / cache_line_bytes * cache_line_bytes);
  std::memcpy(memory.data() + at, &lengths, sizeof lengths);
  at += whole_words(sizeof lengths);
  for_each_array(tile, [&](const auto& values) {
    const std::size_t bytes = values.size() * sizeof(values[0]);
    if (bytes > 0) std::memcpy(memory.data() + at, values.data(), bytes);
    at += whole_words(bytes);
  });
}

template <class Weight>
const std::byte* TiledTransfer<Weight>::begin_of(int at) const {
  const auto of_band = static_cast<std::size_t>(tiles_across()) * band_rows;
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  return band.memory.data() + band.start[static_cast<std::size_t>(at) % of_band];
}

template <class Weight>
Tile<Weight> TiledTransfer<Weight>::tile(int at) const {
  const std::byte* next = begin_of(at);
  Lengths lengths;
  std::memcpy(&lengths, next, sizeof lengths);
  next += whole_words(sizeof lengths);
  Tile<Weight> tile;
  std::size_t array = 0;
  for_each_array(tile, [&](auto& values) {
    using Value = typename std::remove_reference_t<decltype(values)>::element_type;
    values = {reinterpret_cast<Value*>(next), lengths[array++]};
    next += whole_words(values.size_bytes());
  });
  return tile;
}

template <class Weight>
void TiledTransfer<Weight>::prefetch_for_change(int at) const {
  if (at >= tiles()) return;
  const auto of_band = static_cast<std::size_t>(tiles_across()) * band_rows;
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::size_t tile = static_cast<std::size_t>(at) % of_band;
  const std::byte* begin = band.memory.data() + band.start[tile];
  const std::byte* end = begin + band.change_until[tile];
  for (const std::byte* line = begin; line < end; line += cache_line_bytes) __builtin_prefetch(line);
}

template <class Weight>
std::size_t TiledTransfer<Weight>::bytes() const {
  std::size_t sum = common.size() * sizeof(common[0]);
  for (const Band& band : bands) sum += band.memory.size();
  return sum;
}

template <class Weight>
void TiledTransfer<Weight>::mark_parts() {
  int at = 0;
  for (Band& band : bands)
    for (std::size_t i = 0; i + 1 < band.start.size(); ++i) {
      const Tile<Weight> marked = tile(at++);
      const std::byte* begin = band.memory.data() + band.start[i];
      band.change_until.push_back(
          static_cast<std::uint32_t>(reinterpret_cast<const std::byte*>(marked.group.data()) - begin));
    }
}

template <class Weight>
std::uint64_t TiledTransfer<Weight>::bytes_stated(int at) const {
  Lengths lengths;
  std::memcpy(&lengths, begin_of(at), sizeof lengths);
  std::uint64_t bytes = whole_words(sizeof lengths);
  std::size_t array = 0;
  const Tile<Weight> none;
  for_each_array(none,
                 [&](const auto& values) { bytes += whole_words(lengths[array++] * sizeof(values[0])); });
  return bytes;
}

template void append_tile(const TileArrays<std::uint8_t, Vector>&, std::vector<std::byte>&);
template void append_tile(const TileArrays<std::uint16_t, Vector>&, std::vector<std::byte>&);
template struct TiledTransfer<std::uint8_t>;
template struct TiledTransfer<std::uint16_t>;

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
