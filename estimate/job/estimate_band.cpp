// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/estimate_band.h"

#include <tbb/parallel_for.h>

#include "core/base/run_context.h"

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

/// The tiles of 4 × 4 pixels that are fitted together, of a tile or a band.
std::vector<PixelTile> blocks_of(const PixelTile& tile) {
  std::vector<PixelTile> blocks;
  for (int y = tile.y0; y < tile.y1; y += block_side_px)
    for (int x = tile.x0; x < tile.x1; x += block_side_px)
      blocks.push_back({x, y, std::min(x + block_side_px, tile.x1), std::min(y + block_side_px, tile.y1)});
  return blocks;
}

/// The estimate of one band, in the order of its steps.
class BandEstimator {
 public:
  BandEstimator(const BandInput& input, FitWorkers& workers, Progress& progress, const RunContext& run)
      : input_(input),
        width_(input.band.width()),
        held_{input.band.first_row(), input.band.last_row()},
        fitted_(rows_fitted(input.rows, input.height, input.options)),
        workers_(workers),
        progress_(progress),
        run_(run),
        lattice_(width_, input.height),
        is_weighted_(std::ranges::any_of(input.table.image_weights(), [](float w) { return w != 1.0f; })) {}

  std::vector<PixelKernels> estimate() {
    Rows kernels = fit_blocks();
    for (int sweep = 1; sweep <= input_.options.sweeps(); ++sweep) kernels = correct(kernels, sweep);
    Rows result = wanted_rows(std::move(kernels));
    if (input_.options.predict_errors && knows_error()) gather_evidence(result);
    to_texel_sums(result);
    return std::move(result.pixels);
  }

 private:
  /// Kernels of whole rows of the picture.
  struct Rows {
    int width, first;
    std::vector<PixelKernels> pixels;

    Rows(int image_width, RowRange rows)
        : width(image_width),
          first(rows.first),
          pixels(static_cast<std::size_t>(image_width) * (rows.last - rows.first)) {}
    PixelKernels& at(int x, int y) { return pixels[static_cast<std::size_t>(y - first) * width + x]; }
    const PixelKernels& at(int x, int y) const {
      return pixels[static_cast<std::size_t>(y - first) * width + x];
    }
    /// Moves the pixels of a tile in, given row by row.
    void set(const PixelTile& tile, std::vector<PixelKernels>&& values) {
      auto value = values.begin();
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) at(x, y) = std::move(*value++);
    }
  };

  bool active(int x, int y) const {
    return input_.mask.empty() || input_.mask[static_cast<std::size_t>(y) * width_ + x] != 0;
  }
  PixelSamples samples(int x, int y) const {
    const ObservationBand& band = input_.band;
    return {band.samples(x, y, 0), band.samples(x, y, 1), band.samples(x, y, 2)};
  }
  /// Samples of a tile's pixels; null pointers for those outside the mask.
  std::vector<PixelSamples> samples_of(const PixelTile& tile) const {
    std::vector<PixelSamples> result;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x) result.push_back(active(x, y) ? samples(x, y) : PixelSamples{});
    return result;
  }
  /// The same with less noise, see SamplePool; valid until the worker's next call.
  std::vector<PixelSamples> pooled_samples_of(const PixelTile& tile, FitWorker& own) const {
    return own.pool.pool(tile, width_, input_.height,
                         [&](int x, int y) { return active(x, y) ? samples(x, y) : PixelSamples{}; });
  }
  bool has_few_degrees_of_freedom() const { return input_.texels && input_.texels->of_all(); }
  bool knows_error() const {
    return is_error_known(input_.table, input_.texels ? input_.texels->of_all().get() : nullptr);
  }
  FitWorker& worker() const {
    auto& own = workers_.local();
    const bool pools =
        input_.noise && input_.options.mode == EstimateMode::refined && !has_few_degrees_of_freedom();
    if (!own)
      own = std::make_unique<FitWorker>(input_.table, input_.options, input_.mean_square, input_.texels,
                                        pools ? *input_.noise : NoiseModel{});
    own->model.cache().keep_within(cache_limit_bytes);
    return *own;
  }
  template <class Work>
  void for_each(const std::vector<PixelTile>& tiles, const Work& work) const {
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      run_.throw_if_stopped();
      work(tiles[i], worker());
    });
  }

  /// Kernels of all rows that the band holds, before spatial correction.
  Rows fit_blocks() const;
  std::vector<std::vector<Box>> old_boxes(const PixelTile& block) const;
  /// One sweep of spatial correction.
  Rows correct(const Rows& kernels, int sweep) const;
  /// The rows to be estimated; in the paper's modes with weights from all measured samples.
  Rows wanted_rows(Rows kernels) const;
  /// The table's columns are in units of their own; weights are to multiply sums of texel values.
  void to_texel_sums(Rows& rows) const;

  // Fills in what the final kernels tell about their own error.
  void gather_evidence(Rows& rows) const;
  void leave_one_out(Rows& rows, const PixelTile& tile, FitWorker& own) const;
  /// Cross-validates a block of the lattice.
  void cross_validate(Rows& rows, const PixelTile& block, FitWorker& own) const;

  const BandInput& input_;
  const int width_;
  const RowRange held_;    // by the band
  const RowRange fitted_;  // before spatial correction
  FitWorkers& workers_;
  Progress& progress_;
  const RunContext& run_;
  const CrossValidationLattice lattice_;
  const bool is_weighted_;
};

BandEstimator::Rows BandEstimator::fit_blocks() const {
  Rows kernels(width_, fitted_);
  for_each(tiles_of(width_, fitted_), [&](const PixelTile& tile, FitWorker& own) {
    const std::vector<PixelSamples> pooled = pooled_samples_of(tile, own);
    std::vector<PixelSamples> of_block;
    for (const PixelTile& block : blocks_of(tile)) {
      run_.throw_if_stopped();
      of_block.clear();
      for (int y = block.y0; y < block.y1; ++y)
        for (int x = block.x0; x < block.x1; ++x)
          of_block.push_back(pooled[(y - tile.y0) * (tile.x1 - tile.x0) + x - tile.x0]);
      kernels.set(block, own.model.fit(of_block, block.x1 - block.x0, old_boxes(block), run_));
      own.model.cache().keep_within(cache_limit_bytes);  // blocks that share little fill it within a tile
    }
    for (int y = tile.y0, p = 0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x, ++p)
        if (active(x, y) && (is_weighted_ || pooled[p] != samples(x, y)))
          own.evaluator.set_residual(samples(x, y), kernels.at(x, y));
    progress_.advance(static_cast<std::uint64_t>(tile.x1 - tile.x0) * (tile.y1 - tile.y0));
  });
  return kernels;
}

std::vector<std::vector<Box>> BandEstimator::old_boxes(const PixelTile& block) const {
  std::vector<std::vector<Box>> old;
  for (int y = block.y0; input_.refinement && y < block.y1; ++y)
    for (int x = block.x0; x < block.x1; ++x)
      old.push_back(input_.refinement->boxes(static_cast<std::size_t>(y) * width_ + x));
  return old;
}

BandEstimator::Rows BandEstimator::correct(const Rows& kernels, int sweep) const {
  // What lies beyond the band's overlap is not known; the rows that would need it are no longer needed.
  const int left = input_.options.sweeps() - sweep;
  const RowRange rows{std::max(input_.rows.first - left, fitted_.first),
                      std::min(input_.rows.last + left, fitted_.last)};
  const PixelAccess grid{width_,
                         fitted_.first,
                         fitted_.last,
                         [&](int x, int y) { return samples(x, y); },
                         [&](int x, int y) -> const PixelKernels& { return kernels.at(x, y); },
                         [&](int x, int y) { return active(x, y); }};
  Rows next(width_, fitted_);
  for_each(tiles_of(width_, rows), [&](const PixelTile& tile, FitWorker& own) {
    next.set(tile, correct_tile(grid, tile, own.model.cache(), own.weights, run_));
  });
  return next;
}

BandEstimator::Rows BandEstimator::wanted_rows(Rows kernels) const {
  const bool refined = input_.options.mode == EstimateMode::refined;
  Rows result(width_, input_.rows);
  for_each(tiles_of(width_, input_.rows), [&](const PixelTile& tile, FitWorker& own) {
    MaskedSamples masked;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x) {
        if (!active(x, y)) continue;
        PixelKernels& found = kernels.at(x, y);
        if (refined) {
          result.at(x, y) = std::move(found);
          continue;
        }
        masked.assign(samples(x, y), input_.table.stride(), input_.table.images());
        result.at(x, y) =
            own.weights.fit(prepare_kernel_set(found.boxes, own.model.cache()), masked, found.weights);
      }
  });
  return result;
}

void BandEstimator::to_texel_sums(Rows& rows) const {
  if (input_.table.unit() == 1.0) return;
  const auto factor = static_cast<float>(1.0 / input_.table.unit());
  for (PixelKernels& pixel : rows.pixels)
    for (auto* weights : {&pixel.weights, &pixel.smooth})
      for (float& weight : *weights) weight *= factor;
}

void BandEstimator::gather_evidence(Rows& rows) const {
  for_each(tiles_of(width_, input_.rows),
           [&](const PixelTile& tile, FitWorker& own) { leave_one_out(rows, tile, own); });
  const int first = input_.rows.first / block_side_px * block_side_px;
  std::vector<PixelTile> blocks;
  for (const PixelTile& block : blocks_of({0, first, width_, fitted_.last}))
    if (block.y0 < input_.rows.last && lattice_.holds(block.x0, block.y0)) blocks.push_back(block);
  for_each(blocks, [&](const PixelTile& block, FitWorker& own) { cross_validate(rows, block, own); });
}

void BandEstimator::leave_one_out(Rows& rows, const PixelTile& tile, FitWorker& own) const {
  const BoxTable& table = input_.table;
  MaskedSamples masked;
  AlignedFloats residuals(3 * table.stride()), left(residuals.size());
  for (int y = tile.y0; y < tile.y1; ++y) {
    run_.throw_if_stopped();
    double squared_left = 0.0;  // samples of the pixel that `left` is of
    for (int x = tile.x0; x < tile.x1; ++x) {
      const double squared_samples_left = std::exchange(squared_left, 0.0);
      PixelKernels& pixel = rows.at(x, y);
      // Without kernels, all of it is error; nothing is known of a channel without samples.
      if (!active(x, y) || !(pixel.squared_samples > 0.0)) continue;
      masked.assign(samples(x, y), table.stride(), table.images());
      if (std::ranges::any_of(masked.count, [](int count) { return count == 0; })) continue;
      own.model.cache().keep_within(cache_limit_bytes);
      const double squared = own.evaluator.leave_one_out(pixel, own.model.cache(), masked, residuals.data());
      pixel.evidence.leave_one_out = static_cast<float>(squared / pixel.squared_samples);
      if (squared_samples_left > 0.0)
        pixel.evidence.shared =
            static_cast<float>(std::inner_product(residuals.begin(), residuals.end(), left.begin(), 0.0) /
                               std::sqrt(pixel.squared_samples * squared_samples_left));
      left.swap(residuals);
      squared_left = pixel.squared_samples;
      if (const auto noise = input_.band.squared_noise(x, y))
        pixel.evidence.noise = static_cast<float>(*noise / pixel.squared_samples);
      pixel.evidence.samples = static_cast<float>(masked.count_sum());
      if (const auto expected = own.evaluator.expected_error(pixel, masked)) {
        pixel.evidence.expected = static_cast<float>(*expected / pixel.squared_samples);
        pixel.evidence.light_class = static_cast<std::uint32_t>(pixel.light_class);
      }
    }
  }
}

void BandEstimator::cross_validate(Rows& rows, const PixelTile& block, FitWorker& own) const {
  const bool learns = lattice_.is_for_learning(block.x0, block.y0);
  // A refinement is assessed on a quarter of the lattice: it is to cost less than a fresh start.
  const bool refines = input_.refinement != nullptr;
  if (refines && !learns) return;
  const auto b = samples_of(block);
  const int block_width = block.x1 - block.x0;
  const auto in_rows = [&](int x, int y) {
    return y >= input_.rows.first && y < input_.rows.last && active(x, y) &&
           rows.at(x, y).squared_samples > 0.0;
  };
  // Leave-one-out is right where no rectangles were selected with the samples that it leaves out.
  bool has_rectangles = false;
  for (int y = block.y0; y < block.y1; ++y)
    for (int x = block.x0; x < block.x1; ++x)
      has_rectangles = has_rectangles || (in_rows(x, y) && !rows.at(x, y).is_on_cells);
  const auto pooled = pooled_samples_of(block, own);
  // A fifth of few lights is much of what they tell.
  const bool few_degrees = has_few_degrees_of_freedom();
  const double share = share_of_cross_validation(input_.table);
  std::vector<double> validated;
  if (has_rectangles)
    validated = own.evaluator.cross_validate(pooled, block_width, few_degrees ? 10 : 5, run_, b);
  std::vector<double> half, quarter;
  if (!refines && learns) {
    half = own.evaluator.cross_validate(pooled, block_width, 2, run_, b);
    quarter = own.evaluator.validate_folds_alone(pooled, block_width, 4, run_, b);
  }
  std::size_t i = 0;
  for (int y = block.y0; y < block.y1; ++y)
    for (int x = block.x0; x < block.x1; ++x, ++i) {
      if (!in_rows(x, y)) continue;
      PixelKernels& pixel = rows.at(x, y);
      const auto relative = [&](double squared) {
        return static_cast<float>(squared / pixel.squared_samples);
      };
      const float left_out = pixel.evidence.leave_one_out;
      pixel.evidence.cross_validated = pixel.is_on_cells ? left_out : relative(validated[i]);
      if (input_.texels && !few_degrees && share > 0.5)  // of repeated lights leave-one-out tells less
        pixel.evidence.cross_validated =
            static_cast<float>(std::lerp(left_out, pixel.evidence.cross_validated, 2.0 * share));
      if (half.empty()) continue;
      pixel.evidence.from_half = relative(half[i]);
      pixel.evidence.from_quarter = relative(quarter[i]);
    }
}

}  // namespace

int max_rows_beyond(const EstimateOptions& options) {
  return block_side_px - 1 + options.sweeps() +
         (options.mode == EstimateMode::refined ? pooling_reach_px : 0);
}

RowRange rows_fitted(RowRange wanted, int height, const EstimateOptions& options) {
  const int first = std::max(wanted.first - options.sweeps(), 0);
  const int last = std::min(wanted.last + options.sweeps(), height);
  return {first / block_side_px * block_side_px,
          std::min((last + block_side_px - 1) / block_side_px * block_side_px, height)};
}

RowRange rows_needed(RowRange wanted, int height, const EstimateOptions& options) {
  const RowRange fitted = rows_fitted(wanted, height, options);
  if (options.mode != EstimateMode::refined) return fitted;
  return {std::max(fitted.first - pooling_reach_px, 0), std::min(fitted.last + pooling_reach_px, height)};
}

std::vector<PixelKernels> estimate_band(const BandInput& input, FitWorkers& workers, Progress& progress,
                                        const RunContext& run) {
  return BandEstimator(input, workers, progress, run).estimate();
}

}  // namespace refield
