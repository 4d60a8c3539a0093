// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate_band.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "core/interrupt.h"
#include "estimate/spatial_correction.h"

namespace refield {

namespace {

/// Pixels are visited in tiles of this side: neighbours walk nearly the same tree, so the columns stay in
/// cache.
constexpr int tile_side_px = 16;

std::vector<Tile> tiles_of(int width, RowRange rows) {
  std::vector<Tile> tiles;
  for (int y = rows.first; y < rows.last; y += tile_side_px)
    for (int x = 0; x < width; x += tile_side_px)
      tiles.push_back({x, y, std::min(x + tile_side_px, width), std::min(y + tile_side_px, rows.last)});
  return tiles;
}

void keep_within_limit(KernelCache& cache) {
  if (cache.bytes() > cache_limit_bytes) cache.clear();
}

}  // namespace

RowRange rows_needed(RowRange wanted, int height, const EstimateOptions& options) {
  return {std::max(wanted.first - options.spatial_passes, 0),
          std::min(wanted.last + options.spatial_passes, height)};
}

std::vector<PixelKernels> estimate_band(const BoxTable& table, const ObservationBand& band, RowRange wanted,
                                        const Mask& mask, const EstimateOptions& options, FitWorkers& workers,
                                        Progress& progress) {
  const int width = band.width();
  const RowRange held{band.first_row(), band.last_row()};
  const auto active = [&](int x, int y) {
    return mask.empty() || mask[static_cast<std::size_t>(y) * width + x] != 0;
  };
  const auto samples = [&](int x, int y) {
    return PixelSamples{band.samples(x, y, 0), band.samples(x, y, 1), band.samples(x, y, 2)};
  };
  const auto worker = [&]() -> FitWorker& {
    auto& own = workers.local();
    if (!own) own = std::make_unique<FitWorker>(table, options);
    keep_within_limit(own->cache);
    return *own;
  };
  const auto at = [&](int x, int y) { return static_cast<std::size_t>(y - held.first) * width + x; };
  std::vector<PixelKernels> kernels(static_cast<std::size_t>(width) * (held.last - held.first));

  const auto for_each_tile = [&](RowRange rows, const auto& work) {
    const auto tiles = tiles_of(width, rows);
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      throw_if_interrupted();
      work(tiles[i], worker());
    });
  };

  for_each_tile(held, [&](const Tile& tile, FitWorker& own) {
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        if (active(x, y)) {
          kernels[at(x, y)] = own.tree.fit(samples(x, y));
          keep_within_limit(own.cache);  // pixels that share little fill it within a tile
        }
    progress.advance(static_cast<std::uint64_t>(tile.x1 - tile.x0) * (tile.y1 - tile.y0));
  });

  for (int pass = 1; pass <= options.spatial_passes; ++pass) {
    // What lies beyond the band's overlap is not known; the rows that would need it are no longer asked for.
    const int left = options.spatial_passes - pass;
    const RowRange rows = {std::max(wanted.first - left, held.first),
                           std::min(wanted.last + left, held.last)};
    const PixelGrid grid{width,
                         held.first,
                         held.last,
                         samples,
                         [&](int x, int y) -> const PixelKernels& { return kernels[at(x, y)]; },
                         active};
    std::vector<PixelKernels> next(kernels.size());
    for_each_tile(rows, [&](const Tile& tile, FitWorker& own) {
      auto corrected = correct_tile(grid, tile, options.mode, own.cache, own.weights);
      std::size_t i = 0;
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) next[at(x, y)] = std::move(corrected[i++]);
    });
    kernels = std::move(next);
  }

  std::vector<PixelKernels> result(static_cast<std::size_t>(width) * (wanted.last - wanted.first));
  for_each_tile(wanted, [&](const Tile& tile, FitWorker& own) {
    MaskedSamples masked;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x) {
        if (!active(x, y)) continue;
        const PixelKernels& found = kernels[at(x, y)];
        masked.assign(samples(x, y), table.stride(), table.images());
        result[static_cast<std::size_t>(y - wanted.first) * width + x] =
            own.weights.fit(prepare_kernel_set(found.boxes, own.cache), masked, found.weights);
      }
  });
  return result;
}

}  // namespace refield
