// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/tree_search.h"

#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/select_kernels.h"

namespace refield {

namespace {
/// A fit this close to the targets (relative, squared) has reached the precision of float32 columns.
constexpr double exact_fit = 1e-10;
/// Growth ends after this many splits in a row that the information criterion does not reward: it may take
/// several to reach a small highlight.
constexpr int splits_of_patience = 8;
}  // namespace

template <class Policy>
GreedyTree<Policy>::GreedyTree(KernelCache& cache, int max_leaves, int smooth_rank)
    : cache_(cache),
      max_leaves_(max_leaves),
      stride_(cache.smooth().stride()),
      smooth_rank_(smooth_rank),
      candidate_stride_(padded_length(max_leaves)),
      scratch_(std::max(padded_length(max_leaves), stride_)) {
  lay_out(max_leaves);
  for (int c = 0; c < 3; ++c) {
    dictionary_.coordinates[c].resize(2 * max_leaves * dictionary_.coordinate_stride);
    dictionary_.basis[c].resize(max_leaves * stride_);
    newest_[c].resize(max_leaves);
    gram_[c].resize(static_cast<std::size_t>(max_leaves) * max_leaves);
    for (Fit& fit : fits_[c])
      for (auto* vector : {&fit.in_basis, &fit.fit_in_basis, &fit.with_target, &fit.weights})
        vector->resize(max_leaves);
  }
  pointers_.resize(8 * max_leaves + 8);
  products_.resize(pointers_.size());
}

template <class Policy>
void GreedyTree<Policy>::lay_out(int leaves) {
  dictionary_.smooth_offset = leaves;
  dictionary_.coordinate_stride = padded_length(leaves + smooth_rank_);
}

template <class Policy>
double GreedyTree<Policy>::squared_residual() const {
  // In the basis: ‖b‖² − 2 yᵀz + ‖z‖².
  double sum = 0.0;
  for (int c = 0; c < 3; ++c)
    for (int t = 0; t < target_count_[c]; ++t) {
      const Fit& fit = fits_[c][t];
      double inside = fit.squared;
      for (int k = 0; k < dictionary_.rank; ++k)
        inside += fit.fit_in_basis[k] * (fit.fit_in_basis[k] - 2.0 * fit.in_basis[k]);
      sum += std::max(inside, 0.0);
    }
  return sum;
}

template <class Policy>
bool GreedyTree<Policy>::is_exact(double squared_residual) const {
  return squared_residual <= exact_fit * squared_targets_;
}

template <class Policy>
void GreedyTree<Policy>::start(const SearchTargets& targets, const float* measured) {
  measured_ = measured;
  squared_targets_ = 0.0;
  for (int c = 0; c < 3; ++c) {
    target_count_[c] = std::min(static_cast<int>(targets[c].size()), max_targets);
    for (int t = 0; t < target_count_[c]; ++t) {
      Fit& fit = fits_[c][t];
      fit.target = targets[c][t];
      fit.squared = 0.0;
      for (std::size_t j = 0; j < stride_; ++j)
        fit.squared += static_cast<double>(fit.target[j]) * fit.target[j];
      squared_targets_ += fit.squared;
      fit.weights[0] = 0.0;
      if constexpr (Policy::keeps_solver) fit.nnls.start(max_leaves_);
    }
  }
  dictionary_.boxes.clear();
  dictionary_.rank = 0;
  candidates_.clear();
  free_slots_.clear();
  slots_ = 0;
  const LightDomain& domain = cache_.table().domain();
  const Box all{0, 0, domain.width, domain.height};
  dictionary_.boxes.push_back(all);
  leaf_node_.assign(1, 0);
  const auto root = cache_.column(all);
  add_direction(root);
  for (int c = 0; c < 3; ++c) {
    Real* coordinate = coordinates(c, 0);
    std::fill_n(coordinate, dictionary_.coordinate_stride, Real{0});
    coordinate[0] = newest_[c][0];
    std::copy_n(root[c] + stride_, smooth_rank_, coordinate + dictionary_.smooth_offset);
  }
  update_gram(0);
  has_candidates_.assign(1, 0);
}

template <class Policy>
void GreedyTree<Policy>::add_direction(const std::array<const float*, 3>& direction) {
  const int rank = dictionary_.rank;
  for (int c = 0; c < 3; ++c) {
    float* q = basis(c, rank);
    if (measured_)
      std::transform(direction[c], direction[c] + stride_, measured_ + c * stride_, q, std::multiplies<>());
    else
      std::copy_n(direction[c], stride_, q);
    for (int k = 0; k < rank; ++k) pointers_[k] = basis(c, k);
    std::ranges::fill(newest_[c], 0.0f);
    newest_[c][rank] = orthonormalise(q, pointers_.data(), rank, stride_, newest_[c].data());
    if (target_count_[c] == 0) continue;

    for (int t = 0; t < target_count_[c]; ++t) {
      float product = 0.0f;
      dots(q, &fits_[c][t].target, 1, stride_, &product);
      fits_[c][t].in_basis[rank] = product;
    }
    for (std::size_t i = 0; i < candidates_.size(); ++i) pointers_[i] = candidates_[i].split->direction[c];
    dots(q, pointers_.data(), candidates_.size(), stride_, products_.data());
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      candidate_coordinates(c, candidates_[i].slot)[rank] = products_[i];
      candidates_[i].remaining_norm2[c] -= products_[i] * products_[i];
    }
  }
  ++dictionary_.rank;
}

template <class Policy>
void GreedyTree<Policy>::add_candidates(int leaf) {
  has_candidates_[leaf] = 1;
  const std::size_t first = candidates_.size();
  for (Split& split : cache_.splits(dictionary_.boxes[leaf_node_[leaf]])) {
    int slot = slots_;
    if (free_slots_.empty()) {
      ++slots_;
      for (auto& memory : candidate_coordinates_)
        if (memory.size() < slots_ * candidate_stride_) memory.resize(2 * slots_ * candidate_stride_);
    } else {
      slot = free_slots_.back();
      free_slots_.pop_back();
    }
    candidates_.push_back({&split, leaf, slot, {}, {}});
  }
  const int rank = dictionary_.rank;
  for (int c = 0; c < 3; ++c) {
    if (target_count_[c] == 0) continue;
    const int first_target = Policy::targets_first ? 0 : rank,
              first_of_basis = Policy::targets_first ? target_count_[c] : 0;
    for (int k = 0; k < rank; ++k) pointers_[first_of_basis + k] = basis(c, k);
    for (int t = 0; t < target_count_[c]; ++t) pointers_[first_target + t] = fits_[c][t].target;
    for (std::size_t i = first; i < candidates_.size(); ++i) {
      Candidate& candidate = candidates_[i];
      cache_.make(*candidate.split, c);
      if (i + 1 < candidates_.size()) cache_.prefetch(*candidates_[i + 1].split, c);
      candidate.remaining_norm2[c] = candidate.split->norm2[c];
      const float* d = candidate.split->direction[c];
      if (measured_) {
        std::transform(d, d + stride_, measured_ + c * stride_, scratch_.data(), std::multiplies<>());
        dots(scratch_.data(), &d, 1, stride_, &candidate.remaining_norm2[c]);
      }
      dots(d, pointers_.data(), rank + target_count_[c], stride_, products_.data());
      float* coordinate = candidate_coordinates(c, candidate.slot);
      std::fill_n(coordinate, candidate_stride_, 0.0f);
      for (int k = 0; k < rank; ++k) {
        coordinate[k] = products_[first_of_basis + k];
        candidate.remaining_norm2[c] -= coordinate[k] * coordinate[k];
      }
      for (int t = 0; t < target_count_[c]; ++t) candidate.with_targets[c][t] = products_[first_target + t];
    }
  }
}

template <class Policy>
int GreedyTree<Policy>::best_by_gain() {
  gains_.assign(candidates_.size(), 0.0f);
  for (int c = 0; c < 3; ++c) {
    if (target_count_[c] == 0) continue;
    for (std::size_t i = 0; i < candidates_.size(); ++i)
      pointers_[i] = candidate_coordinates(c, candidates_[i].slot);
    for (int t = 0; t < target_count_[c]; ++t) {
      const Fit& fit = fits_[c][t];
      std::fill_n(scratch_.begin(), padded_length(dictionary_.rank), 0.0f);
      for (int k = 0; k < dictionary_.rank; ++k) scratch_[k] = static_cast<float>(fit.fit_in_basis[k]);
      dots(scratch_.data(), pointers_.data(), candidates_.size(), padded_length(dictionary_.rank),
           products_.data());
      for (std::size_t i = 0; i < candidates_.size(); ++i) {
        const Candidate& candidate = candidates_[i];
        if (!(candidate.remaining_norm2[c] > dependence_tolerance * candidate.split->norm2[c])) continue;
        const float correlation = candidate.with_targets[c][t] - products_[i];
        gains_[i] += correlation * correlation / candidate.remaining_norm2[c];
      }
    }
  }
  const auto best = std::ranges::max_element(gains_);
  return best == gains_.end() || !(*best > 0.0f) ? -1 : static_cast<int>(best - gains_.begin());
}

template <class Policy>
void GreedyTree<Policy>::split(int chosen) {
  Split& split = *candidates_[chosen].split;
  for (int c = 0; c < 3; ++c) cache_.make(split, c);
  const int leaf = candidates_[chosen].leaf;
  const int parent = leaf_node_[leaf];
  remove_candidates(leaf);
  add_direction(split.direction);
  const int first = dictionary_.size();
  dictionary_.boxes.push_back(split.first);
  dictionary_.boxes.push_back(split.second);
  const int other_leaf = static_cast<int>(leaf_node_.size());
  leaf_node_[leaf] = first;
  leaf_node_.push_back(first + 1);
  for (int c = 0; c < 3; ++c) {
    // The halves are a₁ = d + f p and a₂ = p − a₁, in coordinates as in images.
    const Real* p = coordinates(c, parent);
    Real* one = coordinates(c, first);
    Real* other = coordinates(c, first + 1);
    std::fill_n(one, dictionary_.coordinate_stride, Real{0});
    std::copy_n(newest_[c].data(), dictionary_.rank, one);
    if (smooth_rank_ > 0)
      std::copy_n(cache_.smooth_coordinates(split, c), smooth_rank_, one + dictionary_.smooth_offset);
    for (std::size_t k = 0; k < dictionary_.coordinate_stride; ++k) {
      one[k] += split.fraction[c] * p[k];
      other[k] = p[k] - one[k];
    }
    for (int t = 0; t < target_count_[c]; ++t) {
      if constexpr (Policy::keeps_solver) fits_[c][t].nnls.drop(leaf);
      fits_[c][t].weights[other_leaf] = fits_[c][t].weights[leaf];
    }
  }
  update_gram(leaf);
  update_gram(other_leaf);
  has_candidates_.push_back(0);
}

template <class Policy>
bool GreedyTree<Policy>::is_to_be_split(int leaf) const {
  if constexpr (Policy::splits_dark_leaves) return true;
  for (int c = 0; c < 3; ++c)
    for (int t = 0; t < target_count_[c]; ++t)
      if (fits_[c][t].weights[leaf] > 0.0) return true;
  return false;
}

template <class Policy>
void GreedyTree<Policy>::remove_candidates(int leaf) {
  for (const Candidate& candidate : candidates_)
    if (candidate.leaf == leaf) free_slots_.push_back(candidate.slot);
  std::erase_if(candidates_, [&](const Candidate& candidate) { return candidate.leaf == leaf; });
  has_candidates_[leaf] = 0;
}

template <class Policy>
void GreedyTree<Policy>::update_candidates() {
  for (int leaf = 0; leaf < leaves(); ++leaf) {
    if (is_to_be_split(leaf) == static_cast<bool>(has_candidates_[leaf])) continue;
    if (has_candidates_[leaf])
      remove_candidates(leaf);
    else
      add_candidates(leaf);
  }
}

template <class Policy>
void GreedyTree<Policy>::update_gram(int leaf) {
  const int rank = dictionary_.rank;
  for (int c = 0; c < 3; ++c) {
    if (target_count_[c] == 0) continue;
    const Real* a = leaf_coordinates(c, leaf);
    const auto set = [&](int l, double product) {
      gram_[c][static_cast<std::size_t>(leaf) * max_leaves_ + l] =
          gram_[c][static_cast<std::size_t>(l) * max_leaves_ + leaf] = product;
    };
    if constexpr (std::is_same_v<Real, float>) {
      // What lies behind the basis' coordinates is the smooth part's: not of this metric.
      const std::size_t length = padded_length(rank);
      std::fill_n(scratch_.begin(), length, 0.0f);
      std::copy_n(a, rank, scratch_.data());
      for (int l = 0; l < leaves(); ++l) pointers_[l] = leaf_coordinates(c, l);
      dots(scratch_.data(), pointers_.data(), leaves(), length, products_.data());
      for (int l = 0; l < leaves(); ++l) set(l, products_[l]);
    } else {
      for (int l = 0; l < leaves(); ++l) {
        const Real* other = leaf_coordinates(c, l);
        double product = 0.0;
        for (int k = 0; k < rank; ++k) product += a[k] * other[k];
        set(l, product);
      }
    }
    for (int t = 0; t < target_count_[c]; ++t) {
      Fit& fit = fits_[c][t];
      double h = 0.0;
      for (int k = 0; k < dictionary_.rank; ++k) h += a[k] * fit.in_basis[k];
      fit.with_target[leaf] = h;
    }
  }
}

template <class Policy>
void GreedyTree<Policy>::solve() {
  const int count = leaves();
  for (int c = 0; c < 3; ++c)
    for (int t = 0; t < target_count_[c]; ++t) {
      Fit& fit = fits_[c][t];
      if constexpr (Policy::keeps_solver)
        fit.nnls.proceed(gram_[c].data(), max_leaves_, fit.with_target.data(), count, fit.weights.data());
      else
        fit.nnls.solve(gram_[c].data(), max_leaves_, fit.with_target.data(), count, fit.weights.data());
      std::fill_n(fit.fit_in_basis.begin(), dictionary_.rank, 0.0);
      for (int l = 0; l < count; ++l) {
        const double x = fit.weights[l];
        if (x == 0.0) continue;
        const Real* a = leaf_coordinates(c, l);
        for (int k = 0; k < dictionary_.rank; ++k) fit.fit_in_basis[k] += x * a[k];
      }
    }
}

template class GreedyTree<SharedFit>;
template class GreedyTree<PixelFit>;

TreeSearch::TreeSearch(KernelCache& cache, int max_leaves)
    : GreedyTree(cache, max_leaves, cache.smooth().rank()) {}

const TreeDictionary& TreeSearch::grow(const SearchTargets& targets, double measured, int leaves) {
  leaves = std::min(leaves, max_leaves_);
  lay_out(leaves);
  start(targets);
  solve();
  const int count = *std::ranges::max_element(target_count_);
  double best_criterion = std::numeric_limits<double>::infinity();
  int unrewarded = 0;
  while (this->leaves() < leaves) {
    const double residual = squared_residual();
    if (is_exact(residual)) break;
    int parameters = 0;
    for (int c = 0; c < 3; ++c)
      for (int t = 0; t < target_count_[c]; ++t)
        for (int l = 0; l < this->leaves(); ++l) parameters += fits_[c][t].weights[l] > 0.0;
    const double criterion = information_criterion(residual, squared_targets_, measured * count, parameters);
    unrewarded = criterion < best_criterion ? 0 : unrewarded + 1;
    best_criterion = std::min(best_criterion, criterion);
    if (unrewarded == splits_of_patience) break;
    update_candidates();
    const int best = best_by_gain();
    if (best < 0) break;
    split(best);
    solve();
  }
  return dictionary_;
}

const TreeDictionary& TreeSearch::take(std::span<const Box> boxes) {
  lay_out(max_leaves_);
  target_count_ = {};
  dictionary_.boxes.clear();
  dictionary_.rank = 0;
  candidates_.clear();
  const LightDomain& domain = cache_.table().domain();
  std::vector<Box> all = {{0, 0, domain.width, domain.height}};
  for (const Box& box : boxes)
    if (static_cast<int>(all.size()) < max_leaves_ && !(box == all.front())) all.push_back(box);
  for (const Box& box : all) {
    const auto column = cache_.column(box);
    add_direction(column);
    const int node = dictionary_.size();
    dictionary_.boxes.push_back(box);
    for (int c = 0; c < 3; ++c) {
      float* coordinate = coordinates(c, node);
      std::fill_n(coordinate, dictionary_.coordinate_stride, 0.0f);
      std::copy_n(newest_[c].data(), dictionary_.rank, coordinate);
      std::copy_n(column[c] + stride_, smooth_rank_, coordinate + dictionary_.smooth_offset);
    }
  }
  return dictionary_;
}

}  // namespace refield
