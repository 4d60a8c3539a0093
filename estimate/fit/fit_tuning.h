// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// The measured constants of the fit in refined mode: what trades time against error. Results depend on all
/// of them. "Error" is the relative root mean square error on held-out photographs;
/// docs/method/estimation.md says how to measure it. Measure on a clean and on a noisy capture after a
/// change.
struct FitTuning {
  // The search for rectangles.

  /// Leaves of the tree that a block of pixels shares. Twice what a pixel needs (about 25 kernels), since its
  /// pixels use different ones.
  int max_leaves = 48;
  /// Leaves of the tree that a part of a block shares: parts are divided again where that is too few.
  int leaves_of_part = 18;
  /// Leaves of the tree of a single pixel that is not worth full effort. With these three numbers at 40, 16
  /// and 28 the median pixel's error is 1 to 7 % larger; with 56, 20 and 40 it is the same, and the fit takes
  /// a tenth more time.
  int leaves_of_pixel = 36;
  /// Samples per leaf from which the brightest channel alone decides the splits; with fewer, all three do.
  /// Lower values miss small highlights: at 50 images they cost a fifth of the picture's error.
  int min_samples_per_leaf = 2;
  /// Costs of one rectangle in the information criterion for having been searched: 2 log D, where D ≈ 5000 is
  /// the number of rectangles that a tree can reach. A constant, so that criteria from different trees can be
  /// compared. On a noisy capture 17 to 22 are best and 12 costs 10 %; on a clean one 12 is 3 % better.
  double search_penalty = 17.0;
  /// Search penalty of pixels whose root mean square is `bright_ratio` times the picture's or more: they
  /// mirror or refract something bright, so small rectangles are more probable. Reduces the picture's error
  /// at 50 images by 8 % in natural light and 10 % under bars, at 180 images by 6 % and 0; without effect on
  /// noisy captures.
  double bright_search_penalty = 10.0;
  double bright_ratio = 2.0;

  // Which pixels are worth the effort. Errors are root mean squares relative to the picture's.

  /// Pixels with a larger error after the shared fit get full effort: all channels, all leaves, edges to the
  /// texel. They are few (mirrors, glass, highlights) but make most of the picture's error. Full effort for
  /// all takes three times as long, reduces the median pixel's error by a few per cent and the picture's by
  /// nothing.
  double full_effort_error = 0.05;
  /// Where rectangles of an earlier fit are known, only pixels with a larger error are searched anew. From
  /// 100 to 180 images, in processor time and error relative to a fresh fit: 0.02 takes 48 %, +3 % in natural
  /// light and +8 % under bars; 0.01 takes 53 %, +3 % and +6 %; 0.006 takes 60 %, +2 % and +6 %.
  double new_search_error = 0.01;
  /// A block is divided where the criterion of its worst pixel falls by more than this with a tree of its
  /// own. Lower values divide blocks because of noise.
  double min_criterion_gain = 15.0;
  /// And where that reduces the pixel's relative error by this much, in quadrature: photographs are seldom
  /// less noisy. 0 takes half as much time again (nearly twice on noise-free data) and reduces the median
  /// pixel's error by 5 %; 0.01 saves a quarter of the time and costs 12 %.
  double min_error_gain = 0.007;
  /// A tree of its own is grown for a pixel whose squared residual is this many times the reduction that
  /// min_error_gain asks for. Of the trees for smaller residuals, a third of all, 7 % divide a block.
  double residual_worth_a_tree = 3.0;
  /// Rectangles of pixels with a larger error are split after the tree; 0.05 has 3 % more error under bars.
  double split_error = 0.01;
  /// Pixels with a larger error than this after all splits are fitted on cells of the light map. With 0.03
  /// they are twice as many, and the picture's error is 1 to 2 % smaller.
  double cells_error = 0.05;
  /// Whether they are: not with a limit of kernels, nor beside TexelRegression.
  bool fits_cells = true;

  // Iterations.

  /// Times that edges are moved and weights solved again, with full effort; with little effort once. A
  /// further step is made only where it reduces the residual, so more cost time and never error on the
  /// samples.
  int edge_refinements = 2;
  /// Rounds of splits, edges moved between them (one: -8 %, three: -15 %), unrewarded splits that end one.
  int split_rounds = 3;
  int split_patience = 3;
  /// Times that samples which were not measured are predicted from a fit and kernels chosen again. Only
  /// pixels that are clipped in all exposures pay for it; with 1 they keep the first guess of their missing
  /// samples.
  int gap_fillings = 3;
  /// Rectangles in a row without reward from the criterion after which a pursuit ends: a shape may need
  /// several rectangles before it pays. Lower values end the pursuit in front of such shapes; time grows with
  /// it.
  int patience = 6;
  /// A class of smoothness whose criterion was worse by more than this is not tried for the group's next
  /// pixel. 12 to 30 take half the time of trying all, and change errors by a few per cent either way.
  double class_cutoff = 20.0;
};

}  // namespace refield
