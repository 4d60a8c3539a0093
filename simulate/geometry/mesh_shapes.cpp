// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_shapes.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <span>
#include <sstream>
#include <unordered_map>

#include "core/base/errors.h"
#include "core/field/transfer_tiles.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

namespace {

/// A square of side 1 about `centre`; right × up is the way it faces.
void add_square(const Eigen::Vector3f& centre, const Eigen::Vector3f& right, const Eigen::Vector3f& up,
                int resolution, Mesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const auto across = static_cast<std::uint32_t>(resolution) + 1;
  for (std::uint32_t j = 0; j < across; ++j)
    for (std::uint32_t i = 0; i < across; ++i)
      mesh.positions.push_back(centre +
                               (static_cast<float>(i) / static_cast<float>(resolution) - 0.5f) * right +
                               (static_cast<float>(j) / static_cast<float>(resolution) - 0.5f) * up);
  for (std::uint32_t j = 0; j + 1 < across; ++j) {
    for (std::uint32_t i = 0; i + 1 < across; ++i) {
      const std::uint32_t a = first + j * across + i, b = a + 1, c = a + across, d = c + 1;
      // Diagonals alternate, so that none runs through the whole square.
      if ((i + j) % 2 == 0)
        mesh.triangles.insert(mesh.triangles.end(), {{{a, b, d}}, {{a, d, c}}});
      else
        mesh.triangles.insert(mesh.triangles.end(), {{{a, b, c}}, {{b, d, c}}});
    }
  }
}

void finish(Mesh& mesh) {
  mesh.colours.assign(mesh.positions.size(), Eigen::Array3f::Ones());
  compute_normals(mesh);
}

/// The unit icosahedron's faces, counter-clockwise in the sense of core/field/mesh.h.
std::vector<std::array<Eigen::Vector3d, 3>> icosahedron() {
  constexpr double g = std::numbers::phi;
  std::vector<Eigen::Vector3d> corners;
  for (const double one : {-1.0, 1.0})
    for (const double golden : {-g, g})
      for (const Eigen::Vector3d& corner : {Eigen::Vector3d(0, one, golden), Eigen::Vector3d(one, golden, 0),
                                            Eigen::Vector3d(golden, 0, one)})
        corners.push_back(corner);
  std::vector<std::array<Eigen::Vector3d, 3>> faces;
  constexpr double edge_squared = 4.0, slack = 1e-9;
  const auto joined = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::abs((a - b).squaredNorm() - edge_squared) < slack;
  };
  for (std::size_t a = 0; a < corners.size(); ++a)
    for (std::size_t b = a + 1; b < corners.size(); ++b)
      for (std::size_t c = b + 1; c < corners.size(); ++c) {
        if (!joined(corners[a], corners[b]) || !joined(corners[b], corners[c]) ||
            !joined(corners[a], corners[c]))
          continue;
        const bool outwards = (corners[b] - corners[a]).cross(corners[c] - corners[a]).dot(corners[a]) > 0.0;
        faces.push_back({corners[a], outwards ? corners[b] : corners[c], outwards ? corners[c] : corners[b]});
      }
  return faces;
}

/// Unit directions.
Mesh directions_mesh(int resolution) {
  Mesh mesh;
  std::map<std::array<long, 3>, std::uint32_t>
      number;  // of a point on the faces, represented by rounded coordinates
  const auto vertex = [&](const Eigen::Vector3d& point) {
    const std::array key{std::lround(point.x() * 1e9), std::lround(point.y() * 1e9),
                         std::lround(point.z() * 1e9)};
    const auto [found, is_new] = number.emplace(key, static_cast<std::uint32_t>(mesh.positions.size()));
    if (is_new) mesh.positions.push_back(point.normalized().cast<float>());
    return found->second;
  };
  for (const auto& [a, b, c] : icosahedron()) {
    const Eigen::Vector3d right = (b - a) / resolution, up = (c - a) / resolution;
    const auto at = [&, origin = a](int i, int j) { return vertex(origin + i * right + j * up); };
    for (int j = 0; j < resolution; ++j)
      for (int i = 0; i + j < resolution; ++i) {
        mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        if (i + j + 1 < resolution) mesh.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
  }
  return mesh;
}

/// Distance of the rabbit's skin from its middle, in a unit direction; it looks against +Z.
float rabbit_radius(const Eigen::Vector3f& direction) {
  const auto lobe = [&](float x, float y, float z, float height, float narrowness) {
    return height * std::exp(narrowness * (direction.dot(Eigen::Vector3f(x, y, z).normalized()) - 1.0f));
  };
  const float ears = lobe(0.45f, 1.0f, 0.25f, 1.1f, 45.0f) + lobe(-0.45f, 1.0f, 0.25f, 1.1f, 45.0f);
  const float face = lobe(0.0f, -0.2f, -1.0f, 0.25f, 14.0f) + lobe(0.5f, -0.45f, -0.8f, 0.12f, 20.0f) +
                     lobe(-0.5f, -0.45f, -0.8f, 0.12f, 20.0f);
  const float fur = 0.02f * std::sin(9.0f * direction.x()) * std::sin(8.0f * direction.y() + 1.0f) *
                    std::sin(10.0f * direction.z() + 2.0f);
  return 0.4f * (1.0f + ears + face + fur);
}

}  // namespace

Mesh plane_mesh(int resolution) {
  Mesh mesh;
  add_square(Eigen::Vector3f::Zero(), Eigen::Vector3f::UnitZ(), Eigen::Vector3f::UnitX(), resolution, mesh);
  finish(mesh);
  return mesh;
}

Mesh box_mesh(int resolution) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (const float side : {-1.0f, 1.0f}) {
      const Eigen::Vector3f out = side * Eigen::Vector3f::Unit(axis);
      const Eigen::Vector3f right = Eigen::Vector3f::Unit((axis + 1) % 3);
      add_square(0.5f * out, right, out.cross(right), resolution, mesh);
    }
  finish(mesh);
  return mesh;
}

Mesh sphere_mesh(int resolution) {
  Mesh mesh = directions_mesh(resolution);
  for (auto& position : mesh.positions) position *= 0.5f;
  finish(mesh);
  return mesh;
}

Mesh rabbit_mesh(int resolution) {
  Mesh mesh = directions_mesh(resolution);
  for (auto& position : mesh.positions) position *= rabbit_radius(position);
  finish(mesh);
  return mesh;
}

namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr std::uint32_t whole = 0xffffffffu;

class Refinement {
 public:
  Refinement(Mesh& mesh, float longest_edge) : mesh_(&mesh), longest_edge_(longest_edge) {}

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
  std::unordered_map<std::uint64_t, std::uint32_t> middles_;  // of this pass, by the edge's ends
};

}  // namespace

void refine(Mesh& mesh, float longest_edge) {
  if (!(longest_edge > 0.0f)) throw InputError("edges cannot be refined to a length of zero or less");
  Refinement refinement(mesh, longest_edge);
  refinement.check();
  while (refinement.pass()) {
  }
}

namespace {

using Feature = Eigen::Array<float, 6, 1>;

/// Places between which halves are cut: whole tiles as long as there are several, then whole groups.
std::size_t middle_of(std::size_t count) {
  const std::size_t unit = count > tile_pixels ? tile_pixels : group_pixels;
  return (count / 2 + unit - 1) / unit * unit;
}

/// Halves vertices along the feature that varies most, again and again, until groups are left: a k-d tree's
/// leaves in order (Bentley 1975).
void sort_by_features(std::span<std::uint32_t> order, const std::vector<Feature>& features) {
  if (order.size() <= group_pixels) {
    std::ranges::sort(order);
    return;
  }
  Feature low = features[order[0]], high = low;
  for (const std::uint32_t vertex : order) {
    low = low.min(features[vertex]);
    high = high.max(features[vertex]);
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const std::size_t middle = middle_of(order.size());
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(middle), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) {
                     const float of_a = features[a][axis], of_b = features[b][axis];
                     return of_a != of_b ? of_a < of_b : a < b;
                   });
  sort_by_features(order.first(middle), features);
  sort_by_features(order.subspan(middle), features);
}

template <class Value>
void reorder(std::vector<Value>& values, const std::vector<std::uint32_t>& order) {
  std::vector<Value> sorted;
  sorted.reserve(values.size());
  for (const std::uint32_t i : order) sorted.push_back(values[i]);
  values = std::move(sorted);
}

}  // namespace

void sort_vertices(Scene& scene) {
  Mesh& mesh = scene.mesh;
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  const float scale = mesh.empty() ? 1.0f : 1.0f / std::max(bounds.sizes().maxCoeff(), 1e-30f);
  // How far apart in the scene two vertices are as unlike as two whose normals differ by one: measured on
  // scanned figures on a ground plane.
  constexpr float distance_of_a_normal = 0.1f;
  std::vector<Feature> features(mesh.positions.size());
  for (std::size_t v = 0; v < features.size(); ++v)
    features[v] << mesh.positions[v].array() * scale, mesh.normals[v].array() * distance_of_a_normal;

  std::vector<std::uint32_t> order(features.size()), place(features.size());
  std::iota(order.begin(), order.end(), 0u);
  sort_by_features(order, features);
  for (std::uint32_t i = 0; i < order.size(); ++i) place[order[i]] = i;
  reorder(mesh.positions, order);
  reorder(mesh.normals, order);
  reorder(mesh.colours, order);
  reorder(scene.material_of_vertex, order);
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& vertex : triangle) vertex = place[vertex];
  std::ranges::sort(mesh.triangles);
}

}  // namespace refield::prt
