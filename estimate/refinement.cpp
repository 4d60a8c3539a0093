// SPDX-License-Identifier: Apache-2.0
#include "estimate/refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "core/errors.h"
#include "core/metrics.h"
#include "core/reflectance_field_file.h"
#include "estimate/select_kernels.h"

namespace refield {

namespace {

/// Squared error on new images over that on a pixel's own. Choosing kernels by its own images makes 2 common.
constexpr double far_worse = 4.0;

/// Names of the frames that a field was made from.
std::set<std::string> frames_of(const ReflectanceField& field, const std::filesystem::path& path) {
  const auto provenance = nlohmann::json::parse(field.provenance, nullptr, false);
  std::set<std::string> names;
  if (provenance.is_object() && provenance.contains("frames") && provenance["frames"].is_array())
    for (const auto& name : provenance["frames"])
      if (name.is_string()) names.insert(name.get<std::string>());
  if (names.empty())
    throw InputError(path.string() +
                     ": does not say which images it was estimated from; refine a field that 'refield "
                     "estimate' wrote");
  return names;
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "×" + std::to_string(height);
}

double criterion_of(const PixelKernels& kernels, const MaskedSamples& samples) {
  const auto parameters = std::ranges::count_if(kernels.weights, [](float w) { return w > 0.0f; });
  return information_criterion(
      kernels.squared_residual, samples.squared[0] + samples.squared[1] + samples.squared[2],
      samples.count[0] + samples.count[1] + samples.count[2], static_cast<int>(parameters));
}

/// Squared relative error of the old kernels on the new images over that on their own; infinite without
/// kernels.
double surprise(const Refinement& refinement, const PixelKernels& old, const KernelSet& set,
                const PixelSamples& samples, const BoxTable& table) {
  if (old.boxes.empty()) return std::numeric_limits<double>::infinity();
  double error = 0.0, signal = 0.0;
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < table.images(); ++j) {
      const float b = samples[c][j];
      if (!refinement.is_new(j) || std::isnan(b)) continue;
      double predicted = 0.0;
      for (std::size_t k = 0; k < old.boxes.size(); ++k)
        predicted += static_cast<double>(old.weights[3 * k + c]) * set.columns[k][c * table.stride() + j];
      error += (predicted - b) * (predicted - b);
      signal += static_cast<double>(b) * b;
    }
  constexpr double least = 1e-12;  // float32's own error
  return signal > 0.0 ? error / signal / std::max(old.squared_residual, least) : 0.0;
}

}  // namespace

Refinement::Refinement(const std::filesystem::path& path, const CaptureSession& session,
                       std::span<const CaptureFrame> frames)
    : path_(path), field_(read_reflectance_field(path)) {
  if (field_.width != session.width || field_.height != session.height)
    throw InputError(path.string() + ": is a field of " + size_text(field_.width, field_.height) +
                     " pixels, the photographs are " + size_text(session.width, session.height) +
                     "; refine a field of the same capture");
  if (field_.basis.domain != session.light)
    throw InputError(path.string() + ": takes light maps of " +
                     size_text(field_.basis.domain.width, field_.basis.domain.height) + " (" +
                     std::string(name_of(field_.basis.domain.parameterisation)) + "), the capture's are " +
                     size_text(session.light.width, session.light.height) + " (" +
                     std::string(name_of(session.light.parameterisation)) +
                     "); refine a field of the same capture");
  known_names_ = frames_of(field_, path);
  std::set<std::string> missing = known_names_;
  for (const CaptureFrame& frame : frames) missing.erase(frame.name);
  if (!missing.empty())
    throw InputError(path.string() + ": was estimated from frame '" + *missing.begin() + "'" +
                     (missing.size() > 1 ? " and " + std::to_string(missing.size() - 1) + " more" : "") +
                     " that the capture does not hold; refine with all old images beside the new ones");
  use_frames(frames);
  if (std::ranges::count(is_new_, 1) == 0)
    throw InputError(path.string() + ": was estimated from all " + std::to_string(frames.size()) +
                     " training images already; there is nothing to take in");
  weigh_errors();
}

void Refinement::use_frames(std::span<const CaptureFrame> frames) {
  is_new_.clear();
  for (const CaptureFrame& frame : frames) is_new_.push_back(known_names_.contains(frame.name) ? 0 : 1);
}

void Refinement::weigh_errors() {
  const SparseTransfer& transfer = field_.transfer;
  const std::vector<float>& error =
      field_.predicted_error.empty() ? field_.training_error : field_.predicted_error;
  radiant_error_.assign(transfer.rows(), 0.0f);
  std::vector<float> positive;
  for (std::size_t p = 0; p < radiant_error_.size(); ++p) {
    double energy = 0.0;
    for (std::uint64_t e = transfer.row_start[p]; e < transfer.row_start[p + 1]; ++e)
      energy += static_cast<double>(field_.basis.boxes[transfer.column[e]].area()) *
                (transfer.weight[3 * e] + transfer.weight[3 * e + 1] + transfer.weight[3 * e + 2]);
    radiant_error_[p] = static_cast<float>(energy * (error.empty() ? 1.0 : error[p]));
    if (radiant_error_[p] > 0.0f) positive.push_back(radiant_error_[p]);
  }
  if (!positive.empty()) error_that_matters_ = static_cast<float>(quantile(std::move(positive), 0.9));
}

PixelKernels Refinement::kernels(std::size_t pixel) const {
  PixelKernels kernels;
  const SparseTransfer& transfer = field_.transfer;
  for (std::uint64_t e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e) {
    kernels.boxes.push_back(field_.basis.boxes[transfer.column[e]]);
    kernels.weights.insert(kernels.weights.end(),
                           transfer.weight.begin() + static_cast<std::ptrdiff_t>(3 * e),
                           transfer.weight.begin() + static_cast<std::ptrdiff_t>(3 * e + 3));
  }
  if (!field_.training_error.empty()) {
    kernels.squared_samples = 1.0;
    kernels.squared_residual = std::pow(field_.training_error[pixel], 2.0);
  }
  return kernels;
}

void refine_pixels(const Refinement& refinement, std::span<const PixelToRefine> group, KernelCache& cache,
                   PixelFitter& tree, WeightFitter& weights) {
  const BoxTable& table = cache.table();
  std::vector<std::pair<double, std::size_t>> worst_first;
  MaskedSamples masked;
  std::size_t needed = 0;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const PixelKernels old = refinement.kernels(group[i].pixel);
    const KernelSet set = prepare_kernel_set(old.boxes, cache);
    double rank = surprise(refinement, old, set, group[i].samples, table);
    if (rank > far_worse || refinement.matters(group[i].pixel)) {
      rank = std::numeric_limits<double>::infinity();
      ++needed;
    }
    worst_first.emplace_back(-rank, i);
    if (old.boxes.empty()) continue;
    masked.assign(group[i].samples, table.stride(), table.images());
    *group[i].kernels = weights.fit(set, masked, old.weights);
  }
  std::ranges::sort(worst_first);
  for (std::size_t rank = 0; rank < worst_first.size(); ++rank) {
    const PixelToRefine& pixel = group[worst_first[rank].second];
    const bool has_kernels = !pixel.kernels->boxes.empty();
    if (has_kernels && rank >= needed && 2 * rank >= group.size()) continue;
    PixelKernels fresh = tree.fit(pixel.samples);
    masked.assign(pixel.samples, table.stride(), table.images());
    if (!has_kernels || criterion_of(fresh, masked) < criterion_of(*pixel.kernels, masked))
      *pixel.kernels = std::move(fresh);
  }
}

}  // namespace refield
