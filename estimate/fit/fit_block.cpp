// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/fit_block.h"

#include "core/base/linear_algebra.h"
#include "core/base/run_context.h"
#include "estimate/fit/sample_pooling.h"
#include "estimate/fit/vector_kernels.h"

namespace refield {

namespace {

/// A pixel begins a set of its own when its squared distance is this many times the median's.
constexpr float far_beyond = 3.0f;

/// Gram matrix of the scaled pixels.
Eigen::MatrixXf gram_of(std::span<const std::array<const float*, 3>> values, const std::vector<float>& scale,
                        std::size_t stride) {
  const int count = static_cast<int>(values.size());
  Eigen::MatrixXf gram = Eigen::MatrixXf::Zero(count, count);
  std::vector<const float*> pointers(count);
  std::vector<float> products(count);
  for (int c = 0; c < 3; ++c) {
    for (int p = 0; p < count; ++p) pointers[p] = values[p][c];
    for (int p = 0; p < count; ++p) {
      dots(pointers[p], pointers.data(), count, stride, products.data());
      for (int q = 0; q < count; ++q) gram(p, q) += scale[p] * scale[q] * products[q];
    }
  }
  return gram;
}

/// Farthest first (Gonzalez 1985): from the pixel nearest to the mean, a pixel far from all centres begins a
/// set, as long as it is far beyond the usual. `values`: [pixels] of [3][stride] samples each, none missing;
/// `squared`: [pixels], Σ b² over channels; `stride` as in vector_kernels.h.
AlikeSets sort_alike(std::span<const std::array<const float*, 3>> values, std::span<const double> squared,
                     std::size_t stride, int max_sets) {
  const int count = static_cast<int>(values.size());
  AlikeSets sets;
  sets.scale.resize(count);
  for (int p = 0; p < count; ++p)
    sets.scale[p] = squared[p] > 0.0 ? static_cast<float>(1.0 / std::sqrt(squared[p])) : 0.0f;
  const Eigen::MatrixXf gram = gram_of(values, sets.scale, stride);
  const auto distance2 = [&](int p, int q) { return gram(p, p) + gram(q, q) - 2.0f * gram(p, q); };
  const Eigen::VectorXf to_all = gram.rowwise().sum();
  const auto to_mean = [&](int p) { return gram(p, p) * count - 2.0f * to_all[p]; };
  int centre = 0;
  for (int p = 1; p < count; ++p)
    if (to_mean(p) < to_mean(centre)) centre = p;
  sets.set_of.assign(count, 0);
  sets.count = 1;
  std::vector<float> nearest(count);
  for (int p = 0; p < count; ++p) nearest[p] = distance2(p, centre);
  while (sets.count < std::min(max_sets, count)) {
    std::vector<float> sorted = nearest;
    std::ranges::nth_element(sorted, sorted.begin() + count / 2);
    const int far = static_cast<int>(std::ranges::max_element(nearest) - nearest.begin());
    if (!(nearest[far] > far_beyond * sorted[count / 2])) break;
    for (int p = 0; p < count; ++p)
      if (const float d = distance2(p, far); d < nearest[p]) {
        nearest[p] = d;
        sets.set_of[p] = sets.count;
      }
    ++sets.count;
  }
  return sets;
}

/// Noise is taken as no less than this part of a sample, squared: what float32 tells.
constexpr double least_noise = 1e-10;

/// Samples of a pixel that shares them with others.
struct PooledSamples {
  float* values;                       ///< [3 × extent], extended; replaced
  std::array<double, 3> noise{};       ///< variance of a sample about the pixel's own fit
  std::array<double, 3> noise_kept{};  ///< out: part of that variance which is left
};

/// Takes noise out of the samples of neighbouring pixels that see alike: the matrix of images × pixels,
/// scaled to unit noise, is of low rank but for noise, so its singular values are shrunk as Gavish and Donoho
/// 2017 ("Optimal shrinkage of singular values", Frobenius loss) prove best; what no pixel shares with others
/// vanishes in the noise. Channel by channel.
void pool_samples(std::span<PooledSamples> pixels, const SmoothSpace& smooth, int images) {
  const int count = static_cast<int>(pixels.size());
  const std::size_t stride = smooth.stride(), extent = smooth.extent();
  std::vector<AlignedFloats> before(count);
  std::vector<const float*> pointers(count);
  std::vector<float> products(count);
  for (int c = 0; c < 3; ++c) {
    Eigen::VectorXd scale(count);
    for (int p = 0; p < count; ++p) {
      const float* b = pixels[p].values + c * extent;
      before[p].assign(b, b + stride);
      pointers[p] = before[p].data();
      float squared = 0.0f;
      dots(b, &pointers[p], 1, stride, &squared);
      const double noise = std::max(pixels[p].noise[c], least_noise * squared / images);
      scale[p] = squared > 0.0f && noise > 0.0 ? 1.0 / std::sqrt(noise) : 0.0;
    }
    Eigen::MatrixXd gram(count, count);
    for (int p = 0; p < count; ++p) {
      dots(pointers[p], pointers.data(), p + 1, stride, products.data());
      for (int q = 0; q <= p; ++q) gram(p, q) = gram(q, p) = scale[p] * scale[q] * products[q];
    }
    const SymmetricEigen eigen = symmetric_eigen(gram);
    const double ratio = static_cast<double>(count) / images;
    // A residual holds the fit's own error besides noise; the median component holds noise alone.
    const double median = eigen.values[count / 2] / images;
    const double noise = median > 0.0 ? std::min(median, 1.0) : 1.0;
    Eigen::VectorXd kept(count);
    for (int k = 0; k < count; ++k) kept[k] = kept_share(eigen.values[k] / images / noise, ratio);
    const Eigen::MatrixXd mix = eigen.vectors * kept.asDiagonal() * eigen.vectors.transpose();
    for (int p = 0; p < count; ++p) {
      pixels[p].noise_kept[c] = 1.0;
      if (!(scale[p] > 0.0)) continue;
      float* b = pixels[p].values + c * extent;
      std::fill_n(b, stride, 0.0f);
      for (int q = 0; q < count; ++q) products[q] = static_cast<float>(-mix(q, p) * scale[q] / scale[p]);
      subtract_combination(b, pointers.data(), products.data(), count, stride);
      smooth.extend(b, c);
      pixels[p].noise_kept[c] = mix.col(p).squaredNorm();
    }
  }
}

}  // namespace

HatGrid hats_of(const EstimateOptions& options, const LightDomain& domain, int images) {
  if (options.mode != EstimateMode::refined) return {};
  return hat_grid_for(domain, std::min(options.max_kernels(), images));
}

BlockModel::BlockModel(const BoxTable& table, const EstimateOptions& options, double mean_square,
                       std::shared_ptr<const TexelRegression> texels)
    : smooth_(table), cache_(table, smooth_, options.mode), texels_(std::move(texels)) {
  if (options.mode == EstimateMode::refined) {
    FitTuning tuning;
    // Cells are more kernels than are asked for, and TexelRegression has cells of its own.
    tuning.fits_cells = options.kernels == 0 && !texels_;
    // A part of the images keeps the hats of all; they leave room for rectangles.
    block_.emplace(cache_,
                   std::min(options.max_kernels(), std::max(table.images(), table.hats().count() + 5)),
                   mean_square, tuning);
  } else {
    pixel_.emplace(cache_, options);
  }
}

std::vector<PixelKernels> BlockModel::fit(std::span<const PixelSamples> samples, int width,
                                          std::span<const std::vector<Box>> old, const RunContext& run) {
  std::vector<PixelKernels> kernels(samples.size());
  if (block_) {
    if (!texels_) return block_->fit(samples, width, old);
    // Where the samples alone determine the weights of all light cells, no rectangles are needed.
    if (!texels_->is_interpolating()) kernels = block_->fit(samples, width, old);
    for (std::size_t p = 0; p < samples.size(); ++p) {
      run.throw_if_stopped();
      if (samples[p][0] == nullptr) continue;
      auto texels = texels_->fit(samples[p]);
      if (texels_->is_interpolating() || texels.criterion < texels_->criterion_of(kernels[p], samples[p]))
        kernels[p] = std::move(texels.kernels);
      else
        kernels[p].light_class = texels.kernels.light_class;
    }
    return kernels;
  }
  for (std::size_t p = 0; p < samples.size(); ++p) {
    run.throw_if_stopped();
    if (samples[p][0] != nullptr) kernels[p] = pixel_->fit(samples[p]);
  }
  return kernels;
}

BlockFitter::BlockFitter(KernelCache& cache, int max_kernels, double mean_square, const FitTuning& tuning)
    : cache_(cache),
      smooth_(cache.smooth()),
      tuning_(tuning),
      max_kernels_(max_kernels),
      mean_square_(mean_square),
      images_(cache.table().images()),
      stride_(smooth_.stride()),
      extent_(smooth_.extent()),
      gap_filler_(cache),
      shared_(cache, tuning_),
      single_(cache, tuning_),
      weighted_(cache.table(), smooth_),
      cells_(cache.table(), smooth_) {}

std::vector<PixelKernels> BlockFitter::fit(std::span<const PixelSamples> samples, int width,
                                           std::span<const std::vector<Box>> old) {
  std::vector<Pixel> pixels;
  for (int i = 0; i < static_cast<int>(samples.size()); ++i) {
    if (samples[i][0] == nullptr) continue;
    Pixel& pixel = pixels.emplace_back();
    pixel.index = i;
    pixel.x = i % width;
    pixel.y = i / width;
    // More are cells, which are of no use to a search.
    if (!old.empty() && std::ssize(old[i]) <= max_kernels_) pixel.old_boxes = old[i];
    load(pixel, samples[i]);
  }
  Group block;
  block.reuses_old = !old.empty();
  for (Pixel& pixel : pixels) block.pixels.push_back(&pixel);
  std::vector<Group> pending;
  if (!block.pixels.empty()) pending.push_back(std::move(block));
  while (!pending.empty()) {
    const Group group = std::move(pending.back());
    pending.pop_back();
    fit_group(group, pending);
  }
  std::vector<PixelKernels> result(samples.size());
  for (Pixel& pixel : pixels) result[pixel.index] = std::move(pixel.fitted.kernels);
  return result;
}

void BlockFitter::load(Pixel& pixel, const PixelSamples& samples) {
  pixel.samples.assign(samples, stride_, images_);
  pixel.values.assign(3 * extent_, 0.0f);
  for (int c = 0; c < 3; ++c) {
    float* b = pixel.values.data() + c * extent_;
    std::copy_n(pixel.samples.values.data() + c * stride_, stride_, b);
    if (pixel.samples.complete) smooth_.extend(b, c);
  }
  if (!pixel.samples.complete) pixel.gap_boxes = gap_filler_.estimate(samples, pixel.samples, pixel.values);
}

void BlockFitter::fit_group(const Group& group, std::vector<Group>& pending) {
  if (group.pixels.size() == 1 && (!group.reuses_old || group.side_px < block_side_px)) {
    fit_single(*group.pixels[0], group.reuses_old);
    return;
  }
  Hints hints;
  prepare_shared(group);
  const auto fit_all_but = [&](const Pixel* done) {
    for (Pixel* pixel : group.pixels)
      if (pixel != done) pixel->fitted = fit_from(*pixel, shared_, hints);
  };
  // Blocks are divided so often that choosing kernels for all of their pixels before would not pay.
  const bool is_block = group.side_px == block_side_px;
  if (!is_block) fit_all_but(nullptr);
  Pixel& worst = is_block ? farthest_from(shared_.tree.dictionary(), group.pixels)
                          : **std::ranges::max_element(group.pixels, {}, [](const Pixel* pixel) {
                              return pixel->fitted.kernels.squared_residual;
                            });
  if (is_block) worst.fitted = fit_from(worst, shared_, hints);
  if (auto alone = fit_better_alone(worst, group.reuses_old, hints)) {
    // Together with others of its quarter it is fitted again.
    if (group.side_px == 2 || group.reuses_old) refine(worst, *alone);
    worst.fitted = std::move(*alone);
    divide(group, worst, pending);
    return;
  }
  if (is_block) fit_all_but(&worst);
  if (group.pixels.size() > 1) pool_and_solve(group.pixels, hints);
}

BlockFitter::Pixel& BlockFitter::farthest_from(const TreeDictionary& dictionary,
                                               const std::vector<Pixel*>& pixels) const {
  std::vector<const float*> basis(dictionary.rank);
  std::vector<float> inside(dictionary.rank);
  const auto squared_outside = [&](const Pixel* pixel) {
    double outside = pixel->samples.squared_sum();
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < dictionary.rank; ++k) basis[k] = dictionary.basis[c].data() + k * stride_;
      dots(pixel->values.data() + c * extent_, basis.data(), dictionary.rank, stride_, inside.data());
      for (const float product : inside) outside -= static_cast<double>(product) * product;
    }
    return outside;
  };
  return **std::ranges::max_element(pixels, {}, squared_outside);
}

void BlockFitter::fit_single(Pixel& pixel, bool reuses_old) {
  Hints hints;
  const bool was_fitted = pixel.fitted.kernels.squared_samples > 0.0;
  Fitted own = fit_alone(pixel, reuses_old, hints);
  if (!reuses_old || !was_fitted || own.choice.criterion < pixel.fitted.choice.criterion)
    pixel.fitted = std::move(own);
  refine(pixel, pixel.fitted);
}

void BlockFitter::divide(const Group& group, const Pixel& fitted, std::vector<Group>& pending) const {
  const int half = group.side_px / 2;
  const bool reuses_old =
      group.reuses_old && !matters(fitted, fitted.fitted.kernels, tuning_.new_search_error);
  for (int part = 3; part >= 0; --part) {  // the last one appended is the next to be fitted
    Group quarter{{}, half, reuses_old};
    for (Pixel* pixel : group.pixels)
      if (pixel->x / half % 2 == part % 2 && pixel->y / half % 2 == part / 2) quarter.pixels.push_back(pixel);
    if (quarter.pixels.empty() || (quarter.pixels.size() == 1 && quarter.pixels[0] == &fitted)) continue;
    pending.push_back(std::move(quarter));
  }
}

void BlockFitter::prepare_shared(const Group& group) {
  if (group.reuses_old)
    take_old(group.pixels);
  else
    grow_shared(group.pixels);
}

void BlockFitter::take_old(const std::vector<Pixel*>& pixels) {
  std::vector<Box> boxes;
  const auto max_boxes = static_cast<std::size_t>(tuning_.max_leaves);
  for (const Pixel* pixel : pixels)
    for (const Box& box : pixel->old_boxes)
      if (boxes.size() < max_boxes && std::ranges::find(boxes, box) == boxes.end()) boxes.push_back(box);
  shared_.selector.prepare(shared_.tree.take(boxes));
}

void BlockFitter::grow_shared(const std::vector<Pixel*>& pixels) {
  const AlikeSets sets = sort_pixels(pixels);
  const int count = static_cast<int>(pixels.size());
  const auto searched = channels_to_search(pixels);
  double measured = 0.0;
  for (const Pixel* pixel : pixels) measured = std::max<double>(measured, pixel->count_in(searched));
  SearchTargets targets;
  std::vector<const float*> pointers(count);
  std::vector<float> minus_scale(count);
  std::vector<AlignedFloats> means(sets.count, AlignedFloats(3 * stride_, 0.0f));
  for (int set = 0; set < sets.count; ++set)
    for (const int c : searched) {
      int members = 0;
      for (int p = 0; p < count; ++p)
        if (sets.set_of[p] == set) {
          pointers[members] = pixels[p]->values.data() + c * extent_;
          minus_scale[members++] = -sets.scale[p];
        }
      float* mean = means[set].data() + c * stride_;
      subtract_combination(mean, pointers.data(), minus_scale.data(), members, stride_);
      targets[c].push_back(mean);
    }
  const bool is_part = count <= block_side_px * block_side_px / 4;
  const int leaves = is_part ? tuning_.leaves_of_part : tuning_.max_leaves;
  shared_.selector.prepare(shared_.tree.grow(targets, measured, leaves));
}

std::optional<BlockFitter::Fitted> BlockFitter::fit_better_alone(Pixel& pixel, bool reuses_old,
                                                                 Hints& hints) {
  const Fitted& shared = pixel.fitted;
  const double min_gain = tuning_.min_error_gain * tuning_.min_error_gain * shared.kernels.squared_samples;
  if (!(shared.kernels.squared_residual > tuning_.residual_worth_a_tree * min_gain)) return std::nullopt;
  Fitted own = fit_alone(pixel, reuses_old, hints);
  if (!(own.choice.criterion < shared.choice.criterion - tuning_.min_criterion_gain)) return std::nullopt;
  if (!(shared.kernels.squared_residual - own.kernels.squared_residual > min_gain)) return std::nullopt;
  return own;
}

void BlockFitter::pool_and_solve(const std::vector<Pixel*>& pixels, Hints& hints) {
  std::vector<PooledSamples> pooled;
  for (Pixel* pixel : pixels) pooled.push_back({pixel->values.data(), pixel->fitted.noise, {}});
  pool_samples(pooled, smooth_, images_);
  for (std::size_t p = 0; p < pixels.size(); ++p) pixels[p]->noise_kept = pooled[p].noise_kept;
  for (Pixel* pixel : pixels)
    if (pixel->samples.complete)
      set_weights(*pixel, coordinates_of(*pixel, shared_.tree.dictionary()), shared_, hints, pixel->fitted);
}

BlockFitter::Fitted BlockFitter::fit_alone(Pixel& pixel, bool reuses_old, Hints& hints) {
  const PixelKernels& shared = pixel.fitted.kernels;
  if (reuses_old && shared.squared_samples > 0.0 && !matters(pixel, shared, tuning_.new_search_error)) {
    single_.selector.prepare(single_.tree.take(pixel.old_boxes));
    return fit_from(pixel, single_, hints);
  }
  const Effort effort = effort_for(pixel, shared);
  const auto searched = effort == Effort::little ? channels_to_search({&pixel}) : std::vector{0, 1, 2};
  SearchTargets targets;
  for (const int c : searched) targets[c] = {pixel.values.data() + c * extent_};
  const int leaves = effort == Effort::little ? tuning_.leaves_of_pixel : tuning_.max_leaves;
  single_.selector.prepare(single_.tree.grow(targets, pixel.count_in(searched), leaves));
  return fit_from(pixel, single_, hints);
}

BlockFitter::Fitted BlockFitter::fit_from(Pixel& pixel, Search& search, Hints& hints) {
  Fitted fitted;
  const bool complete = pixel.samples.complete;
  for (int filling = 0; filling < (complete ? 1 : tuning_.gap_fillings); ++filling) {
    const PixelCoordinates coordinates = coordinates_of(pixel, search.tree.dictionary());
    fitted.choice = search.selector.select(coordinates, max_kernels_, hints.smooth_class);
    set_weights(pixel, coordinates, search, hints, fitted);
    if (!complete) gap_filler_.fill_in(pixel.samples, weighted_.predicted(), pixel.values);
  }
  if (!complete) prune_with_gaps(pixel, fitted);
  return fitted;
}

void BlockFitter::set_weights(const Pixel& pixel, const PixelCoordinates& coordinates, Search& search,
                              Hints& hints, Fitted& fitted) {
  const TreeDictionary& dictionary = search.tree.dictionary();
  PixelKernels& kernels = fitted.kernels;
  const std::vector<float> like = kernels.smooth.empty() ? hints.hats : std::move(kernels.smooth);
  kernels = {};
  if (!pixel.samples.complete) {
    std::vector<Box> boxes;
    for (const int box : fitted.choice.boxes) boxes.push_back(dictionary.boxes[box]);
    kernels = weighted_.fit(boxes, fitted.choice.smooth_class, pixel.samples, pixel.noise_kept);
    const int measured = pixel.samples.count_sum();
    fitted.noise.fill(kernels.squared_residual / std::max(measured, 1));
    return;
  }
  const PixelWeights weights = search.selector.solve(coordinates, fitted.choice, pixel.noise_kept, like);
  for (std::size_t i = 0; i < fitted.choice.boxes.size(); ++i) {
    if (weights.boxes[0][i] <= 0.0 && weights.boxes[1][i] <= 0.0 && weights.boxes[2][i] <= 0.0) continue;
    kernels.boxes.push_back(dictionary.boxes[fitted.choice.boxes[i]]);
    for (int c = 0; c < 3; ++c) kernels.weights.push_back(static_cast<float>(weights.boxes[c][i]));
  }
  for (std::size_t h = 0; h < weights.hats[0].size(); ++h)
    for (int c = 0; c < 3; ++c) kernels.smooth.push_back(static_cast<float>(weights.hats[c][h]));
  if (!kernels.smooth.empty()) hints.hats = kernels.smooth;
  for (int c = 0; c < 3; ++c) {
    kernels.squared_residual += weights.squared_residual[c];
    kernels.squared_samples += pixel.samples.squared[c];
    fitted.noise[c] = weights.squared_residual[c] / std::max(pixel.samples.count[c], 1);
  }
}

void BlockFitter::prune_with_gaps(const Pixel& pixel, Fitted& fitted) {
  std::vector<Box> all = fitted.kernels.boxes;
  for (const Box& box : pixel.gap_boxes)
    if (std::ranges::find(all, box) == all.end()) all.push_back(box);
  auto pruned = gap_filler_.prune(all, fitted.choice.smooth_class, pixel.samples,
                                  search_penalty_for(pixel.samples), pixel.noise_kept, weighted_);
  fitted.choice.criterion = pruned.criterion;
  if (!std::isfinite(pruned.criterion)) return;  // nothing was measured
  fitted.kernels = std::move(pruned.kernels);
  fitted.choice.smooth_class = pruned.smooth_class;
}

void BlockFitter::refine(const Pixel& pixel, Fitted& fitted) {
  move_edges(pixel, fitted);
  for (int k = 0; k < tuning_.split_rounds && split_boxes(pixel, fitted); ++k) move_edges(pixel, fitted);
  try_cells(pixel, fitted);
}

void BlockFitter::try_cells(const Pixel& pixel, Fitted& fitted) {
  if (!tuning_.fits_cells || !pixel.samples.complete || !matters(pixel, fitted.kernels, tuning_.cells_error))
    return;
  if (auto on_cells = cells_.fit(fitted.kernels, pixel.samples)) fitted.kernels = std::move(*on_cells);
}

void BlockFitter::move_edges(const Pixel& pixel, Fitted& fitted) {
  const EdgeSteps steps =
      effort_for(pixel, fitted.kernels) == Effort::full ? EdgeSteps::to_the_texel : EdgeSteps::coarse;
  const int smooth_class = fitted.choice.smooth_class;
  PixelKernels current = weighted_.fit(fitted.kernels.boxes, smooth_class, pixel.samples, pixel.noise_kept);
  for (int k = 0; k < (steps == EdgeSteps::coarse ? 1 : tuning_.edge_refinements); ++k) {
    const auto boxes = refine_edges(cache_.table(), current, weighted_.residual(), steps);
    if (boxes == current.boxes) break;
    PixelKernels moved = weighted_.fit(boxes, smooth_class, pixel.samples, pixel.noise_kept);
    if (!(moved.squared_residual < current.squared_residual)) break;
    current = std::move(moved);
  }
  if (current.squared_residual < fitted.kernels.squared_residual) fitted.kernels = std::move(current);
}

bool BlockFitter::split_boxes(const Pixel& pixel, Fitted& fitted) {
  if (!matters(pixel, fitted.kernels, tuning_.split_error)) return false;
  const int smooth_class = fitted.choice.smooth_class;
  const int max_boxes = max_kernels_ - (smooth_.classes()[smooth_class].smooth ? smooth_.hats() : 0);
  const int measured = pixel.samples.count_sum();
  const double penalty = search_penalty_for(pixel.samples);
  std::vector<Box> boxes = fitted.kernels.boxes;
  PixelKernels current = weighted_.fit(boxes, smooth_class, pixel.samples, pixel.noise_kept);
  double best_criterion = criterion_of(current, measured, penalty);
  bool was_split = false;
  for (int unrewarded = 0; unrewarded < tuning_.split_patience;) {
    boxes = current.boxes;
    if (static_cast<int>(boxes.size()) >= max_boxes) break;
    PixelKernels halves, parents = current;
    parents.boxes.push_back({0, 0, cache_.table().domain().width, cache_.table().domain().height});
    parents.weights.insert(parents.weights.end(), 3, std::numeric_limits<float>::min());
    const std::size_t parent = best_split(parents, halves);
    if (parent > boxes.size()) break;
    boxes.resize(std::max(boxes.size(), parent + 1));
    const auto moved = refine_edges(cache_.table(), halves, weighted_.residual(), EdgeSteps::to_the_texel);
    boxes[parent] = moved[0];
    boxes.push_back(moved[1]);
    PixelKernels next = weighted_.fit(boxes, smooth_class, pixel.samples, pixel.noise_kept);
    if (!(next.squared_residual < current.squared_residual)) break;
    current = std::move(next);
    const double criterion = criterion_of(current, measured, penalty);
    ++unrewarded;
    if (!(criterion < best_criterion)) continue;
    best_criterion = criterion;
    fitted.kernels = current;
    was_split = true;
    unrewarded = 0;
  }
  return was_split;
}

std::size_t BlockFitter::best_split(const PixelKernels& kernels, PixelKernels& halves) {
  std::size_t parent = kernels.boxes.size();
  double best_gain = 0.0;
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k)
    for (Split& split : cache_.splits(kernels.boxes[k])) {
      double gain = 0.0;
      for (int c = 0; c < 3; ++c) {
        if (!(kernels.weights[3 * k + c] > 0.0f)) continue;
        cache_.make(split, c);
        float product = 0.0f;
        dots(weighted_.residual().data() + c * stride_, &split.direction[c], 1, stride_, &product);
        if (split.norm2[c] > 0.0f) gain += static_cast<double>(product) * product / split.norm2[c];
      }
      if (!(gain > best_gain)) continue;
      best_gain = gain;
      parent = k;
      halves.boxes = {split.first, split.second};
    }
  if (parent < kernels.boxes.size())
    for (int i = 0; i < 6; ++i) halves.weights.push_back(kernels.weights[3 * parent + i % 3]);
  return parent;
}

std::vector<int> BlockFitter::channels_to_search(const std::vector<Pixel*>& pixels) const {
  if (images_ < tuning_.min_samples_per_leaf * tuning_.max_leaves) return {0, 1, 2};
  std::array<double, 3> squared{};
  for (const Pixel* pixel : pixels)
    for (int c = 0; c < 3; ++c) squared[c] += pixel->samples.squared[c];
  return {static_cast<int>(std::ranges::max_element(squared) - squared.begin())};
}

AlikeSets BlockFitter::sort_pixels(const std::vector<Pixel*>& pixels) const {
  std::vector<std::array<const float*, 3>> values;
  std::vector<double> squared;
  for (const Pixel* pixel : pixels) {
    const float* b = pixel->values.data();
    values.push_back({b, b + extent_, b + 2 * extent_});
    squared.push_back(pixel->samples.squared_sum());
  }
  return sort_alike(values, squared, stride_, TreeSearch::max_targets);
}

bool BlockFitter::matters(const Pixel& pixel, const PixelKernels& fit, double part) const {
  return fit.squared_residual >= part * part * mean_square_ * pixel.samples.count_sum();
}

BlockFitter::Effort BlockFitter::effort_for(const Pixel& pixel, const PixelKernels& fit) const {
  return fit.squared_samples > 0.0 && !matters(pixel, fit, tuning_.full_effort_error) ? Effort::little
                                                                                      : Effort::full;
}

double BlockFitter::search_penalty_for(const MaskedSamples& samples) const {
  // Where samples are missing, what they would have been is a guess already.
  const double mean_squared_sum = mean_square_ * samples.count_sum();
  const double ratio = tuning_.bright_ratio;
  return samples.complete && mean_squared_sum > 0.0 &&
                 samples.squared_sum() > ratio * ratio * mean_squared_sum
             ? tuning_.bright_search_penalty
             : tuning_.search_penalty;
}

PixelCoordinates BlockFitter::coordinates_of(const Pixel& pixel, const TreeDictionary& dictionary) const {
  PixelCoordinates coordinates;
  std::vector<const float*> basis(dictionary.rank);
  for (int c = 0; c < 3; ++c) {
    const float* b = pixel.values.data() + c * extent_;
    for (int k = 0; k < dictionary.rank; ++k) basis[k] = dictionary.basis[c].data() + k * stride_;
    coordinates.inside[c].resize(dictionary.rank);
    dots(b, basis.data(), dictionary.rank, stride_, coordinates.inside[c].data());
    coordinates.smooth[c].assign(b + stride_, b + stride_ + smooth_.rank());
    for (int j = 0; j < images_; ++j) coordinates.squared[c] += static_cast<double>(b[j]) * b[j];
    coordinates.measured += pixel.samples.count[c];
  }
  coordinates.search_penalty = search_penalty_for(pixel.samples);
  return coordinates;
}

}  // namespace refield
