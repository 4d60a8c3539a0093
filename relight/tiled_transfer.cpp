// SPDX-License-Identifier: Apache-2.0
#include "relight/tiled_transfer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <tuple>

#include "core/errors.h"

namespace refield {

namespace {

/// From how many of its 16 pixels on a group's weights are dense: 48 weights then cost less time than as many
/// single ones of four.
constexpr int least_dense_pixels = 5;

/// Calls visit(pixel of the tile, row of the transfer) for a tile's pixels, group by group.
template <class Visit>
void for_each_pixel(const ReflectanceField& field, int tile_x, int tile_y, const Visit& visit) {
  for (int group = 0; group < groups_of_tile; ++group)
    for (int i = 0; i < group_pixels; ++i) {
      constexpr int across = tile_side_px / group_side_px;
      const int x = tile_x * tile_side_px + group % across * group_side_px + i % group_side_px;
      const int y = tile_y * tile_side_px + group / across * group_side_px + i / group_side_px;
      if (x < field.width && y < field.height)
        visit(group * group_pixels + i, static_cast<std::size_t>(y) * field.width + x);
    }
}

/// Kernels that more than one tile has: [basis functions], not zero for those. Hats all count as such.
std::vector<std::uint32_t> shared_by_tiles(const ReflectanceField& field, int across, int tiles) {
  constexpr std::uint32_t nobody = 0, several = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> owner(field.basis.size(), nobody);
  tbb::parallel_for(0, tiles, [&](int tile) {
    const auto self = static_cast<std::uint32_t>(tile) + 1;
    for_each_pixel(field, tile % across, tile / across, [&](int, std::size_t row) {
      for (auto e = field.transfer.row_start[row]; e < field.transfer.row_start[row + 1]; ++e) {
        std::atomic_ref<std::uint32_t> owned(owner[field.transfer.column[e]]);
        std::uint32_t before = owned.load(std::memory_order_relaxed);
        if (before == self || before == several) continue;
        if (before == nobody && owned.compare_exchange_strong(before, self, std::memory_order_relaxed))
          continue;
        if (before != self) owned.store(several, std::memory_order_relaxed);
      }
    });
  });
  for (std::size_t k = 0; k < owner.size(); ++k)
    owner[k] = owner[k] == several || field.basis.is_hat(k) ? 1 : 0;
  return owner;
}

/// What one thread needs to lay out one tile after another.
struct Workshop {
  static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

  /// A kernel of the tile at hand.
  struct Kernel {
    std::uint32_t number = 0;  // in the basis
    bool own = false;
    std::uint32_t uses = 0;  // in sparse form
    Box support;
    std::uint8_t pixels[groups_of_tile] = {};   // of each group that have it
    std::uint32_t record[groups_of_tile] = {};  // of its dense weights, where a group has them
    float largest = 0.0f;                       // of its sparse weights
    std::uint32_t next_sparse = 0;
    bool dense(int group) const { return pixels[group] >= least_dense_pixels; }
  };
  std::vector<std::uint32_t> place;  // [basis functions], of a kernel in `kernels`
  std::vector<Kernel> kernels;       // by first appearance
  std::vector<std::uint32_t> order;  // of the tile's kernels, in `kernels`
};

template <class Weight>
class TileLayout {
 public:
  static constexpr float steps = std::numeric_limits<Weight>::max();

  TileLayout(const ReflectanceField& field, const std::vector<std::uint32_t>& common_place, int tile_x,
             int tile_y, Workshop& shop)
      : field_(field), common_place_(common_place), tile_x_(tile_x), tile_y_(tile_y), shop_(shop) {
    collect();
    arrange();
    scale();
    round();
    for (const auto& kernel : shop_.kernels) shop_.place[kernel.number] = Workshop::none;
  }
  TileArrays<Weight, Vector> tile;

 private:
  template <class Visit>
  void for_each_entry(const Visit& visit) {
    for_each_pixel(field_, tile_x_, tile_y_, [&](int pixel, std::size_t row) {
      for (auto e = field_.transfer.row_start[row]; e < field_.transfer.row_start[row + 1]; ++e)
        visit(pixel, field_.transfer.column[e], field_.transfer.weight.data() + 3 * e);
    });
  }

  void collect() {
    shop_.place.resize(field_.basis.size(), Workshop::none);
    shop_.kernels.clear();
    for_each_entry([&](int pixel, std::uint32_t number, const float*) {
      std::uint32_t& place = shop_.place[number];
      if (place == Workshop::none) {
        place = static_cast<std::uint32_t>(shop_.kernels.size());
        auto& kernel = shop_.kernels.emplace_back();
        kernel.number = number;
        kernel.own = common_place_[number] == Workshop::none;
        kernel.support = field_.basis.support(number);
      }
      ++shop_.kernels[place].pixels[pixel / group_pixels];
    });
  }

  /// Kernels in order: common before own, then by number of sparse uses, then from left to right, so that
  /// those which a changing part of the light touches lie together.
  void arrange() {
    auto& kernels = shop_.kernels;
    for (auto& kernel : kernels)
      for (int g = 0; g < groups_of_tile; ++g)
        if (!kernel.dense(g)) kernel.uses += kernel.pixels[g];
    shop_.order.resize(kernels.size());
    for (std::uint32_t i = 0; i < kernels.size(); ++i) shop_.order[i] = i;
    std::ranges::sort(shop_.order, [&](std::uint32_t a, std::uint32_t b) {
      const auto key = [&](std::uint32_t i) {
        return std::tuple(kernels[i].own, kernels[i].uses, kernels[i].support.x0 + kernels[i].support.x1, i);
      };
      return key(a) < key(b);
    });
    std::uint32_t sparse = 0;
    tile.group.assign(groups_of_tile + 1, 0);
    tile.support.reserve(kernels.size());
    for (std::uint32_t at = 0; at < shop_.order.size(); ++at) {
      auto& kernel = kernels[shop_.order[at]];
      const Box& box = kernel.support;
      tile.support.push_back({static_cast<std::int16_t>(box.x0), static_cast<std::int16_t>(box.y0),
                              static_cast<std::int16_t>(box.x1), static_cast<std::int16_t>(box.y1)});
      if (!kernel.own) tile.common.push_back(common_place_[kernel.number]);
      if (tile.runs.empty() || tile.runs.back().uses != kernel.uses) tile.runs.push_back({0, kernel.uses});
      ++tile.runs.back().kernels;
      kernel.next_sparse = sparse;
      sparse += kernel.uses;
      for (int g = 0; g < groups_of_tile; ++g) tile.group[g + 1] += kernel.dense(g);
    }
    tile.sparse.resize(sparse);
    number_records();
  }

  void number_records() {
    for (int g = 0; g < groups_of_tile; ++g) tile.group[g + 1] += tile.group[g];
    const std::size_t records = tile.group[groups_of_tile];
    tile.record_kernel.resize(records);
    tile.record_scale.resize(records);
    tile.record_weight.resize(records * 3 * group_pixels);
    tile.dense_start.push_back(0);
    std::vector<std::uint32_t> next = tile.group;
    for (std::uint32_t at = 0; at < shop_.order.size(); ++at) {
      auto& kernel = shop_.kernels[shop_.order[at]];
      bool any = false;
      for (int g = 0; g < groups_of_tile; ++g) {
        if (!kernel.dense(g)) continue;
        any = true;
        kernel.record[g] = next[g]++;
        tile.record_kernel[kernel.record[g]] = static_cast<std::uint32_t>(tile.dense_kernels.size());
        tile.places.push_back(kernel.record[g] * groups_of_tile + static_cast<std::uint32_t>(g));
      }
      if (!any) continue;
      tile.dense_kernels.push_back(at);
      tile.dense_start.push_back(static_cast<std::uint32_t>(tile.places.size()));
    }
  }

  void scale() {
    for_each_entry([&](int pixel, std::uint32_t number, const float* weight) {
      auto& kernel = shop_.kernels[shop_.place[number]];
      const int g = pixel / group_pixels;
      float& largest = kernel.dense(g) ? tile.record_scale[kernel.record[g]] : kernel.largest;
      largest = std::max({largest, weight[0], weight[1], weight[2]});
    });
    for (float& largest : tile.record_scale) largest /= steps;
    tile.scale.reserve(shop_.order.size());
    for (const std::uint32_t i : shop_.order) tile.scale.push_back(shop_.kernels[i].largest / steps);
  }

  static Weight rounded(float weight, float scale) {
    return scale > 0.0f ? static_cast<Weight>(std::lround(std::min(weight / scale, steps))) : Weight{0};
  }

  void round() {
    for_each_entry([&](int pixel, std::uint32_t number, const float* weight) {
      auto& kernel = shop_.kernels[shop_.place[number]];
      const int g = pixel / group_pixels;
      if (kernel.dense(g)) {
        const std::uint32_t record = kernel.record[g];
        Weight* channels = tile.record_weight.data() + std::size_t{3} * group_pixels * record;
        for (int c = 0; c < 3; ++c)
          channels[c * group_pixels + pixel % group_pixels] = rounded(weight[c], tile.record_scale[record]);
      } else {
        auto& entry = tile.sparse[kernel.next_sparse++];
        for (int c = 0; c < 3; ++c) entry.channel[c] = rounded(weight[c], kernel.largest / steps);
        entry.pixel = static_cast<Weight>(pixel);
      }
    });
  }

  const ReflectanceField& field_;
  const std::vector<std::uint32_t>& common_place_;
  int tile_x_, tile_y_;
  Workshop& shop_;
};

/// Calls visit(array) for each of a tile's arrays, always in this order.
template <class Arrays, class Visit>
void for_each_array(Arrays& arrays, const Visit& visit) {
  visit(arrays.support);
  visit(arrays.dense_kernels);
  visit(arrays.dense_start);
  visit(arrays.places);
  visit(arrays.runs);
  visit(arrays.group);
  visit(arrays.record_kernel);
  visit(arrays.common);
  visit(arrays.scale);
  visit(arrays.sparse);
  visit(arrays.record_scale);
  visit(arrays.record_weight);
}
constexpr std::size_t arrays_of_tile = 12;
constexpr std::size_t cache_line = 64;
using Lengths = std::array<std::uint32_t, arrays_of_tile>;

constexpr std::size_t whole_words(std::size_t bytes) {
  return (bytes + 7) / 8 * 8;
}

/// Appends a tile to a piece of memory.
template <class Weight>
void append(const TileArrays<Weight, Vector>& tile, std::vector<std::byte>& memory) {
  std::size_t at = memory.size(), array = 0;
  std::size_t size = whole_words(sizeof(Lengths));
  Lengths lengths{};
  for_each_array(tile, [&](const auto& values) {
    lengths[array++] = static_cast<std::uint32_t>(values.size());
    size += whole_words(values.size() * sizeof(values[0]));
  });
  memory.resize(at + (size + cache_line - 1) / cache_line * cache_line);
  std::memcpy(memory.data() + at, &lengths, sizeof lengths);
  at += whole_words(sizeof lengths);
  for_each_array(tile, [&](const auto& values) {
    const std::size_t bytes = values.size() * sizeof(values[0]);
    if (bytes > 0) std::memcpy(memory.data() + at, values.data(), bytes);
    at += whole_words(bytes);
  });
}

}  // namespace

template <class Weight>
Tile<Weight> TiledTransfer<Weight>::tile(int at) const {
  const auto of_band = static_cast<std::size_t>(tiles_across() * band_rows);
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::byte* next = band.memory.data() + band.start[static_cast<std::size_t>(at) % of_band];
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
void TiledTransfer<Weight>::prefetch(int at, bool head_only) const {
  if (at >= tiles()) return;
  const auto of_band = static_cast<std::size_t>(tiles_across() * band_rows);
  const Band& band = bands[static_cast<std::size_t>(at) / of_band];
  const std::size_t tile = static_cast<std::size_t>(at) % of_band;
  const std::byte* begin = band.memory.data() + band.start[tile];
  const std::byte* end = head_only ? begin + band.head[tile] : band.memory.data() + band.start[tile + 1];
  for (const std::byte* line = begin; line < end; line += cache_line) __builtin_prefetch(line);
}

template <class Weight>
std::size_t TiledTransfer<Weight>::bytes() const {
  std::size_t sum = common.size() * sizeof(common[0]);
  for (const Band& band : bands) sum += band.memory.size();
  return sum;
}

namespace {

void require_nameable(const LightDomain& domain) {
  if (domain.width > small_box_limit || domain.height > small_box_limit)
    throw InputError("the field's light map of " + std::to_string(domain.width) + "×" +
                     std::to_string(domain.height) + " texels is larger than tiles can name (" +
                     std::to_string(small_box_limit) + "); use a smaller light map");
}

/// Lays out rows of tiles, each row as a task.
template <class Weight>
typename TiledTransfer<Weight>::Band lay_out_band(const ReflectanceField& field,
                                                  const std::vector<std::uint32_t>& common_place,
                                                  int first_row, int rows, int across,
                                                  tbb::enumerable_thread_specific<Workshop>& workshops) {
  std::vector<std::vector<std::byte>> memory(static_cast<std::size_t>(rows));
  std::vector<std::vector<std::uint32_t>> ends(static_cast<std::size_t>(rows));
  tbb::parallel_for(0, rows, [&](int row) {
    auto& bytes = memory[static_cast<std::size_t>(row)];
    for (int column = 0; column < across; ++column) {
      append(TileLayout<Weight>(field, common_place, column, first_row + row, workshops.local()).tile, bytes);
      ends[static_cast<std::size_t>(row)].push_back(static_cast<std::uint32_t>(bytes.size()));
    }
  });
  typename TiledTransfer<Weight>::Band band;
  std::size_t size = 0;
  for (const auto& bytes : memory) size += bytes.size();
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw InputError("the field holds too many weights a pixel to be shown in real time");
  band.memory.reserve(size);
  band.start.push_back(0);
  for (int row = 0; row < rows; ++row) {
    const auto before = static_cast<std::uint32_t>(band.memory.size());
    auto& bytes = memory[static_cast<std::size_t>(row)];
    band.memory.insert(band.memory.end(), bytes.begin(), bytes.end());
    for (const std::uint32_t end : ends[static_cast<std::size_t>(row)]) band.start.push_back(before + end);
    bytes = {};
  }
  return band;
}

template <class T>
void forget(std::vector<T>& values, std::uint64_t first, std::uint64_t last) {
  forget_pages(values.data() + first, (last - first) * sizeof(T));
}

/// `used`: the field itself where it is given up as it is used.
template <class Weight>
TiledTransfer<Weight> lay_out(const ReflectanceField& field, ReflectanceField* used) {
  require_nameable(field.basis.domain);
  TiledTransfer<Weight> tiled{field.width, field.height, {}, {}};
  const int across = tiled.tiles_across();
  std::vector<std::uint32_t> common_place = shared_by_tiles(field, across, tiled.tiles());
  for (std::uint32_t k = 0; k < common_place.size(); ++k) {
    const bool common = common_place[k] != 0;
    common_place[k] = common ? static_cast<std::uint32_t>(tiled.common.size()) : Workshop::none;
    if (common) tiled.common.push_back(k);
  }
  tbb::enumerable_thread_specific<Workshop> workshops;
  constexpr int band_rows = TiledTransfer<Weight>::band_rows;
  for (int row = 0; row < tiled.tiles_down(); row += band_rows) {
    const int rows = std::min(band_rows, tiled.tiles_down() - row);
    auto& band =
        tiled.bands.emplace_back(lay_out_band<Weight>(field, common_place, row, rows, across, workshops));
    for (int at = row * across; at < (row + rows) * across; ++at) {
      const auto* first = reinterpret_cast<const std::byte*>(tiled.tile(at).group.data());
      const std::byte* begin = band.memory.data() + band.start[static_cast<std::size_t>(at - row * across)];
      band.head.push_back(static_cast<std::uint32_t>(first - begin));
    }
    if (used == nullptr) continue;
    const auto entry_of = [&](int tile_row) {
      const int y = std::min(tile_row * tile_side_px, field.height);
      return field.transfer.row_start[static_cast<std::size_t>(y) * static_cast<std::size_t>(field.width)];
    };
    forget(used->transfer.column, entry_of(row), entry_of(row + rows));
    forget(used->transfer.weight, 3 * entry_of(row), 3 * entry_of(row + rows));
  }
  return tiled;
}

}  // namespace

template <class Weight>
TiledTransfer<Weight> tile_transfer(const ReflectanceField& field) {
  return lay_out<Weight>(field, nullptr);
}

template <class Weight>
TiledTransfer<Weight> tile_transfer(ReflectanceField&& field) {
  auto tiled = lay_out<Weight>(field, &field);
  field.transfer = {};
  return tiled;
}

template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(const ReflectanceField&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(const ReflectanceField&);
template TiledTransfer<std::uint8_t> tile_transfer<std::uint8_t>(ReflectanceField&&);
template TiledTransfer<std::uint16_t> tile_transfer<std::uint16_t>(ReflectanceField&&);
template struct TiledTransfer<std::uint8_t>;
template struct TiledTransfer<std::uint16_t>;

}  // namespace refield
