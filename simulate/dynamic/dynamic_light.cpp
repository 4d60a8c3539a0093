// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <tbb/parallel_for.h>

#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

using Eigen::Index;

class Stopwatch {
 public:
  explicit Stopwatch(double& seconds) : seconds_(seconds) {}
  ~Stopwatch() {
    seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double& seconds_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace

void FrameOptions::check() const {
  if (light_samples < 1 || light_samples > 65536)
    throw InputError("number of light samples: give 1 to 65536");
  if (rays < 1 || rays > 1024) throw InputError("rays: give 1 to 1024");
  if (bounces < 0 || bounces > 64) throw InputError("bounces: give 0 to 64");
}

DynamicLight::DynamicLight(const DynamicScene& scene, std::span<const prt::MeshRays> rays,
                           std::span<const ObjectTransport> transport)
    : scene_(scene),
      transport_(transport),
      rays_(rays),
      product_(transport.empty() ? 1 : transport.front().order),
      fields_(scene, transport),
      pairs_(scene.objects.size() * scene.objects.size()),
      radiance_(scene.objects.size()),
      used_(scene.objects.size()) {
  if (!std::ranges::all_of(transport, &ObjectTransport::has_fields))
    gathered_.emplace(scene, rays, transport);
}

void DynamicLight::light_directly(const Mesh& area_lights) {
  const Stopwatch watch(times_.direct);
  const std::vector<AreaPoint> points = area_points(area_lights, options_.light_samples);
  direct_to_eye_.clear();
  if (options_.direct_by_fields) {
    for (std::size_t o = 0; o < scene_.objects.size(); ++o)
      light_[0].push_back(fields_.direct(placed_, o, points, product_));
    return;
  }
  rays_.move(poses_);
  for (std::size_t o = 0; o < scene_.objects.size(); ++o) {
    DirectLight direct =
        direct_light(scene_.objects[o], poses_[o], transport_[o].factors, rays_, points, eye_);
    light_[0].push_back(std::move(direct.terms));
    direct_to_eye_.push_back(std::move(direct.to_eye));
  }
}

void DynamicLight::place() {
  const Stopwatch watch(times_.place);
  const std::size_t objects = scene_.objects.size();
  for (std::size_t target = 0; target < objects; ++target)
    place_pairs(placed_, target, scene_.objects[target].mesh.positions, product_,
                std::span(pairs_).subspan(target * objects, objects));
  tbb::parallel_for(std::size_t{0}, objects, [&](std::size_t source) { find_used_points(source); });
}

void DynamicLight::find_used_points(std::size_t source) {
  const std::size_t objects = scene_.objects.size();
  std::vector<bool> used(transport_[source].grid.points(), false);
  for (std::size_t target = 0; target < objects; ++target) {
    if (target == source) continue;
    for (const ShellGrid::Corners& corners : pairs_[target * objects + source].corners)
      for (std::size_t i = 0; i < corners.point.size(); ++i)
        if (corners.weight[i] != 0.0f) used[corners.point[i]] = true;
  }
  used_[source].clear();
  for (std::size_t point = 0; point < used.size(); ++point)
    if (used[point]) used_[source].push_back(static_cast<std::uint32_t>(point));
  radiance_[source].resize(3 * harmonics_of(transport_[source].order), static_cast<Index>(used.size()));
}

std::vector<TermLight> DynamicLight::bounce(std::span<const TermLight> light) {
  const std::size_t objects = scene_.objects.size();
  std::vector<ModeWeights> returning(objects);
  for (std::size_t source = 0; source < objects; ++source) {
    const ObjectTransport& transport = transport_[source];
    const ModeWeights weights = transport.modes.to_weights * light[source];
    const ModeWeights leaving = transport.leaving.modes_of(weights);
    returning[source] = transport.returning.modes_of(weights);
    Eigen::MatrixXf& radiance = radiance_[source];
    tbb::parallel_for(std::size_t{0}, used_[source].size(), [&](std::size_t i) {
      const std::uint32_t point = used_[source][i];
      transport.leaving.expand(point, leaving, radiance.col(point).data());
    });
  }
  std::vector<TermLight> next(objects);
  for (std::size_t target = 0; target < objects; ++target) {
    const Index terms = transport_[target].terms();
    next[target].resize(light[target].rows(), 3);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, next[target].rows() / terms, 64),
                      [&](const auto& range) {
                        Eigen::MatrixXf own(terms, 3);
                        for (std::size_t v = range.begin(); v < range.end(); ++v) {
                          transport_[target].returning.expand(v, returning[target], own.data());
                          auto rows = next[target].middleRows(static_cast<Index>(v) * terms, terms);
                          rows = own;
                          for (std::size_t source = 0; source < objects; ++source)
                            if (source != target)
                              pairs_[target * objects + source].add(v, radiance_[source], rows);
                        }
                      });
  }
  return next;
}

void DynamicLight::solve(std::span<const Pose> poses, const Mesh& area_lights, const Eigen::Vector3f& eye,
                         const FrameOptions& options) {
  options.check();
  if (options.direct_by_fields && gathered_)
    throw InputError("shadows by fields need objects whose transport has fields");
  poses_.assign(poses.begin(), poses.end());
  options_ = options;
  eye_ = eye;
  placed_.clear();
  for (std::size_t o = 0; o < poses.size(); ++o) placed_.push_back({&transport_[o], poses[o]});
  light_.assign(1, {});
  light_directly(area_lights);
  times_.place = times_.bounces = 0.0;
  if (options.bounces == 0) return;
  if (gathered_) {
    const Stopwatch watch(times_.place);
    gathered_->trace(rays_, poses_, options.rays);
  } else {
    place();
  }
  const Stopwatch watch(times_.bounces);
  for (int b = 0; b < options.bounces; ++b)
    light_.push_back(gathered_ ? gathered_->bounce(light_.back()) : bounce(light_.back()));
}

std::vector<Eigen::Array3f> DynamicLight::radiance(int first, int last) {
  const Stopwatch watch(times_.shade);
  const bool exact = first == 0 && !options_.direct_by_fields;
  std::vector<Eigen::Array3f> all;
  for (std::size_t o = 0; o < scene_.objects.size(); ++o) {
    const Mesh& mesh = scene_.objects[o].mesh;
    const BrdfFactors& factors = transport_[o].factors;
    const Index terms = factors.terms();
    TermLight light = TermLight::Zero(light_[0][o].rows(), 3);
    for (int b = exact ? 1 : first; b <= std::min(last, bounces()); ++b)
      light += light_[static_cast<std::size_t>(b)][o];
    const Eigen::Vector3f own_eye = poses_[o].inverse() * eye_;
    const std::size_t before = all.size();
    all.resize(before + mesh.positions.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mesh.positions.size(), 64), [&](const auto& range) {
      std::vector<Eigen::Array3f> g(static_cast<std::size_t>(terms));
      for (std::size_t v = range.begin(); v < range.end(); ++v) {
        factors.outgoing(tangent_frame(mesh.normals[v]) * (own_eye - mesh.positions[v]).normalized(), g);
        Eigen::Array3f sum = exact ? direct_to_eye_[o][v] : Eigen::Array3f::Zero();
        for (Index k = 0; k < terms; ++k)
          sum += g[static_cast<std::size_t>(k)] *
                 light.row(static_cast<Index>(v) * terms + k).transpose().array();
        all[before + v] = mesh.colours[v] * sum.max(0.0f);
      }
    });
  }
  return all;
}

}  // namespace refield::dynamic
