// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/light_clusters.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "core/cube_map.h"
#include "core/run_context.h"
#include "simulate/prt/cube_quadtree.h"

namespace refield::prt {

namespace {

/// A light and its transfer vector, [groups × channels × 16].
struct Light {
  int x = 0, y = 0;
  std::vector<float> transfer;
};
/// A square that is still to be clustered, and those of its lights that are known.
struct Domain {
  CubeSquare square;
  std::vector<std::unique_ptr<Light>> known;
};

/// Up to `samples` of the integers [first, last), spread evenly, ends included. As halves of the range end
/// beside the middle one, samples of a range are samples of its parts.
std::vector<int> spread(int first, int last, int samples) {
  const int steps = std::min(samples, last - first) - 1;
  std::vector<int> at(1, first);
  for (int i = 1; i <= steps; ++i) at.push_back(first + i * (last - first - 1) / steps);
  return at;
}

class LightClusters {
 public:
  LightClusters(const TransferSamples& transfer, std::size_t outputs, const ClusterOptions& options,
                ClusterStatistics& statistics)
      : transfer_(transfer),
        options_(options),
        statistics_(statistics),
        outputs_(static_cast<double>(outputs)),
        weights_(transfer.groups()) {}

  std::vector<GroupWeights> run(const RunContext& run) {
    const int resolution = options_.resolution;
    Progress progress(run, "clustering lights", std::uint64_t{6} * resolution * resolution);
    for (int face = 0; face < cube_faces; ++face) {
      std::vector<Domain> domains(1);
      domains[0].square = face_square(face, resolution);
      while (!domains.empty()) {
        Domain domain = std::move(domains.back());
        domains.pop_back();
        held_ = domain.known.size();
        for (const Domain& other : domains) held_ += other.known.size();
        const bool similar = one_cluster(domain, run);
        run.throw_if_stopped();
        if (similar)
          progress.advance(static_cast<std::uint64_t>(domain.square.box.area()));
        else
          split(std::move(domain), domains);
      }
    }
    return std::move(weights_);
  }

 private:
  /// The lights that stand for a square; those not known yet are to be traced.
  std::vector<Light*> sample(Domain& domain) {
    std::vector<Light*> lights;
    const Box& box = domain.square.box;
    for (const int y : spread(box.y0, box.y1, options_.samples))
      for (const int x : spread(box.x0, box.x1, options_.samples)) {
        const auto known = std::ranges::find_if(
            domain.known, [&](const auto& light) { return light->x == x && light->y == y; });
        if (known != domain.known.end()) {
          lights.push_back(known->get());
        } else {
          domain.known.push_back(std::make_unique<Light>(Light{x, y, {}}));
          lights.push_back(domain.known.back().get());
        }
      }
    return lights;
  }

  /// ‖T_C − T_l‖ that is let pass.
  double limit(const CubeSquare& square) const {
    if (options_.similarity == Similarity::all_outputs) return options_.epsilon * outputs_;  // eq. 11
    return options_.epsilon * std::sqrt(outputs_) / cube_solid_angle(square.box, options_.resolution);
  }

  /// Traces what is missing and tests it; if all samples satisfy it, their mean (eq. 10) becomes the
  /// cluster's vector.
  bool one_cluster(Domain& domain, const RunContext& run) {
    const std::vector<Light*> lights = sample(domain);
    const std::size_t size = transfer_.group_values(), groups = transfer_.groups();
    const auto channels = static_cast<std::size_t>(transfer_.channels());
    std::vector<Eigen::Vector3f> missing(lights.size(), Eigen::Vector3f::Zero());
    for (std::size_t l = 0; l < lights.size(); ++l)
      if (lights[l]->transfer.empty()) {
        missing[l] =
            cube_direction(lights[l]->x + 0.5, lights[l]->y + 0.5, options_.resolution).cast<float>();
        lights[l]->transfer.resize(groups * size);
        ++statistics_.lights;
        ++held_;
      }
    statistics_.peak_vectors = std::max(statistics_.peak_vectors, held_);

    std::vector<float> mean(groups * size);
    std::vector<double> distance(groups * lights.size() * channels);  // squares of a group's part
    std::vector<std::uint64_t> rays(groups);
    tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
      if (run.is_stopped()) return;  // thrown away
      const std::span mine = std::span(mean).subspan(g * size, size);
      for (std::size_t l = 0; l < lights.size(); ++l) {
        const std::span values = std::span(lights[l]->transfer).subspan(g * size, size);
        if (!missing[l].isZero()) rays[g] += transfer_.evaluate(g, missing[l], values);
        for (std::size_t i = 0; i < size; ++i) mine[i] += values[i] / static_cast<float>(lights.size());
      }
      double* to = &distance[g * lights.size() * channels];
      for (const Light* light : lights)
        for (std::size_t c = 0; c < channels; ++c, ++to)
          for (std::size_t i = c * TransferSamples::group_outputs;
               i < (c + 1) * TransferSamples::group_outputs; ++i) {
            const double difference = mine[i] - light->transfer[g * size + i];
            *to += difference * difference;
          }
    });
    for (const std::uint64_t count : rays) statistics_.rays += count;
    const double most = limit(domain.square);
    for (std::size_t of = 0; of < lights.size() * channels; ++of) {
      double sum = 0.0;
      for (std::size_t g = 0; g < groups; ++g) sum += distance[g * lights.size() * channels + of];
      if (lights.size() > 1 && !(sum < most * most)) return false;
    }
    tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
      weights_[g].append(domain.square.name, std::span(mean).subspan(g * size, size));
    });
    return true;
  }

  void split(Domain domain, std::vector<Domain>& domains) {
    for (const CubeSquare& part : quadrisect(domain.square)) {
      if (part.box.area() == 0) continue;
      Domain next{part, {}};
      for (auto& light : domain.known)
        if (light && part.box.contains(light->x, light->y)) next.known.push_back(std::move(light));
      domains.push_back(std::move(next));
    }
  }

  const TransferSamples& transfer_;
  const ClusterOptions& options_;
  ClusterStatistics& statistics_;
  double outputs_;          // N
  std::uint64_t held_ = 0;  // transfer vectors
  std::vector<GroupWeights> weights_;
};

}  // namespace

std::vector<GroupWeights> cluster_lights(const TransferSamples& transfer, std::size_t outputs,
                                         const ClusterOptions& options, ClusterStatistics& statistics,
                                         const RunContext& run) {
  return LightClusters(transfer, outputs, options, statistics).run(run);
}

}  // namespace refield::prt
