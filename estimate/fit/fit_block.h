// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "estimate/fit/cell_fit.h"
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/fit_tuning.h"
#include "estimate/fit/select_kernels.h"
#include "estimate/fit/smooth_space.h"
#include "estimate/fit/texel_regression.h"
#include "estimate/fit/tree_search.h"
#include "estimate/fit/weighted_fit.h"
#include "estimate/options.h"

namespace refield {

/// Pixels sorted into a few sets of alike ones, whose means can stand for all.
struct AlikeSets {
  int count = 0;
  std::vector<int> set_of;   ///< [pixels]
  std::vector<float> scale;  ///< [pixels], what gives each unit norm: a bright one is not to speak for all
};

/// Side of the blocks of pixels that are fitted together, in pixels; their corners lie at multiples of it.
inline constexpr int block_side_px = 4;

/// Fits a block of pixels. One tree of rectangles is grown for all of them; each pixel chooses its own smooth
/// part, rectangles and weights from it. Where the pixel that is explained worst does clearly better with a
/// tree of its own, the block is divided in four, down to single pixels, whose rectangles are then moved to
/// where they fit best. So coherent surfaces share the search, which is what costs, while mirrors and edges
/// pay for themselves. Final weights of a coherent block come from samples whose noise was reduced by what
/// the pixels have in common.
class BlockFitter {
 public:
  /// `mean_square`: of the picture's samples, over pixels, channels and images. Pixels whose error is small
  /// beside it are searched with less effort, and in those bright beside it rectangles cost less; 0: neither.
  BlockFitter(KernelCache& cache, int max_kernels, double mean_square, const FitTuning& tuning = {});

  /// `samples`: of the pixels of a rectangle of `width` pixels, row by row, at most block_side_px in each
  /// direction; an entry of null pointers is a pixel outside the mask. Returns kernels in the same order.
  /// `old`: empty, or for each pixel rectangles that it had in an earlier fit to fewer images; they take the
  /// place of trees where the error that they leave is small.
  std::vector<PixelKernels> fit(std::span<const PixelSamples> samples, int width,
                                std::span<const std::vector<Box>> old = {});

 private:
  struct Fitted {
    PixelKernels kernels;
    KernelChoice choice;
    std::array<double, 3> noise{};  // variance of a sample about the fit
  };
  struct Pixel {
    int index = 0;  // in the block
    int x = 0, y = 0;
    MaskedSamples samples;
    AlignedFloats values;            // [3 × extent], extended; what was not measured is filled in
    std::vector<Box> gap_boxes;      // of the tree that sees only what was measured
    std::span<const Box> old_boxes;  // of an earlier fit
    std::array<double, 3> noise_kept = {1.0, 1.0, 1.0};  // part of the noise variance left by pooling
    Fitted fitted;                                       // the last one accepted

    int count_in(const std::vector<int>& channels) const {
      int count = 0;
      for (const int c : channels) count += samples.count[c];
      return count;
    }
  };
  /// Pixels of a square that are fitted together.
  struct Group {
    std::vector<Pixel*> pixels;
    int side_px = block_side_px;
    bool reuses_old = false;  // old rectangles take the place of a tree
  };
  /// What a pixel passes on to the next of its group, which is like it. Changes the time and, through
  /// FitTuning::class_cutoff, the classes that are tried; so each group starts without any.
  struct Hints {
    ClassGuess smooth_class;
    std::vector<float> hats;  // weights, [hats × 3]
  };
  /// How thoroughly rectangles are sought: `full` looks at all channels and moves edges to the texel.
  enum class Effort { full, little };
  /// A tree and what chooses from it.
  struct Search {
    Search(KernelCache& cache, const FitTuning& tuning)
        : tree(cache, tuning.max_leaves), selector(cache.smooth(), tuning) {}
    TreeSearch tree;
    KernelSelector selector;
  };

  void load(Pixel& pixel, const PixelSamples& samples);
  /// Fits a group, or its worst pixel alone, and appends the parts that are still to be fitted to `pending`.
  void fit_group(const Group& group, std::vector<Group>& pending);
  void fit_single(Pixel& pixel, bool reuses_old);
  /// Appends the quarters of a group, but for one that holds nothing besides `fitted`.
  void divide(const Group& group, const Pixel& fitted, std::vector<Group>& pending) const;

  // Steps of fit_group().

  /// Makes the dictionary of shared_: old rectangles of the pixels, or a tree from means of similar pixels.
  void prepare_shared(const Group& group);
  void take_old(const std::vector<Pixel*>& pixels);
  void grow_shared(const std::vector<Pixel*>& pixels);
  /// The pixel with the largest part outside the space that a dictionary spans: most often the one that it
  /// explains worst.
  Pixel& farthest_from(const TreeDictionary& dictionary, const std::vector<Pixel*>& pixels) const;
  /// The fit with a tree of its own, where it is clearly better than the shared one.
  std::optional<Fitted> fit_better_alone(Pixel& pixel, bool reuses_old, Hints& hints);
  /// Reduces the pixels' noise by what they have in common, and solves for the weights again.
  void pool_and_solve(const std::vector<Pixel*>& pixels, Hints& hints);

  // Fits of one pixel.

  /// With a tree of its own, or its own old rectangles.
  Fitted fit_alone(Pixel& pixel, bool reuses_old, Hints& hints);
  /// With kernels chosen from the dictionary of a search.
  Fitted fit_from(Pixel& pixel, Search& search, Hints& hints);
  void set_weights(const Pixel& pixel, const PixelCoordinates& coordinates, Search& search, Hints& hints,
                   Fitted& fitted);
  /// For a pixel that lacks samples: prunes the rectangles found and those of the tree that sees only what
  /// was measured, down to what the information criterion bears, in exact fits to the measured samples.
  void prune_with_gaps(const Pixel& pixel, Fitted& fitted);
  /// Moves the edges of the rectangles to where they fit best, and splits rectangles where that pays.
  void refine(const Pixel& pixel, Fitted& fitted);
  void move_edges(const Pixel& pixel, Fitted& fitted);
  /// Splits rectangles of a pixel whose error matters, or the whole map beside them, as far as the
  /// information criterion rewards, and moves the edges of the parts. Returns whether it split any.
  bool split_boxes(const Pixel& pixel, Fitted& fitted);
  /// Takes the light's cells in place of rectangles that leave too much.
  void try_cells(const Pixel& pixel, Fitted& fitted);
  /// The rectangle whose split explains most of the residual of weighted_'s last fit; their number for none.
  /// `halves`: its parts, with its weights.
  std::size_t best_split(const PixelKernels& kernels, PixelKernels& halves);

  /// Channels that a tree is grown from: the brightest where its samples are enough, or all.
  std::vector<int> channels_to_search(const std::vector<Pixel*>& pixels) const;
  /// Sorts pixels into a few sets of similar ones, whose means stand for all in the search.
  AlikeSets sort_pixels(const std::vector<Pixel*>& pixels) const;
  /// Whether its error with this fit is at least this part of the picture's root mean square.
  bool matters(const Pixel& pixel, const PixelKernels& fit, double part) const;
  /// What a pixel deserves that is fitted like this.
  Effort effort_for(const Pixel& pixel, const PixelKernels& fit) const;
  double search_penalty_for(const MaskedSamples& samples) const;
  PixelCoordinates coordinates_of(const Pixel& pixel, const TreeDictionary& dictionary) const;

  KernelCache& cache_;
  const SmoothSpace& smooth_;
  const FitTuning tuning_;
  const int max_kernels_;
  const double mean_square_;
  const int images_;
  const std::size_t stride_, extent_;

  // Memory that is reused; nothing in it passes from one group to the next.
  GapFiller gap_filler_;
  Search shared_;  // of a group of pixels
  Search single_;  // of one of its pixels
  WeightedFit weighted_;
  CellFit cells_;
};

/// Hats that an estimation with these options uses.
HatGrid hats_of(const EstimateOptions& options, const LightDomain& domain, int images);

/// Fits blocks of pixels in the mode that the options ask for, before any spatial correction, with the memory
/// that a thread keeps between blocks.
class BlockModel {
 public:
  /// `mean_square`: see BlockFitter. `texels`: what refined mode chooses from beside rectangles; null for
  /// light with many degrees of freedom.
  BlockModel(const BoxTable& table, const EstimateOptions& options, double mean_square,
             std::shared_ptr<const TexelRegression> texels = nullptr);

  KernelCache& cache() { return cache_; }
  /// See BlockFitter::fit(); in the paper's modes, pixel by pixel and without `old`.
  std::vector<PixelKernels> fit(std::span<const PixelSamples> samples, int width,
                                std::span<const std::vector<Box>> old = {}, const RunContext& run = {});

 private:
  SmoothSpace smooth_;
  KernelCache cache_;
  std::optional<BlockFitter> block_;  // refined mode
  std::shared_ptr<const TexelRegression> texels_;
  std::optional<PixelFitter> pixel_;  // other modes
};

}  // namespace refield
