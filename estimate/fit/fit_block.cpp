// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/fit_block.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/run_context.h"
#include "estimate/fit/similar_pixels.h"

namespace refield {

HatGrid hats_of(const EstimateOptions& options, const LightDomain& domain, int images) {
  if (options.mode != EstimateMode::refined) return {};
  return hat_grid_for(domain, std::min(options.max_kernels(), images));
}

BlockModel::BlockModel(const BoxTable& table, const EstimateOptions& options)
    : smooth_(table), cache_(table, smooth_, options.mode) {
  if (options.mode == EstimateMode::refined)
    // A part of the images keeps the hats of all; they leave room for rectangles.
    block_.emplace(cache_,
                   std::min(options.max_kernels(), std::max(table.images(), table.hats().count() + 5)),
                   options.mean_square);
  else
    pixel_.emplace(cache_, options);
}

std::vector<PixelKernels> BlockModel::fit(std::span<const PixelSamples> samples, int width,
                                          std::span<const std::vector<Box>> old, const RunContext& run) {
  if (block_) return block_->fit(samples, width, old);
  std::vector<PixelKernels> kernels(samples.size());
  for (std::size_t p = 0; p < samples.size(); ++p) {
    run.throw_if_stopped();
    if (samples[p][0] != nullptr) kernels[p] = pixel_->fit(samples[p]);
  }
  return kernels;
}

namespace {
/// Leaves that a tree grows at most: twice what a pixel needs, since pixels share it.
constexpr int max_leaves = 56;
/// And that of a part of a block, or of a single pixel which is not worth full effort. Measured: 36 cost a
/// fifth more time and take 2 to 3 % off the median pixel's error, nothing off the picture's; 22 save a fifth
/// at 6 %.
constexpr int few_leaves = 28;
/// A channel's samples tell of the splits alone when there are this many for a leaf; with fewer, small
/// highlights are missed (50 images: a fifth of the picture's error).
constexpr int enough_samples_a_leaf = 2;
/// Full effort is for pixels whose error, after the shared fit, is more than this part of the picture's root
/// mean square: few (mirrors, glass, highlights), but most of the picture's error. Measured: full effort for
/// all costs three times as much, takes nothing off the picture's error and a few per cent off the median
/// pixel's.
constexpr double worth_full_effort = 0.05;
/// Where old rectangles are known, pixels whose error with them is less than this part are not searched anew,
/// nor are the parts of their blocks. Measured from 100 to 180 images, in processor time and error beside a
/// fresh fit's: 0.02 takes 48 %, +3 % in natural light and +8 % under bars; 0.01 53 %, +3 and +6; 0.006 60 %,
/// +2 and +6.
constexpr double worth_searching_anew = 0.01;
/// Pixels this many times as bright as the picture's root mean square mirror or refract what is bright, so
/// small rectangles are likelier in them from the start and cost less. Measured: with 50 images 8 % off the
/// picture's error in natural light and 10 % under bars, with 180 images 6 % and none; nothing where there is
/// noise.
constexpr double bright = 2.0;
constexpr double search_penalty_bright = 10.0;
/// A pixel does clearly better with a tree of its own when its criterion falls by more than this.
constexpr double clear_gain = 15.0;
/// And when that takes this part, in quadrature, off the pixel's relative error: photographs are seldom less
/// noisy. Measured: 0 costs half as much time again (nearly twice on noise-free data) and takes 5 % off the
/// median pixel's error; 0.01 saves a quarter and costs 12 %.
constexpr double worthwhile_gain = 0.007;
/// Times that edges are moved and weights solved anew, with full effort.
constexpr int refinements = 2;
/// Times that samples which were not measured are filled in from a fit and kernels chosen anew.
constexpr int fillings = 3;
}  // namespace

BlockFitter::BlockFitter(KernelCache& cache, int max_kernels, double mean_square)
    : cache_(cache),
      smooth_(cache.smooth()),
      max_kernels_(max_kernels),
      mean_square_(mean_square),
      images_(cache.table().images()),
      stride_(smooth_.stride()),
      extent_(smooth_.extent()),
      gap_filler_(cache),
      shared_(cache, max_leaves),
      single_(cache, max_leaves),
      weighted_(cache.table(), smooth_) {}

std::vector<PixelKernels> BlockFitter::fit(std::span<const PixelSamples> samples, int width,
                                           std::span<const std::vector<Box>> old) {
  old_ = old;
  std::vector<Pixel> pixels;
  for (int i = 0; i < static_cast<int>(samples.size()); ++i) {
    if (samples[i][0] == nullptr) continue;
    Pixel& pixel = pixels.emplace_back();
    pixel.index = i;
    pixel.x = i % width;
    pixel.y = i / width;
    load(pixel, samples[i]);
  }
  fitted_.assign(samples.size(), {});
  Group group;
  for (Pixel& pixel : pixels) group.push_back(&pixel);
  if (!group.empty()) fit_group(group, block_side_px);
  std::vector<PixelKernels> result;
  for (Fitted& fitted : fitted_) result.push_back(std::move(fitted.kernels));
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

std::vector<int> BlockFitter::channels_to_search(const Group& pixels) const {
  if (images_ < enough_samples_a_leaf * max_leaves) return {0, 1, 2};
  std::array<double, 3> squared{};
  for (const Pixel* pixel : pixels)
    for (int c = 0; c < 3; ++c) squared[c] += pixel->samples.squared[c];
  return {static_cast<int>(std::ranges::max_element(squared) - squared.begin())};
}

void BlockFitter::take_or_grow(const Group& pixels) {
  if (!old_.empty()) {
    std::vector<Box> boxes;
    for (const Pixel* pixel : pixels)
      for (const Box& box : old_[pixel->index])
        if (boxes.size() < max_leaves && std::ranges::find(boxes, box) == boxes.end()) boxes.push_back(box);
    shared_.selector.prepare(shared_.tree.take(boxes));
    return;
  }
  const AlikeSets sets = sort_alike(pixels);
  const int count = static_cast<int>(pixels.size());
  const auto searched = channels_to_search(pixels);
  double measured = 0.0;
  for (const Pixel* pixel : pixels) measured = std::max<double>(measured, pixel->count_in(searched));
  SearchTargets targets;
  std::vector<const float*> pointers(count);
  std::vector<float> minus_scale(count);
  means_.resize(sets.count);
  for (int set = 0; set < sets.count; ++set) {
    means_[set].assign(3 * stride_, 0.0f);
    for (const int c : searched) {
      int members = 0;
      for (int p = 0; p < count; ++p)
        if (sets.set_of[p] == set) {
          pointers[members] = pixels[p]->values.data() + c * extent_;
          minus_scale[members++] = -sets.scale[p];
        }
      float* mean = means_[set].data() + c * stride_;
      subtract_combination(mean, pointers.data(), minus_scale.data(), members, stride_);
      targets[c].push_back(mean);
    }
  }
  const bool whole_block = count > block_side_px * block_side_px / 4;
  shared_.selector.prepare(shared_.tree.grow(targets, measured, whole_block ? max_leaves : few_leaves));
}

bool BlockFitter::matters(const Pixel& pixel, const PixelKernels& fit, double part) const {
  return fit.squared_residual >= part * part * mean_square_ * pixel.samples.count_sum();
}

BlockFitter::Effort BlockFitter::effort_for(const Pixel& pixel, const PixelKernels& fit) const {
  return fit.squared_samples > 0.0 && !matters(pixel, fit, worth_full_effort) ? Effort::little : Effort::full;
}

double BlockFitter::search_penalty_for(const MaskedSamples& samples) const {
  // Where samples are missing, what they would have been is a guess already.
  const double usual = mean_square_ * samples.count_sum();
  return samples.complete && usual > 0.0 && samples.squared_sum() > bright * bright * usual
             ? search_penalty_bright
             : usual_search_penalty;
}

BlockFitter::Fitted BlockFitter::fit_alone(Pixel& pixel) {
  const PixelKernels& shared = fitted_[pixel.index].kernels;
  if (!old_.empty() && shared.squared_samples > 0.0 && !matters(pixel, shared, worth_searching_anew)) {
    single_.selector.prepare(single_.tree.take(old_[pixel.index]));
    return fit_from(pixel, single_);
  }
  const Effort effort = effort_for(pixel, shared);
  const auto searched = effort == Effort::little ? channels_to_search({&pixel}) : std::vector{0, 1, 2};
  SearchTargets targets;
  for (const int c : searched) targets[c] = {pixel.values.data() + c * extent_};
  const double measured = pixel.count_in(searched);
  const int leaves = effort == Effort::little ? few_leaves : max_leaves;
  single_.selector.prepare(single_.tree.grow(targets, measured, leaves));
  return fit_from(pixel, single_);
}

AlikeSets BlockFitter::sort_alike(const Group& pixels) const {
  std::vector<std::array<const float*, 3>> values;
  std::vector<double> squared;
  for (const Pixel* pixel : pixels) {
    const float* b = pixel->values.data();
    values.push_back({b, b + extent_, b + 2 * extent_});
    squared.push_back(pixel->samples.squared_sum());
  }
  return refield::sort_alike(values, squared, stride_, TreeSearch::max_targets);
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

BlockFitter::Fitted BlockFitter::fit_from(Pixel& pixel, Search& search) {
  Fitted fitted;
  for (int filling = 0; filling < (pixel.samples.complete ? 1 : fillings); ++filling) {
    const PixelCoordinates coordinates = coordinates_of(pixel, search.tree.dictionary());
    fitted.choice = search.selector.select(coordinates, max_kernels_, guess_);
    set_weights(pixel, coordinates, search, fitted);
    if (!pixel.samples.complete) gap_filler_.fill_in(pixel.samples, weighted_.predicted(), pixel.values);
  }
  if (!pixel.samples.complete) prune_with_gaps(pixel, fitted);
  return fitted;
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

void BlockFitter::set_weights(const Pixel& pixel, const PixelCoordinates& coordinates, Search& search,
                              Fitted& fitted) {
  const TreeDictionary& dictionary = search.tree.dictionary();
  PixelKernels& kernels = fitted.kernels;
  const std::vector<float> like = kernels.smooth.empty() ? like_ : std::move(kernels.smooth);
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
  if (!kernels.smooth.empty()) like_ = kernels.smooth;
  for (int c = 0; c < 3; ++c) {
    kernels.squared_residual += weights.squared_residual[c];
    kernels.squared_samples += pixel.samples.squared[c];
    fitted.noise[c] = weights.squared_residual[c] / std::max(pixel.samples.count[c], 1);
  }
}

void BlockFitter::refine(const Pixel& pixel, Fitted& fitted) {
  if (fitted.kernels.boxes.empty()) return;
  const EdgeSteps steps =
      effort_for(pixel, fitted.kernels) == Effort::full ? EdgeSteps::to_the_texel : EdgeSteps::coarse;
  const int smooth_class = fitted.choice.smooth_class;
  PixelKernels current = weighted_.fit(fitted.kernels.boxes, smooth_class, pixel.samples, pixel.noise_kept);
  for (int k = 0; k < (steps == EdgeSteps::coarse ? 1 : refinements); ++k) {
    const auto boxes = refine_edges(cache_.table(), current, weighted_.residual(), steps);
    if (boxes == current.boxes) break;
    PixelKernels moved = weighted_.fit(boxes, smooth_class, pixel.samples, pixel.noise_kept);
    if (!(moved.squared_residual < current.squared_residual)) break;
    current = std::move(moved);
  }
  if (current.squared_residual < fitted.kernels.squared_residual) fitted.kernels = std::move(current);
}

void BlockFitter::pool(const Group& pixels) {
  std::vector<PooledSamples> pooled;
  for (Pixel* pixel : pixels) pooled.push_back({pixel->values.data(), fitted_[pixel->index].noise, {}});
  pool_samples(pooled, smooth_, images_);
  for (std::size_t p = 0; p < pixels.size(); ++p) pixels[p]->noise_kept = pooled[p].noise_kept;
}

void BlockFitter::fit_group(const Group& pixels, int side) {
  guess_ = {};  // what is found must not depend on what was fitted before
  like_.clear();
  if (pixels.size() == 1 && (old_.empty() || side < block_side_px)) {
    Fitted& fitted = fitted_[pixels[0]->index];
    Fitted own = fit_alone(*pixels[0]);
    if (old_.empty() || own.choice.criterion < fitted.choice.criterion) fitted = std::move(own);
    refine(*pixels[0], fitted);
    return;
  }
  take_or_grow(pixels);
  Pixel* worst = nullptr;
  for (Pixel* pixel : pixels) {
    Fitted& fitted = fitted_[pixel->index];
    fitted = fit_from(*pixel, shared_);
    if (!worst || fitted.kernels.squared_residual > fitted_[worst->index].kernels.squared_residual)
      worst = pixel;
  }
  Fitted& shared = fitted_[worst->index];
  const double worthwhile = worthwhile_gain * worthwhile_gain * shared.kernels.squared_samples;
  Fitted own;
  own.choice.criterion = std::numeric_limits<double>::infinity();
  if (shared.kernels.squared_residual > worthwhile) own = fit_alone(*worst);
  if (!(own.choice.criterion < shared.choice.criterion - clear_gain &&
        shared.kernels.squared_residual - own.kernels.squared_residual > worthwhile)) {
    if (pixels.size() == 1) return;
    pool(pixels);
    for (const Pixel* pixel : pixels)
      if (pixel->samples.complete)
        set_weights(*pixel, coordinates_of(*pixel, shared_.tree.dictionary()), shared_,
                    fitted_[pixel->index]);
    return;
  }
  refine(*worst, own);
  shared = std::move(own);
  const auto old = old_;
  if (matters(*worst, shared.kernels, worth_searching_anew)) old_ = {};
  const int half = side / 2;
  for (int part = 0; part < 4; ++part) {
    Group quarter;
    for (Pixel* pixel : pixels)
      if (pixel->x / half % 2 == part % 2 && pixel->y / half % 2 == part / 2) quarter.push_back(pixel);
    if (quarter.empty() || (quarter.size() == 1 && quarter[0] == worst)) continue;  // it has its own already
    fit_group(quarter, half);
  }
  old_ = old;
}

}  // namespace refield
