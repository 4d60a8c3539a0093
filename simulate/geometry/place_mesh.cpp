// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/place_mesh.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <unordered_map>
#include <utility>

namespace refield::prt {

Eigen::AlignedBox3f bounds_of(const Mesh& mesh) {
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  return bounds;
}

Settled settle(const Eigen::AlignedBox3f& bounds, const Placement& placement) {
  const float scale = placement.size ? *placement.size / bounds.sizes().maxCoeff() : 1.0f;
  const Eigen::Vector3f middle =
      placement.keeps_origin ? Eigen::Vector3f::Zero().eval() : bounds.center().eval();
  Eigen::Vector3f shift = Eigen::Vector3f::Zero();
  if (placement.position)
    shift = *placement.position - scale * middle;
  else if (placement.on_ground)
    shift = -scale * middle;
  if (placement.on_ground) shift.y() = -scale * bounds.min().y();
  return {scale, shift};
}

void place(Mesh& mesh, const Placement& placement) {
  const Eigen::Matrix3f turn = rotation_of(placement.turn).cast<float>();
  const Eigen::Matrix3f matrix = turn * placement.stretch.asDiagonal();
  const Eigen::Matrix3f for_normals = turn * placement.stretch.cwiseInverse().asDiagonal();
  for (auto& position : mesh.positions) position = matrix * position;
  for (auto& normal : mesh.normals) normal = (for_normals * normal).normalized();
  const auto [scale, shift] = settle(bounds_of(mesh), placement);
  for (auto& position : mesh.positions) position = scale * position + shift;
  if (!bounds_of(mesh).sizes().allFinite())
    throw InputError("the mesh is placed beyond what float can hold; give another size or position");
}

void append(const Mesh& mesh, const Eigen::Isometry3f& pose, Mesh& all) {
  const auto first = static_cast<std::uint32_t>(all.positions.size());
  for (const auto& position : mesh.positions) all.positions.push_back(pose * position);
  for (const auto& normal : mesh.normals) all.normals.push_back(pose.linear() * normal);
  all.colours.insert(all.colours.end(), mesh.colours.begin(), mesh.colours.end());
  for (const auto& [a, b, c] : mesh.triangles) all.triangles.push_back({first + a, first + b, first + c});
}

namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr std::uint32_t whole = 0xffffffffu;

class EdgeHalving {
 public:
  EdgeHalving(Mesh& mesh, float longest_edge, std::vector<Eigen::Array4f>* lobes)
      : mesh_(&mesh), longest_edge_(longest_edge), lobes_(lobes && !lobes->empty() ? lobes : nullptr) {}

  /// Refuses what cannot end well before memory is spent on it: a triangle with no longer edges covers no
  /// more than an equilateral one.
  void check() const {
    double area = 0.0;
    for (const auto& [a, b, c] : mesh_->triangles)
      area += 0.5 * (at(b) - at(a)).cast<double>().cross((at(c) - at(a)).cast<double>()).norm();
    const double largest = std::sqrt(3.0) / 4.0 * longest_edge_ * longest_edge_;
    if (!(area <= largest * static_cast<double>(max_triangles))) fail();
  }

  /// Whether anything was halved.
  bool pass() {
    middles_.clear();
    std::vector<Triangle> finer;
    finer.reserve(mesh_->triangles.size());
    for (const Triangle& triangle : mesh_->triangles) {
      split(triangle, finer);
      if (finer.size() > max_triangles) fail();
    }
    mesh_->triangles = std::move(finer);
    return !middles_.empty();
  }

 private:
  [[noreturn]] void fail() const {
    std::ostringstream message;
    message << "refining to edges of " << longest_edge_ << " takes more than " << max_triangles
            << " triangles; allow longer ones";
    throw InputError(message.str());
  }

  const Eigen::Vector3f& at(std::uint32_t vertex) const { return mesh_->positions[vertex]; }

  /// The vertex in the middle of an edge, or `whole` where it is short enough.
  std::uint32_t middle(std::uint32_t a, std::uint32_t b) {
    if (!((at(a) - at(b)).norm() > longest_edge_)) return whole;
    const auto [low, high] = std::minmax(a, b);
    const auto [found, is_new] = middles_.emplace(std::uint64_t{low} << 32 | high,
                                                  static_cast<std::uint32_t>(mesh_->positions.size()));
    if (is_new) {
      mesh_->positions.emplace_back(0.5f * at(low) + 0.5f * at(high));
      const Eigen::Vector3f normal = mesh_->normals[low] + mesh_->normals[high];
      mesh_->normals.emplace_back(normal.norm() > 1e-3f ? normal.normalized() : mesh_->normals[low]);
      mesh_->colours.emplace_back(0.5f * (mesh_->colours[low] + mesh_->colours[high]));
      if (lobes_) lobes_->emplace_back(0.5f * ((*lobes_)[low] + (*lobes_)[high]));
    }
    return found->second;
  }

  void split(const Triangle& triangle, std::vector<Triangle>& finer) {
    const Triangle middles = {middle(triangle[0], triangle[1]), middle(triangle[1], triangle[2]),
                              middle(triangle[2], triangle[0])};
    const auto halved = std::ranges::count_if(middles, [](std::uint32_t m) { return m != whole; });
    if (halved == 0) {
      finer.push_back(triangle);
      return;
    }
    // Turned so that edge 0 is halved, and with two of them edge 2 is not.
    std::size_t turn = 0;
    while (middles[turn] == whole || (halved == 2 && middles[(turn + 2) % 3] != whole)) ++turn;
    const auto a = triangle[turn], b = triangle[(turn + 1) % 3], c = triangle[(turn + 2) % 3];
    const auto ab = middles[turn], bc = middles[(turn + 1) % 3], ca = middles[(turn + 2) % 3];
    if (halved == 1) {
      finer.insert(finer.end(), {{a, ab, c}, {ab, b, c}});
    } else if (halved == 2) {
      finer.push_back({ab, b, bc});
      // The quadrangle a, ab, bc, c along its shorter diagonal.
      if ((at(a) - at(bc)).squaredNorm() < (at(ab) - at(c)).squaredNorm())
        finer.insert(finer.end(), {{a, ab, bc}, {a, bc, c}});
      else
        finer.insert(finer.end(), {{a, ab, c}, {ab, bc, c}});
    } else {
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
  }

  Mesh* mesh_;
  float longest_edge_;
  std::vector<Eigen::Array4f>* lobes_;
  std::unordered_map<std::uint64_t, std::uint32_t> middles_;  // of this pass, by the edge's ends
};

}  // namespace

void refine(Mesh& mesh, float longest_edge, std::vector<Eigen::Array4f>* lobes) {
  if (!(longest_edge > 0.0f)) throw InputError("edges cannot be refined to a length of zero or less");
  EdgeHalving halving(mesh, longest_edge, lobes);
  halving.check();
  while (halving.pass()) {
  }
}

}  // namespace refield::prt
