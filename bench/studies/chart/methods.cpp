// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/methods.h"

#include <algorithm>

#include "bench/studies/peers/single_box.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "estimate/estimate.h"

namespace refield::chart {

namespace {

constexpr std::uint64_t noise_seed = 2000;

CaptureSession first_images(const CaptureSession& session, int images) {
  CaptureSession first = session;
  first.frames.resize(static_cast<std::size_t>(images));
  return first;
}

/// Photographs of the scene under single cells of light, by the camera and the exposures that took the
/// session.
peers::CellModel photograph_cells(const ChartData& data, int images) {
  const LightDomain& domain = data.session.light;
  const auto cells = peers::light_cells(domain, images);
  std::vector<Image> photographs;
  for (std::size_t k = 0; k < cells.size(); ++k) {
    photographs.push_back(data.transport->relight(peers::cell_light(domain, cells[k])));
    Rng rng(noise_seed, k);
    data.noise.add_to(photographs.back(), rng);
  }
  return peers::fit_cells(domain, cells, photographs);
}

}  // namespace

const std::vector<Method>& all_methods() {
  static const std::vector<Method> methods = {
      {"ours", "refield", true},
      {"paper", "paper mode (Matusik et al. 2004)", true},
      {"ridge", "ridge regression on texels", false},
      {"svd", "truncated SVD", false},
      {"smooth", "smooth Gaussian process ridge", false},
      {"haar", "Haar wavelets (Peers and Dutré 2003; Ng et al. 2003)", true},
      {"box", "single box (Zongker et al. 1999)", false},
      {"cells", "one light at a time (Debevec et al. 2000)", false}};
  return methods;
}

const Method& method_named(const std::string& name) {
  const auto found = std::ranges::find(all_methods(), name, &Method::name);
  if (found != all_methods().end()) return *found;
  std::string known;
  for (const Method& method : all_methods()) known += (known.empty() ? "" : ", ") + method.name;
  throw InputError("--methods " + name + ": there is no such method; known are " + known);
}

std::vector<Task> grid_of(const std::vector<std::string>& methods, const std::vector<int>& kernels,
                          const std::vector<int>& images) {
  std::vector<Task> tasks;
  for (const int count : images)
    for (const std::string& name : methods) {
      const Method& method = method_named(name);
      if (name == "ours") tasks.push_back({name, "default", 0, count});
      if (!method.takes_kernels) tasks.push_back({name, "", 0, count});
      for (const int k : method.takes_kernels ? kernels : std::vector<int>{})
        if (k < count) tasks.push_back({name, std::to_string(k) + " kernels", k, count});
    }
  return tasks;
}

std::optional<std::string> reason_against(const std::string& method, const ChartData& data) {
  if (method == "cells" && !data.transport)
    return "one light at a time needs photographs of its own, which only exact transport (--truth) can make";
  return std::nullopt;
}

peers::Model estimate_model(const Task& task, const ChartData& data, const EstimateOptions& base) {
  if (task.method == "ours" || task.method == "paper") {
    EstimateOptions options = base;
    options.mode = task.method == "paper" ? EstimateMode::paper : EstimateMode::refined;
    if (task.kernels > 0) options.kernels = task.kernels;
    options.kernels = std::min(options.kernels, task.images);
    options.predict_errors = false;  // the chart measures errors and times of the fit
    return estimate_field(first_images(data.session, task.images), options, run_context());
  }
  if (task.method == "cells") return photograph_cells(data, task.images);
  const peers::PeerData images = peers::read_peer_data(data.session, task.images, base.clip_level);
  if (task.method == "ridge") return peers::fit_dual(images, peers::DualMethod::ridge);
  if (task.method == "svd") return peers::fit_dual(images, peers::DualMethod::truncated_svd);
  if (task.method == "smooth") return peers::fit_dual(images, peers::DualMethod::smooth_ridge);
  if (task.method == "haar") return peers::fit_haar(images, task.kernels);
  if (task.method == "box") return peers::fit_single_box(images);
  throw InputError("there is no method " + task.method);
}

}  // namespace refield::chart
