// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/estimate_band.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "core/base/run_context.h"
#include "estimate/fit/spatial_correction.h"

namespace refield {

namespace {

/// Pixels are visited in tiles of this side: neighbours walk nearly the same tree, so the columns stay in
/// cache.
constexpr int fit_tile_px = 16;

std::vector<PixelTile> tiles_of(int width, RowRange rows) {
  std::vector<PixelTile> tiles;
  for (int y = rows.first; y < rows.last; y += fit_tile_px)
    for (int x = 0; x < width; x += fit_tile_px)
      tiles.push_back({x, y, std::min(x + fit_tile_px, width), std::min(y + fit_tile_px, rows.last)});
  return tiles;
}

/// Samples of a tile's pixels; null pointers for those outside the mask.
std::vector<PixelSamples> samples_of(const PixelTile& tile,
                                     const std::function<PixelSamples(int, int)>& samples,
                                     const std::function<bool(int, int)>& active) {
  std::vector<PixelSamples> result;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x) result.push_back(active(x, y) ? samples(x, y) : PixelSamples{});
  return result;
}

/// Fills in what a band's final kernels tell about their own error. Looks along rows only, so that no result
/// depends on where the band begins.
struct EvidenceGatherer {
  const BoxTable& table;
  const std::function<PixelSamples(int, int)> samples;
  const std::function<bool(int, int)> active;
  std::vector<PixelKernels>& kernels;  // of the band's wanted rows
  int width;
  int first_row;
  CrossValidationLattice lattice;
  /// A refinement is assessed on a quarter of the lattice: it is to cost less than a fresh start.
  bool refinement;

  PixelKernels& at(int x, int y) const {
    return kernels[static_cast<std::size_t>(y - first_row) * width + x];
  }

  /// Leave-one-out residuals in units of the pixel's √Σb², or false where there is nothing to assess.
  bool residuals_of(int x, int y, FitWorker& own, MaskedSamples& masked, AlignedFloats& residuals,
                    double& squared) const {
    if (x < 0 || x >= width || !active(x, y)) return false;
    const PixelKernels& pixel = at(x, y);
    if (!(pixel.squared_samples > 0.0)) return false;  // without kernels, all of it is error
    own.model.cache().keep_within(cache_limit_bytes);
    masked.assign(samples(x, y), table.stride(), table.images());
    residuals.resize(3 * table.stride());
    squared = own.evaluator.leave_one_out(pixel, own.model.cache(), masked, residuals.data()) /
              pixel.squared_samples;
    const auto scale = static_cast<float>(1.0 / std::sqrt(pixel.squared_samples));
    for (float& r : residuals) r *= scale;
    return true;
  }

  /// Cross-validates a block of the lattice.
  void evaluate_block(const PixelTile& block, FitWorker& own, const RunContext& run) const {
    const auto b = samples_of(block, samples, active);
    const int block_width = block.x1 - block.x0;
    const bool learns = lattice.is_for_learning(block.x0, block.y0);
    if (refinement && !learns) return;
    const auto validated = own.evaluator.cross_validate(b, block_width, 5, run);
    std::vector<double> half, quarter;
    if (!refinement && learns) {
      half = own.evaluator.cross_validate(b, block_width, 2, run);
      quarter = own.evaluator.validate_folds_alone(b, block_width, 4, run);
    }
    const int last_row = first_row + static_cast<int>(kernels.size()) / width;
    std::size_t i = 0;
    for (int y = block.y0; y < block.y1; ++y)
      for (int x = block.x0; x < block.x1; ++x, ++i) {
        if (y < first_row || y >= last_row || !active(x, y) || !(at(x, y).squared_samples > 0.0)) continue;
        ErrorEvidence& evidence = at(x, y).evidence;
        const auto relative = [&](double squared) {
          return static_cast<float>(squared / at(x, y).squared_samples);
        };
        evidence.cross_validated = relative(validated[i]);
        if (half.empty()) continue;
        evidence.from_half = relative(half[i]);
        evidence.from_quarter = relative(quarter[i]);
      }
  }

  void evaluate_tile(const PixelTile& tile, FitWorker& own, const RunContext& run) const {
    MaskedSamples masked;
    AlignedFloats before, here;
    for (int y = tile.y0; y < tile.y1; ++y) {
      run.throw_if_stopped();
      double squared = 0.0;
      bool has_before = residuals_of(tile.x0 - 1, y, own, masked, before, squared);
      double shared_before = 0.0;  // with the pixel before
      bool is_shared_before = false;
      for (int x = tile.x0; x <= tile.x1; ++x) {
        const bool has_here = residuals_of(x, y, own, masked, here, squared);
        const bool is_shared = has_before && has_here;
        double shared = 0.0;
        for (std::size_t j = 0; is_shared && j < here.size(); ++j)
          shared += static_cast<double>(before[j]) * here[j];
        if (x > tile.x0 && has_before)
          at(x - 1, y).evidence.shared = static_cast<float>(
              (shared_before + shared) / std::max(1, static_cast<int>(is_shared_before) + is_shared));
        if (x < tile.x1 && has_here) {
          ErrorEvidence& evidence = at(x, y).evidence;
          evidence.leave_one_out = static_cast<float>(squared);
        }
        shared_before = shared;
        is_shared_before = is_shared;
        has_before = has_here;
        std::swap(before, here);
      }
    }
  }
};

}  // namespace

int max_rows_beyond(const EstimateOptions& options) {
  return block_side_px - 1 + options.sweeps();
}

RowRange rows_needed(RowRange wanted, int height, const EstimateOptions& options) {
  const int first = std::max(wanted.first - options.sweeps(), 0);
  const int last = std::min(wanted.last + options.sweeps(), height);
  return {first / block_side_px * block_side_px,
          std::min((last + block_side_px - 1) / block_side_px * block_side_px, height)};
}

std::vector<PixelKernels> estimate_band(const BoxTable& table, const ObservationBand& band, RowRange wanted,
                                        int height, const Mask& mask, const EstimateOptions& options,
                                        FitWorkers& workers, Progress& progress, const Refinement* refinement,
                                        const RunContext& run) {
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
    own->model.cache().keep_within(cache_limit_bytes);
    return *own;
  };
  const auto at = [&](int x, int y) { return static_cast<std::size_t>(y - held.first) * width + x; };
  std::vector<PixelKernels> kernels(static_cast<std::size_t>(width) * (held.last - held.first));

  const auto for_each_tile = [&](RowRange rows, const auto& work) {
    const auto tiles = tiles_of(width, rows);
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      run.throw_if_stopped();
      work(tiles[i], worker());
    });
  };

  for_each_tile(held, [&](const PixelTile& tile, FitWorker& own) {
    for (int y = tile.y0; y < tile.y1; y += block_side_px)
      for (int x = tile.x0; x < tile.x1; x += block_side_px) {
        run.throw_if_stopped();
        const PixelTile block{x, y, std::min(x + block_side_px, tile.x1),
                              std::min(y + block_side_px, tile.y1)};
        std::vector<std::vector<Box>> old;
        for (int by = block.y0; refinement && by < block.y1; ++by)
          for (int bx = block.x0; bx < block.x1; ++bx)
            old.push_back(refinement->boxes(static_cast<std::size_t>(by) * width + bx));
        auto fitted = own.model.fit(samples_of(block, samples, active), block.x1 - block.x0, old, run);
        std::size_t i = 0;
        for (int by = block.y0; by < block.y1; ++by)
          for (int bx = block.x0; bx < block.x1; ++bx) kernels[at(bx, by)] = std::move(fitted[i++]);
        own.model.cache().keep_within(cache_limit_bytes);  // blocks that share little fill it within a tile
      }
    progress.advance(static_cast<std::uint64_t>(tile.x1 - tile.x0) * (tile.y1 - tile.y0));
  });

  for (int pass = 1; pass <= options.sweeps(); ++pass) {
    // What lies beyond the band's overlap is not known; the rows that would need it are no longer asked for.
    const int left = options.sweeps() - pass;
    const RowRange rows = {std::max(wanted.first - left, held.first),
                           std::min(wanted.last + left, held.last)};
    const PixelGrid grid{width,
                         held.first,
                         held.last,
                         samples,
                         [&](int x, int y) -> const PixelKernels& { return kernels[at(x, y)]; },
                         active};
    std::vector<PixelKernels> next(kernels.size());
    for_each_tile(rows, [&](const PixelTile& tile, FitWorker& own) {
      auto corrected = correct_tile(grid, tile, own.model.cache(), own.weights, run);
      std::size_t i = 0;
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) next[at(x, y)] = std::move(corrected[i++]);
    });
    kernels = std::move(next);
  }

  std::vector<PixelKernels> result(static_cast<std::size_t>(width) * (wanted.last - wanted.first));
  for_each_tile(wanted, [&](const PixelTile& tile, FitWorker& own) {
    MaskedSamples masked;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x) {
        if (!active(x, y)) continue;
        PixelKernels& found = kernels[at(x, y)];
        if (options.mode == EstimateMode::refined) {
          result[static_cast<std::size_t>(y - wanted.first) * width + x] = std::move(found);
          continue;
        }
        masked.assign(samples(x, y), table.stride(), table.images());
        result[static_cast<std::size_t>(y - wanted.first) * width + x] =
            own.weights.fit(prepare_kernel_set(found.boxes, own.model.cache()), masked, found.weights);
      }
  });
  if (options.predict_errors) {
    const CrossValidationLattice lattice(width, height);
    const EvidenceGatherer gatherer{table, samples,      active,  result,
                                    width, wanted.first, lattice, refinement != nullptr};
    for_each_tile(wanted,
                  [&](const PixelTile& tile, FitWorker& own) { gatherer.evaluate_tile(tile, own, run); });
    std::vector<PixelTile> blocks;
    for (int y = wanted.first / block_side_px * block_side_px; y < wanted.last; y += block_side_px)
      for (int x = 0; x < width; x += block_side_px)
        if (lattice.holds(x, y))
          blocks.push_back(
              {x, y, std::min(x + block_side_px, width), std::min(y + block_side_px, held.last)});
    tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t i) {
      run.throw_if_stopped();
      gatherer.evaluate_block(blocks[i], worker(), run);
    });
  }
  if (table.unit() != 1.0) {
    const auto factor = static_cast<float>(1.0 / table.unit());
    for (PixelKernels& pixel : result)
      for (auto* weights : {&pixel.weights, &pixel.smooth})
        for (float& weight : *weights) weight *= factor;
  }
  return result;
}

}  // namespace refield
