// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/tiled_transfer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <numeric>
#include <tuple>

namespace refield {

namespace {

constexpr std::uint32_t not_common = std::numeric_limits<std::uint32_t>::max();

/// Finds the kernels that several tiles have. Hats all count as such.
class CommonKernels {
 public:
  explicit CommonKernels(const LightBasis& basis) : basis_(basis), owner_(basis.size(), 0) {}

  /// Looks at rows of the picture, from its tile row `first_tile_row` on. Runs on all cores.
  void add(const ReflectanceField& rows, int first_tile_row);
  /// [basis functions]: place among the common kernels, listed in `common`, or not_common.
  std::vector<std::uint32_t> places(std::vector<std::uint32_t>& common) const;

 private:
  const LightBasis& basis_;
  std::vector<std::uint32_t> owner_;  // [basis functions]: 0, the only tile that has it + 1, or `several`
};

/// What one thread needs to lay out one tile after another.
struct TileWorkshop {
  /// A kernel of the tile at hand.
  struct Kernel {
    std::uint32_t number = 0;  // in the basis
    std::uint32_t key = 0;     // in `place`
    bool negative = false;     // its scales are
    bool own = false;
    bool repeated = false;  // a pixel has it more than once
    std::uint32_t last_pixel = not_common;
    std::uint32_t uses = 0;  // in sparse form
    Box support;
    std::uint32_t on_map = 0;                    // where it lies, for the order of kernels
    std::uint32_t entries[groups_of_tile] = {};  // of each group
    std::uint32_t record[groups_of_tile] = {};   // of its dense weights, where a group has them
    float largest = 0.0f;                        // of its sparse weights
    std::uint32_t next_sparse = 0;
    bool dense(int group) const;
  };
  /// [2 × basis functions], of a kernel in `kernels`: of the positive weights of each, then of the negative.
  std::vector<std::uint32_t> place;
  std::vector<Kernel> kernels;       // by first appearance
  std::vector<std::uint32_t> order;  // of the tile's kernels, in `kernels`
};

/// From how many of its 16 pixels on a group's weights are dense: 48 weights then cost less time than as many
/// single ones of four.
constexpr std::uint32_t least_dense_pixels = 5;

/// Where a box' centre lies on a Z-curve (Morton 1966): bits of x and y in turn.
std::uint32_t place_on_curve(const Box& box) {
  const auto apart = [](int sum) {
    auto bits = static_cast<std::uint32_t>(sum / 2);
    bits = (bits | bits << 8) & 0x00ff00ffu;
    bits = (bits | bits << 4) & 0x0f0f0f0fu;
    bits = (bits | bits << 2) & 0x33333333u;
    return (bits | bits << 1) & 0x55555555u;
  };
  return apart(box.x0 + box.x1) | apart(box.y0 + box.y1) << 1;
}

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

constexpr std::uint32_t no_tile = 0, several = std::numeric_limits<std::uint32_t>::max();

bool TileWorkshop::Kernel::dense(int group) const {
  return !repeated && entries[group] >= least_dense_pixels;
}

void CommonKernels::add(const ReflectanceField& rows, int first_tile_row) {
  const int across = (rows.width + tile_side_px - 1) / tile_side_px;
  const int tiles = across * ((rows.height + tile_side_px - 1) / tile_side_px);
  tbb::parallel_for(0, tiles, [&](int tile) {
    const auto self = static_cast<std::uint32_t>(first_tile_row * across + tile) + 1;
    for_each_pixel(rows, tile % across, tile / across, [&](int, std::size_t row) {
      for (auto e = rows.transfer.row_start[row]; e < rows.transfer.row_start[row + 1]; ++e) {
        std::atomic_ref<std::uint32_t> owned(owner_[rows.transfer.column[e]]);
        std::uint32_t before = owned.load(std::memory_order_relaxed);
        if (before == self || before == several) continue;
        if (before == no_tile && owned.compare_exchange_strong(before, self, std::memory_order_relaxed))
          continue;
        if (before != self) owned.store(several, std::memory_order_relaxed);
      }
    });
  });
}

std::vector<std::uint32_t> CommonKernels::places(std::vector<std::uint32_t>& common) const {
  std::vector<std::uint32_t> place(owner_.size(), not_common);
  for (std::uint32_t k = 0; k < place.size(); ++k) {
    if (owner_[k] != several && !basis_.is_smooth(k)) continue;
    place[k] = static_cast<std::uint32_t>(common.size());
    common.push_back(k);
  }
  return place;
}

/// Lays out one tile. Whole numbers have no sign: a kernel's negative weights are those of a
/// second kernel of the same support whose scale is negative.
template <class Weight>
class TileLayout {
 public:
  static constexpr float steps = std::numeric_limits<Weight>::max();

  TileLayout(const ReflectanceField& field, const std::vector<std::uint32_t>& common_place, int tile_x,
             int tile_y, TileWorkshop& shop)
      : field_(field), common_place_(common_place), tile_x_(tile_x), tile_y_(tile_y), shop_(shop) {
    collect();
    arrange();
    scale();
    round();
    for (const auto& kernel : shop_.kernels) shop_.place[kernel.key] = not_common;
  }
  TileArrays<Weight, Vector> tile;

 private:
  /// Calls visit(pixel, key, magnitudes of the weights): an entry with both signs comes once for each.
  template <class Visit>
  void for_each_entry(const Visit& visit) {
    for_each_pixel(field_, tile_x_, tile_y_, [&](int pixel, std::size_t row) {
      for (auto e = field_.transfer.row_start[row]; e < field_.transfer.row_start[row + 1]; ++e) {
        const std::uint32_t number = field_.transfer.column[e];
        const float* weight = field_.transfer.weight.data() + 3 * e;
        if (weight[0] >= 0.0f && weight[1] >= 0.0f && weight[2] >= 0.0f) {
          visit(pixel, number, weight);
          continue;
        }
        float above[3], below[3];
        for (int c = 0; c < 3; ++c) {
          above[c] = std::max(weight[c], 0.0f);
          below[c] = std::max(-weight[c], 0.0f);
        }
        if (above[0] > 0.0f || above[1] > 0.0f || above[2] > 0.0f) visit(pixel, number, above);
        visit(pixel, number + static_cast<std::uint32_t>(field_.basis.size()), below);
      }
    });
  }

  void collect() {
    shop_.place.resize(2 * field_.basis.size(), not_common);
    shop_.kernels.clear();
    for_each_entry([&](int pixel, std::uint32_t key, const float* weight) {
      grey_ = grey_ && weight[0] == weight[1] && weight[1] == weight[2];
      std::uint32_t& place = shop_.place[key];
      if (place == not_common) {
        place = static_cast<std::uint32_t>(shop_.kernels.size());
        auto& added = shop_.kernels.emplace_back();
        added.key = key;
        added.negative = key >= field_.basis.size();
        added.number = added.negative ? key - static_cast<std::uint32_t>(field_.basis.size()) : key;
        added.own = common_place_[added.number] == not_common;
        added.support = field_.basis.support(added.number);
        added.on_map = added.own ? static_cast<std::uint32_t>(added.support.x0 + added.support.x1)
                                 : place_on_curve(added.support);
      }
      auto& kernel = shop_.kernels[place];
      ++kernel.entries[pixel / group_pixels];
      kernel.repeated = kernel.repeated || kernel.last_pixel == static_cast<std::uint32_t>(pixel);
      kernel.last_pixel = static_cast<std::uint32_t>(pixel);
    });
  }

  /// Kernels in order: common before own, then by number of sparse uses, then by where they lie, so that
  /// those which a changing part of the light touches lie together, and their weights, too: common ones along
  /// a Z-curve, a tile's own ones, which are few in any part of the light, from left to right.
  void arrange() {
    auto& kernels = shop_.kernels;
    for (auto& kernel : kernels)
      for (int g = 0; g < groups_of_tile; ++g)
        if (!kernel.dense(g)) kernel.uses += kernel.entries[g];
    shop_.order.resize(kernels.size());
    for (std::uint32_t i = 0; i < kernels.size(); ++i) shop_.order[i] = i;
    std::ranges::sort(shop_.order, [&](std::uint32_t a, std::uint32_t b) {
      const auto key = [&](std::uint32_t i) {
        return std::tuple(kernels[i].own, kernels[i].uses, kernels[i].on_map, i);
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
    tile.record_weight.resize(records * (grey_ ? 1 : 3) * group_pixels);
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
    for_each_entry([&](int pixel, std::uint32_t key, const float* weight) {
      auto& kernel = shop_.kernels[shop_.place[key]];
      const int g = pixel / group_pixels;
      float& largest = kernel.dense(g) ? tile.record_scale[kernel.record[g]] : kernel.largest;
      largest = std::max({largest, weight[0], weight[1], weight[2]});
    });
    for (float& largest : tile.record_scale) largest /= steps;
    tile.scale.reserve(shop_.order.size());
    for (const std::uint32_t i : shop_.order) {
      const auto& kernel = shop_.kernels[i];
      tile.scale.push_back((kernel.negative ? -kernel.largest : kernel.largest) / steps);
      for (int g = 0; kernel.negative && g < groups_of_tile; ++g)
        if (kernel.dense(g)) tile.record_scale[kernel.record[g]] *= -1.0f;
    }
  }

  static Weight rounded(float weight, float scale) {
    // Half a step up and down to the integer below: exact but for one value, and it vectorises.
    // NOLINTNEXTLINE(bugprone-incorrect-roundings)
    return scale > 0.0f ? static_cast<Weight>(std::min(weight / scale, steps) + 0.5f) : Weight{0};
  }

  void round() {
    for_each_entry([&](int pixel, std::uint32_t key, const float* weight) {
      auto& kernel = shop_.kernels[shop_.place[key]];
      const int g = pixel / group_pixels;
      if (kernel.dense(g)) {
        const std::uint32_t record = kernel.record[g];
        Weight* channels = tile.record_weight.data() + tile.record_size() * record;
        for (int c = 0; c < (grey_ ? 1 : 3); ++c)
          channels[c * group_pixels + pixel % group_pixels] =
              rounded(weight[c], std::abs(tile.record_scale[record]));
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
  TileWorkshop& shop_;
  bool grey_ = true;  // so far
};

void require_nameable(const LightDomain& domain) {
  if (domain.width > small_box_limit || domain.height > small_box_limit)
    throw InputError("the field's light map of ", domain.width, "×", domain.height,
                     " texels is larger than tiles can name (", small_box_limit,
                     "); use a smaller light map");
}

/// Lays out rows of tiles, each row as a task; calls `done` when the field's entries are no longer needed.
template <class Weight, class Done>
typename TiledTransfer<Weight>::Band lay_out_band(const ReflectanceField& field,
                                                  const std::vector<std::uint32_t>& common_place,
                                                  int first_row, int rows, int across,
                                                  tbb::enumerable_thread_specific<TileWorkshop>& workshops,
                                                  const Done& done) {
  std::vector<std::vector<std::byte>> tiles(static_cast<std::size_t>(rows) *
                                            static_cast<std::size_t>(across));
  tbb::parallel_for(0, rows, [&](int row) {
    for (int column = 0; column < across; ++column)
      append_tile(TileLayout<Weight>(field, common_place, column, first_row + row, workshops.local()).tile,
                  tiles[static_cast<std::size_t>(row) * across + column]);
  });
  done();
  typename TiledTransfer<Weight>::Band band;
  std::size_t size = 0;
  for (const auto& bytes : tiles) size += bytes.size();
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw InputError("the field holds too many weights per pixel for real-time display");
  band.memory.reserve(size);
  band.start.push_back(0);
  for (auto& bytes : tiles) {
    band.memory.insert(band.memory.end(), bytes.begin(), bytes.end());
    band.start.push_back(static_cast<std::uint32_t>(band.memory.size()));
    bytes = {};
  }
  return band;
}

template <class T>
void forget(FileVector<T>& values, std::uint64_t first, std::uint64_t last) {
  release_pages(values.data() + first, (last - first) * sizeof(T));
}

/// `count_kernels` adds all rows to CommonKernels, and returns false where they cannot be looked at before
/// they are laid out: then all kernels count as common. `for_each_band` calls visit(field, its first row of
/// tiles to be laid out, rows of tiles, what to do when its entries are no longer needed).
template <class Weight, class CountKernels, class ForEachBand>
TiledTransfer<Weight> lay_out(const FieldOutline& outline, const CountKernels& count_kernels,
                              const ForEachBand& for_each_band) {
  TiledTransfer<Weight> tiled{outline.width, outline.height, {}, {}};
  CommonKernels kernels(outline.basis);
  std::vector<std::uint32_t> place(outline.basis.size());
  if (count_kernels(kernels)) {
    place = kernels.places(tiled.common);
  } else {
    std::iota(place.begin(), place.end(), 0u);
    tiled.common = place;
  }
  tbb::enumerable_thread_specific<TileWorkshop> workshops;
  for_each_band([&](const ReflectanceField& field, int first_row, int rows, const auto& done) {
    tiled.bands.push_back(
        lay_out_band<Weight>(field, place, first_row, rows, tiled.tiles_across(), workshops, done));
  });
  tiled.mark_parts();
  return tiled;
}

template <class... Source>
TransferTiles lay_out_in(int bits, const Source&... source) {
  if (bits == 8) return lay_out<std::uint8_t>(source...);
  return lay_out<std::uint16_t>(source...);
}

/// Calls visit(first row of tiles, rows of tiles) for one band after another.
template <class Visit>
void for_bands(const FieldOutline& outline, const Visit& visit) {
  constexpr int band_rows = TiledTransfer<std::uint8_t>::band_rows;
  const int all = (outline.height + tile_side_px - 1) / tile_side_px;
  for (int row = 0; row < all; row += band_rows) visit(row, std::min(band_rows, all - row));
}

/// `used`: the field itself where it is given up as it is used.
TransferTiles tile_field(const ReflectanceField& field, ReflectanceField* used, int bits) {
  require_nameable(field.basis.domain);
  const auto entry_of = [&](int tile_row) {
    const int y = std::min(tile_row * tile_side_px, field.height);
    return field.transfer.row_start[static_cast<std::size_t>(y) * static_cast<std::size_t>(field.width)];
  };
  const auto count = [&](CommonKernels& kernels) {
    kernels.add(field, 0);
    return true;
  };
  return lay_out_in(bits, field, count, [&](const auto& lay_out_rows) {
    for_bands(field, [&](int row, int rows) {
      lay_out_rows(field, row, rows, [&] {
        if (used == nullptr) return;
        forget(used->transfer.column, entry_of(row), entry_of(row + rows));
        forget(used->transfer.weight, 3 * entry_of(row), 3 * entry_of(row + rows));
      });
    });
  });
}

}  // namespace

TransferTiles tile_transfer(const ReflectanceField& field, int bits) {
  return tile_field(field, nullptr, bits);
}

TransferTiles tile_transfer(ReflectanceField&& field, int bits) {
  TransferTiles tiled = tile_field(field, &field, bits);
  field.transfer = {};
  return tiled;
}

TransferTiles tile_transfer(const FieldRows& source, int bits, const RunContext& run) {
  const FieldOutline& outline = source.outline;
  require_nameable(outline.basis.domain);
  ReflectanceField band;  // some rows of the picture
  band.width = outline.width;
  band.basis = outline.basis;
  const auto for_each_band = [&](const auto& visit) {
    for_bands(outline, [&](int row, int rows) {
      run.throw_if_stopped();
      const RowRange range{row * tile_side_px, std::min(outline.height, (row + rows) * tile_side_px)};
      band.height = range.count();
      band.transfer = source.rows(range);
      visit(row, rows);
    });
  };
  const auto count = [&](CommonKernels& kernels) {
    if (source.repeatable) for_each_band([&](int row, int) { kernels.add(band, row); });
    return source.repeatable;
  };
  return lay_out_in(bits, outline, count, [&](const auto& lay_out_rows) {
    for_each_band([&](int, int rows) { lay_out_rows(band, 0, rows, [] {}); });
  });
}

}  // namespace refield
