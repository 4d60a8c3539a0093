// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <span>
#include <vector>

#include "estimate/fit/kernel_cache.h"
#include "estimate/fit/nnls.h"

namespace refield {

/// All rectangles of a grown kd-tree, from the whole light map to its leaves, as coordinates: first in an
/// orthonormal basis Q of the space that the columns span, then, from `smooth_offset`, Vᵀa (see SmoothSpace).
struct TreeDictionary {
  std::vector<Box> boxes;
  int rank = 0;  ///< vectors of Q
  std::size_t smooth_offset = 0;
  std::size_t coordinate_stride = 0;         ///< floats a rectangle and channel
  std::array<AlignedFloats, 3> coordinates;  ///< [boxes × coordinate_stride]
  std::array<AlignedFloats, 3> basis;        ///< Q, [rank × stride]

  int size() const { return static_cast<int>(boxes.size()); }
  const float* column(int channel, int box) const {
    return coordinates[channel].data() + box * coordinate_stride;
  }
};

/// Vectors that one tree shall explain together, [3][targets] of `stride` floats each. Channels without
/// targets cost little: where colours vary alike, one tells of nearly all splits what three would.
using SearchTargets = std::array<std::vector<const float*>, 3>;

/// Grows a kd-tree of rectangles greedily (Matusik et al. 2004, section 5.2) for several targets at once,
/// each with non-negative weights of its own.
///
/// Deviations from the paper: splits at thirds and halves; a split is scored by its projected gain
/// ⟨d,r⟩²/‖d⊥‖² summed over targets and channels, d⊥ being the part of its direction outside the space that
/// the leaves span and r the residual of the non-negative fit, instead of solving for each candidate; only
/// leaves with a positive weight are split, since dark ones would use up splits.
///
/// The fit lives in coordinates of an orthonormal basis Q of the space that the leaves' columns span.
/// Replacing a leaf by its halves keeps that space and adds one direction, so Q grows by a vector a step, and
/// each candidate keeps its coordinates at the cost of one inner product over images a step. Limit: the loads
/// of the candidates' directions from the second-level cache.
class TreeSearch {
 public:
  static constexpr int max_targets = 4;

  TreeSearch(KernelCache& cache, int max_leaves);

  /// At most `leaves` leaves. `measured`: samples behind a target of all its channels, for the criterion that
  /// ends the growth.
  const TreeDictionary& grow(const SearchTargets& targets, double measured, int leaves);
  /// A dictionary of given rectangles, at most `max_leaves`, instead of a tree's; the whole light map comes
  /// first.
  const TreeDictionary& take(std::span<const Box> boxes);
  /// The last one made.
  const TreeDictionary& dictionary() const { return dictionary_; }

 private:
  struct Candidate {
    Split* split;
    int leaf;
    int slot;                                                    // of its coordinates
    std::array<float, 3> remaining_norm2;                        // ‖d⊥‖²
    std::array<std::array<float, max_targets>, 3> with_targets;  // ⟨d, target⟩
  };
  /// Of one target and channel.
  struct Fit {
    const float* target = nullptr;
    double squared = 0.0;
    std::vector<double> in_basis;      // y = Qᵀ target
    std::vector<double> fit_in_basis;  // z = Qᵀ A x
    std::vector<double> with_target;   // h = Aᵀ target, of the leaves
    std::vector<double> weights;       // x
    NnlsSolver nnls;                   // goes on from split to split
  };
  /// Coordinates in a basis of at most `leaves` vectors, without gaps.
  void lay_out(int leaves);
  void start(const SearchTargets& targets);
  void add_direction(const std::array<const float*, 3>& direction);
  /// Those of leaves with a positive weight, after solve() changed weights.
  void update_candidates();
  void add_candidates(int leaf);
  void remove_candidates(int leaf);
  bool has_weight(int leaf) const;
  void split(int candidate);
  void update_gram(int leaf);
  void solve();
  int best_candidate();
  double squared_residual() const;
  float* coordinates(int channel, int node) {
    return dictionary_.coordinates[channel].data() + node * dictionary_.coordinate_stride;
  }
  float* candidate_coordinates(int channel, int slot) {
    return candidate_coordinates_[channel].data() + slot * candidate_stride_;
  }
  float* basis(int channel, int k) { return dictionary_.basis[channel].data() + k * stride_; }

  KernelCache& cache_;
  int max_leaves_;
  int leaves_asked_ = 0;
  std::size_t stride_, candidate_stride_;
  int smooth_rank_;
  TreeDictionary dictionary_;
  std::vector<int> leaf_node_;
  std::vector<char> has_candidates_;  // of the leaves
  std::array<int, 3> target_count_{};
  std::array<std::array<Fit, max_targets>, 3> fits_;
  double squared_targets_ = 0.0;
  std::vector<Candidate> candidates_;
  std::vector<int> free_slots_;
  int slots_ = 0;
  std::array<AlignedFloats, 3> candidate_coordinates_;  // [slots × candidate_stride]
  std::array<std::vector<double>, 3> gram_;             // of the leaves, [max_leaves × max_leaves]
  std::array<std::vector<float>, 3> newest_;            // coordinates of the newest direction in Q
  AlignedFloats scratch_;
  std::vector<const float*> pointers_;
  std::vector<float> products_, gains_;
};

}  // namespace refield
