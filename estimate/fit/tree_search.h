// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "estimate/fit/kernel_cache.h"
#include "estimate/fit/nnls.h"

namespace refield {

/// All rectangles of a grown kd-tree, from the whole light map to its leaves, as coordinates: first in an
/// orthonormal basis Q of the space that the columns span, then, from `smooth_offset`, Vᵀa (see SmoothSpace).
template <class Real>
struct BoxCoordinates {
  std::vector<Box> boxes;
  int rank = 0;  ///< vectors of Q
  std::size_t smooth_offset = 0;
  std::size_t coordinate_stride = 0;  ///< numbers per rectangle and channel
  std::array<std::vector<Real, AlignedAllocator<Real>>, 3> coordinates;  ///< [boxes × coordinate_stride]
  std::array<AlignedFloats, 3> basis;                                    ///< Q, [rank × stride]

  int size() const { return static_cast<int>(boxes.size()); }
  const Real* column(int channel, int box) const {
    return coordinates[channel].data() + box * coordinate_stride;
  }
};
using TreeDictionary = BoxCoordinates<float>;

/// Vectors that one tree shall explain together, [3][targets] of `stride` floats each. Channels without
/// targets cost little: where colours vary alike, one tells of nearly all splits what three would.
using SearchTargets = std::array<std::vector<const float*>, 3>;

/// How TreeSearch fits several targets: fast, in single precision.
struct SharedFit {
  using Real = float;
  static constexpr bool splits_dark_leaves = false;
  static constexpr bool keeps_solver = true;    ///< NNLS goes on from split to split
  static constexpr bool targets_first = false;  ///< in products with a direction, before the basis
};

/// Grows a kd-tree of rectangles greedily (Matusik et al. 2004, section 5.2) for several targets at once,
/// each with non-negative weights of its own: starts from the whole light map and splits the leaf that serves
/// best, solving for the weights after each split. How a split is scored is the derived class's choice;
/// best_by_gain() is the fast one.
///
/// The fit lives in coordinates of an orthonormal basis Q of the space that the leaves' columns span.
/// Replacing a leaf by its halves keeps that space and adds one direction, so Q grows by a vector a step, and
/// each candidate split keeps its coordinates in Q, its remaining squared norm and its products with the
/// targets up to date at the cost of one inner product over images a step. Gram matrices come from
/// coordinates. Limit: the loads of the candidates' directions from the second-level cache.
template <class Policy>
class GreedyTree {
 public:
  static constexpr int max_targets = 4;

 protected:
  using Real = typename Policy::Real;
  struct Candidate {
    Split* split;
    int leaf;
    int slot;                                                    // of its coordinates
    std::array<float, 3> remaining_norm2;                        // ‖d⊥‖²
    std::array<std::array<float, max_targets>, 3> with_targets;  // ⟨d, target⟩
  };
  /// Fit to one target of one channel.
  struct Fit {
    const float* target = nullptr;
    double squared = 0.0;
    std::vector<double> in_basis;      // y = Qᵀ target
    std::vector<double> fit_in_basis;  // z = Qᵀ A x
    std::vector<double> with_target;   // h = Aᵀ target, of the leaves
    std::vector<double> weights;       // x
    NnlsSolver nnls;
  };

  /// `smooth_rank`: of the smooth part's coordinates that the rectangles keep.
  GreedyTree(KernelCache& cache, int max_leaves, int smooth_rank);

  /// Coordinates in a basis of at most `leaves` vectors, without gaps.
  void lay_out(int leaves);
  /// `measured` [3 × stride]: 1 where the targets were measured, else 0 as they are; null where all were.
  void start(const SearchTargets& targets, const float* measured = nullptr);
  void add_direction(const std::array<const float*, 3>& direction);
  /// Finds the splits of leaves that are to be split, after solve() changed weights.
  void update_candidates();
  void split(int candidate);
  void solve();
  /// The candidate of the largest projected gain ⟨d,r⟩²/‖d⊥‖² summed over targets and channels, d⊥ being the
  /// part of its direction outside the space that the leaves span and r the residual of the non-negative fit;
  /// −1 where none gains.
  int best_by_gain();
  double squared_residual() const;
  /// Whether such a residual is the rounding of float32 columns.
  bool is_exact(double squared_residual) const;

  int leaves() const { return static_cast<int>(leaf_node_.size()); }
  const Box& leaf_box(int leaf) const { return dictionary_.boxes[leaf_node_[leaf]]; }
  const Real* leaf_coordinates(int channel, int leaf) const {
    return dictionary_.column(channel, leaf_node_[leaf]);
  }
  Real* coordinates(int channel, int node) {
    return dictionary_.coordinates[channel].data() + node * dictionary_.coordinate_stride;
  }
  float* candidate_coordinates(int channel, int slot) {
    return candidate_coordinates_[channel].data() + slot * candidate_stride_;
  }
  float* basis(int channel, int k) { return dictionary_.basis[channel].data() + k * stride_; }

  /// Directions that keep less than this part of their squared norm after projection are rounding noise of
  /// float32 sums.
  static constexpr Real dependence_tolerance = static_cast<Real>(1e-6);

  KernelCache& cache_;
  int max_leaves_;
  std::size_t stride_;
  int smooth_rank_;
  BoxCoordinates<Real> dictionary_;
  std::array<int, 3> target_count_{};
  std::array<std::array<Fit, max_targets>, 3> fits_;
  double squared_targets_ = 0.0;
  std::vector<Candidate> candidates_;
  std::array<std::vector<double>, 3> gram_;   // of the leaves, [max_leaves × max_leaves]
  std::array<std::vector<float>, 3> newest_;  // coordinates of the newest direction in Q

 private:
  void add_candidates(int leaf);
  void remove_candidates(int leaf);
  bool is_to_be_split(int leaf) const;
  void update_gram(int leaf);

  std::size_t candidate_stride_;
  const float* measured_ = nullptr;
  std::vector<int> leaf_node_;
  std::vector<char> has_candidates_;  // of the leaves
  std::vector<int> free_slots_;
  int slots_ = 0;
  std::array<AlignedFloats, 3> candidate_coordinates_;  // [slots × candidate_stride], zero beyond the basis
  AlignedFloats scratch_;
  std::vector<const float*> pointers_;
  std::vector<float> products_, gains_;
};

/// The tree of several pixels at once.
///
/// Deviations from the paper: splits at thirds and halves; splits are scored by best_by_gain(), instead of
/// solving for each candidate; only leaves with a positive weight are split, since dark ones would use up
/// splits.
class TreeSearch : public GreedyTree<SharedFit> {
 public:
  TreeSearch(KernelCache& cache, int max_leaves);

  /// At most `leaves` leaves. `measured`: samples behind a target of all its channels, for the criterion that
  /// ends the growth.
  const TreeDictionary& grow(const SearchTargets& targets, double measured, int leaves);
  /// A dictionary of given rectangles, at most `max_leaves`, instead of a tree's; the whole light map comes
  /// first.
  const TreeDictionary& take(std::span<const Box> boxes);
  /// The last one made.
  const TreeDictionary& dictionary() const { return dictionary_; }
};

}  // namespace refield
