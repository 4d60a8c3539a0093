// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <tbb/parallel_for.h>

#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

using Eigen::Index;

/// Different sets of directions, more than a vertex of a regular mesh has neighbours within one edge and
/// nearly as many as within two.
constexpr std::size_t ray_patterns = 16;
constexpr std::size_t vertices_of_batch = 64;
/// More than two edges of regular meshes reach; the nearest of fans, whose middle has thousands of
/// neighbours.
constexpr std::size_t max_neighbours = 32;
/// Neighbours face the same side: within 37°.
constexpr float same_side = 0.8f;
/// Neighbours count up to half of the mean (harmonic) distance of what a vertex sees. Of 0 (all count), 1/2,
/// 1, 2 and 4, the least that is within a tenth of paths at the foot of a wall and around a ball on a floor.
constexpr float narrowness = 2.0f;
/// h_k are looked up on a square, onto which the hemisphere is mapped: places a side.
constexpr int side_of_table = 48;
/// K is padded to whole vectors of add_ray_shares().
constexpr std::size_t lanes = 16;
constexpr float full_weight = 65535.0f;

std::size_t padded(std::size_t terms) {
  return (terms + lanes - 1) / lanes * lanes;
}

bool is_diffuse(const MovingObject& object) {
  return object.brdf.lobe == Lobe::none;
}

/// Cosine-distributed, by the concentric map of the unit square (Shirley and Chiu 1997).
Eigen::Vector3f cosine_direction(double u, double v) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  double r = 0.0, phi = 0.0;
  if (std::abs(a) > std::abs(b)) {
    r = a;
    phi = std::numbers::pi / 4.0 * b / a;
  } else if (b != 0.0) {
    r = b;
    phi = std::numbers::pi / 2.0 - std::numbers::pi / 4.0 * a / b;
  }
  const double z = std::sqrt(std::max(1e-6, 1.0 - r * r));
  return Eigen::Vector3d(r * std::cos(phi), r * std::sin(phi), z).normalized().cast<float>();
}

/// Place of a direction above the horizon in a table: the hemisphere's octahedron, turned by 45°, fills the
/// square.
std::size_t place_of(const Eigen::Vector3f& direction) {
  const float sum = std::abs(direction.x()) + std::abs(direction.y()) + direction.z();
  const float u = (direction.x() + direction.y()) / sum, v = (direction.x() - direction.y()) / sum;
  const auto cell = [](float at) {
    return std::clamp(static_cast<int>((at + 1.0f) * 0.5f * side_of_table), 0, side_of_table - 1);
  };
  return static_cast<std::size_t>(cell(v)) * side_of_table + static_cast<std::size_t>(cell(u));
}

Eigen::Vector3f direction_at(int row, int column) {
  const float u = (static_cast<float>(column) + 0.5f) * 2.0f / side_of_table - 1.0f;
  const float v = (static_cast<float>(row) + 0.5f) * 2.0f / side_of_table - 1.0f;
  const float x = 0.5f * (u + v), y = 0.5f * (u - v);
  return Eigen::Vector3f(x, y, std::max(1.0f - std::abs(x) - std::abs(y), 1e-4f)).normalized();
}

std::vector<float> table_of(const BrdfFactors& factors) {
  const auto terms = static_cast<std::size_t>(factors.terms());
  std::vector<float> table(std::size_t{side_of_table} * side_of_table * padded(terms), 0.0f);
  float* row = table.data();
  for (int j = 0; j < side_of_table; ++j)
    for (int i = 0; i < side_of_table; ++i, row += padded(terms))
      factors.incoming(direction_at(j, i), std::span(row, terms));
  return table;
}

/// For each vertex, itself and those within two edges that face the same side; the nearest, if too many.
void find_neighbours(const Mesh& mesh, std::vector<std::uint32_t>& near, std::vector<std::uint32_t>& first) {
  const std::size_t vertices = mesh.positions.size();
  std::vector<std::vector<std::uint32_t>> ring(vertices);
  for (const auto& triangle : mesh.triangles)
    for (std::size_t c = 0; c < 3; ++c)
      for (const std::size_t other : {(c + 1) % 3, (c + 2) % 3}) ring[triangle[c]].push_back(triangle[other]);
  for (auto& each : ring) {
    std::ranges::sort(each);
    each.erase(std::unique(each.begin(), each.end()), each.end());
  }
  first.assign(1, 0);
  std::vector<std::uint32_t> found;
  for (std::size_t v = 0; v < vertices; ++v) {
    found.clear();
    for (const std::uint32_t next : ring[v]) {
      found.push_back(next);
      if (ring[next].size() <= max_neighbours)
        found.insert(found.end(), ring[next].begin(), ring[next].end());
    }
    std::ranges::sort(found);
    found.erase(std::unique(found.begin(), found.end()), found.end());
    std::erase_if(found, [&](std::uint32_t other) {
      return other == v || mesh.normals[other].dot(mesh.normals[v]) <= same_side;
    });
    if (found.size() > max_neighbours) {
      std::ranges::nth_element(found, found.begin() + max_neighbours, {}, [&](std::uint32_t other) {
        return (mesh.positions[other] - mesh.positions[v]).squaredNorm();
      });
      found.resize(max_neighbours);
    }
    near.push_back(static_cast<std::uint32_t>(v));
    near.insert(near.end(), found.begin(), found.end());
    first.push_back(static_cast<std::uint32_t>(near.size()));
  }
}

/// The pattern that the fewest neighbours have, vertex after vertex.
std::vector<std::uint8_t> spread_patterns(std::span<const std::uint32_t> near,
                                          std::span<const std::uint32_t> first) {
  constexpr std::uint8_t none = 255;
  std::vector<std::uint8_t> pattern(first.size() - 1, none);
  for (std::size_t v = 0; v < pattern.size(); ++v) {
    std::array<int, ray_patterns> used{};
    for (std::uint32_t i = first[v]; i < first[v + 1]; ++i)
      if (pattern[near[i]] != none) ++used[pattern[near[i]]];
    std::size_t best = (v * 7) % ray_patterns;
    for (std::size_t i = 0; i < ray_patterns; ++i)
      if (const std::size_t other = (v * 7 + i) % ray_patterns; used[other] < used[best]) best = other;
    pattern[v] = static_cast<std::uint8_t>(best);
  }
  return pattern;
}

/// Puts the directions of all patterns in the order of the first, so that packets of rays stay together.
void sort_alike(std::vector<Eigen::Vector3f>& directions, std::size_t count) {
  for (std::size_t p = 1; p < ray_patterns; ++p) {
    const std::span own = std::span(directions).subspan(p * count, count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto closest = std::max_element(own.begin() + static_cast<std::ptrdiff_t>(i), own.end(),
                                            [&](const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
                                              return a.dot(directions[i]) < b.dot(directions[i]);
                                            });
      std::swap(own[i], *closest);
    }
  }
}

}  // namespace

GatheredLight::GatheredLight(const DynamicScene& scene, std::span<const prt::MeshRays> rays,
                             std::span<const ObjectTransport> transport)
    : scene_(scene), transport_(transport), surfaces_(scene.objects.size()), first_vertex_{0} {
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Mesh& mesh = scene.objects[o].mesh;
    const auto vertices = static_cast<std::uint32_t>(mesh.positions.size());
    first_vertex_.push_back(first_vertex_.back() + vertices);
    for (std::uint32_t v = 0; v < vertices; v += vertices_of_batch)
      batches_.push_back({o, v, std::min<std::uint32_t>(v + vertices_of_batch, vertices)});
    Surface& surface = surfaces_[o];
    surface.start = ray_starts(mesh);
    for (std::size_t v = 0; v < vertices; ++v)
      surface.start[v] = rays[o].off_surface(surface.start[v], mesh.normals[v]);
    find_neighbours(mesh, surface.near, surface.first);
    surface.pattern = spread_patterns(surface.near, surface.first);
    if (!is_diffuse(scene.objects[o])) surface.h = table_of(transport[o].factors);
  }
  glossy_.resize(batches_.size());
}

void GatheredLight::set_directions(int count) {
  count_ = static_cast<std::size_t>(count);
  directions_.clear();
  // Each pattern takes the next points of one sequence of low discrepancy (Roberts 2018), and so do all.
  constexpr double g = 1.32471795724474602596;
  for (std::size_t i = 0; i < ray_patterns * count_; ++i) {
    const double k = static_cast<double>(i) + 0.5;
    directions_.push_back(cosine_direction(std::fmod(k / g, 1.0), std::fmod(k / (g * g), 1.0)));
  }
  sort_alike(directions_, count_);
  for (std::size_t o = 0; o < surfaces_.size(); ++o)
    if (!is_diffuse(scene_.objects[o])) set_shares(o);
}

void GatheredLight::set_shares(std::size_t object) {
  Surface& surface = surfaces_[object];
  const std::vector<Eigen::Vector3f>& normals = scene_.objects[object].mesh.normals;
  surface.shares.resize(surface.near.size() * count_);
  tbb::parallel_for(std::size_t{0}, normals.size(), [&](std::size_t v) {
    const Eigen::Matrix3f to_local = tangent_frame(normals[v]);
    RayShare* share = surface.shares.data() + surface.first[v] * count_;
    for (const std::uint32_t other : near(surface, v)) {
      const Eigen::Matrix3f from_local = tangent_frame(normals[other]).transpose();
      for (std::size_t d = 0; d < count_; ++d, ++share) {
        const Eigen::Vector3f direction = from_local * directions_[surface.pattern[other] * count_ + d];
        const float cosine = normals[v].dot(direction);
        *share = {0, 0};
        if (cosine <= 0.0f) continue;
        float all = 0.0f;
        for (const std::uint32_t each : near(surface, v)) all += std::max(normals[each].dot(direction), 0.0f);
        share->place = static_cast<std::uint16_t>(place_of(to_local * direction));
        share->weight = static_cast<std::uint16_t>(std::lround(full_weight * std::min(cosine / all, 1.0f)));
      }
    }
  });
}

void GatheredLight::trace(const Batch& batch, const SceneRays& rays, std::span<const Pose> poses,
                          GlossyHits& glossy) {
  constexpr std::size_t packet = prt::ray_packet;
  const std::uint32_t nothing = first_vertex_.back();
  const Surface& surface = surfaces_[batch.object];
  const std::vector<Eigen::Vector3f>& normals = scene_.objects[batch.object].mesh.normals;
  const Pose& pose = poses[batch.object];
  std::vector<Eigen::Array3f> g;
  std::array<Eigen::Vector3f, packet> from, way;
  std::array<Eigen::Matrix3f, packet> to_scene;
  std::array<std::optional<SceneHit>, packet> hits;
  glossy.hits.clear();
  glossy.g.clear();
  for (std::size_t v = batch.first; v < batch.end; v += packet) {
    const std::size_t width = std::min(packet, batch.end - v);
    for (std::size_t i = 0; i < width; ++i) {
      from[i] = pose * surface.start[v + i];
      to_scene[i] = pose.linear() * tangent_frame(normals[v + i]).transpose();
    }
    std::array<float, packet> nearness{};
    for (std::size_t d = 0; d < count_; ++d) {
      for (std::size_t i = 0; i < width; ++i)
        way[i] = to_scene[i] * directions_[surface.pattern[v + i] * count_ + d];
      rays.intersect(std::span(from).first(width), std::span(way).first(width), hits);
      for (std::size_t i = 0; i < width; ++i) {
        std::uint32_t& seen = seen_[(first_vertex_[batch.object] + v + i) * count_ + d];
        seen = nothing;
        if (!hits[i]) continue;
        nearness[i] += 1.0f / std::max(hits[i]->on.distance, 1e-6f);
        if (!hits[i]->on.front) continue;
        const auto& [object, on] = *hits[i];
        const MovingObject& other = scene_.objects[object];
        const auto corner = std::ranges::max_element(on.share) - on.share.begin();
        const std::uint32_t vertex = other.mesh.triangles[on.triangle][static_cast<std::size_t>(corner)];
        if (is_diffuse(other)) {
          seen = first_vertex_[object] + vertex;
          continue;
        }
        const BrdfFactors& factors = transport_[object].factors;
        g.resize(static_cast<std::size_t>(factors.terms()));
        factors.outgoing(
            tangent_frame(other.mesh.normals[vertex]) * (poses[object].linear().transpose() * -way[i]), g);
        seen = nothing + 1 + static_cast<std::uint32_t>(glossy.hits.size());
        glossy.hits.push_back({object, vertex});
        for (const Eigen::Array3f& each : g)
          for (int c = 0; c < 3; ++c) glossy.g.push_back(other.mesh.colours[vertex][c] * each[c]);
      }
    }
    for (std::size_t i = 0; i < width; ++i)
      nearness_[first_vertex_[batch.object] + v + i] = nearness[i] / static_cast<float>(count_);
  }
}

void GatheredLight::trace(const SceneRays& rays, std::span<const Pose> poses, int count) {
  if (static_cast<std::size_t>(count) != count_) set_directions(count);
  const std::uint32_t nothing = first_vertex_.back();
  seen_.resize(nothing * count_);
  nearness_.resize(nothing);
  tbb::parallel_for(std::size_t{0}, batches_.size(),
                    [&](std::size_t b) { trace(batches_[b], rays, poses, glossy_[b]); });
  std::uint32_t next = nothing + 1;
  for (GlossyHits& glossy : glossy_) {
    glossy.first = next;
    next += static_cast<std::uint32_t>(glossy.hits.size());
  }
  sent_.resize(next);
  // Batches numbered their glossy hits from the first on.
  tbb::parallel_for(std::size_t{0}, batches_.size(), [&](std::size_t b) {
    if (glossy_[b].hits.empty()) return;
    const std::uint32_t vertex = first_vertex_[batches_[b].object];
    for (std::size_t i = (vertex + batches_[b].first) * count_; i < (vertex + batches_[b].end) * count_; ++i)
      if (seen_[i] > nothing) seen_[i] += glossy_[b].first - (nothing + 1);
  });
}

void GatheredLight::send(std::span<const TermLight> light) {
  for (std::size_t o = 0; o < scene_.objects.size(); ++o) {
    if (!is_diffuse(scene_.objects[o])) continue;
    std::array<Eigen::Array3f, 1> g;
    transport_[o].factors.outgoing(Eigen::Vector3f::UnitZ(), g);
    const std::vector<Eigen::Array3f>& colours = scene_.objects[o].mesh.colours;
    for (std::size_t v = 0; v < colours.size(); ++v)
      sent_[first_vertex_[o] + v]
          << (colours[v] * g[0] * light[o].row(static_cast<Index>(v)).transpose().array()).matrix(),
          0.0f;
  }
  sent_[first_vertex_.back()].setZero();
  tbb::parallel_for(std::size_t{0}, glossy_.size(), [&](std::size_t b) {
    const float* g = glossy_[b].g.data();
    Eigen::Vector4f* out = sent_.data() + glossy_[b].first;
    for (const GlossyHit& hit : glossy_[b].hits) {
      const Index terms = transport_[hit.object].terms();
      const float* l = light[hit.object].data() + static_cast<Index>(hit.vertex) * terms * 3;
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (Index k = 0; k < terms; ++k, g += 3, l += 3)
        sum += Eigen::Map<const Eigen::Array3f>(g) * Eigen::Map<const Eigen::Array3f>(l);
      *out++ << sum.max(0.0f).matrix(), 0.0f;
    }
  });
}

void GatheredLight::receive_diffuse(std::size_t object, TermLight& light) const {
  const Surface& surface = surfaces_[object];
  const std::vector<Eigen::Vector3f>& positions = scene_.objects[object].mesh.positions;
  const std::size_t vertices = positions.size();
  std::array<float, 1> h;
  transport_[object].factors.incoming(Eigen::Vector3f::UnitZ(), h);
  std::vector<Eigen::Vector4f> own(vertices);
  const tbb::blocked_range<std::size_t> all(0, vertices, 256);
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      const std::uint32_t* seen = seen_.data() + (first_vertex_[object] + v) * count_;
      Eigen::Vector4f sum = Eigen::Vector4f::Zero();
      for (std::size_t d = 0; d < count_; ++d) sum += sent_[seen[d]];
      own[v] = sum * (h[0] * std::numbers::pi_v<float> / static_cast<float>(count_));
    }
  });
  tbb::parallel_for(all, [&](const auto& range) {
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      // Light changes within the distance of what is seen (Ward et al. 1988): what is farther away, or behind
      // a wall, does not count.
      Eigen::Vector4f sum = Eigen::Vector4f::Zero();
      float weights = 0.0f;
      const float* nearness = nearness_.data() + first_vertex_[object];
      for (const std::uint32_t other : near(surface, v)) {
        const float gap = (positions[other] - positions[v]).norm();
        const float weight = std::max(1.0f - gap * std::max(nearness[other], nearness[v]) * narrowness, 0.0f);
        sum += weight * own[other];
        weights += weight;
      }
      light.row(static_cast<Index>(v)) = sum.head<3>().transpose() / weights;
    }
  });
}

void GatheredLight::receive_glossy(std::size_t object, TermLight& light) const {
  const Surface& surface = surfaces_[object];
  const std::size_t terms = static_cast<std::size_t>(transport_[object].terms()), width = padded(terms);
  const float unit = std::numbers::pi_v<float> / (full_weight * static_cast<float>(count_));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, surface.start.size(), 64), [&](const auto& range) {
    std::vector<float> sums(3 * width);
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      std::ranges::fill(sums, 0.0f);
      const RayShare* shares = surface.shares.data() + surface.first[v] * count_;
      for (const std::uint32_t other : near(surface, v)) {
        add_ray_shares(seen_.data() + (first_vertex_[object] + other) * count_, shares, count_,
                       sent_.front().data(), surface.h.data(), width, sums.data());
        shares += count_;
      }
      for (std::size_t k = 0; k < terms; ++k)
        for (std::size_t c = 0; c < 3; ++c)
          light(static_cast<Index>(v * terms + k), static_cast<Index>(c)) = unit * sums[c * width + k];
    }
  });
}

std::vector<TermLight> GatheredLight::bounce(std::span<const TermLight> light) {
  send(light);
  std::vector<TermLight> next(light.size());
  for (std::size_t o = 0; o < light.size(); ++o) {
    next[o].resize(light[o].rows(), 3);
    if (is_diffuse(scene_.objects[o]))
      receive_diffuse(o, next[o]);
    else
      receive_glossy(o, next[o]);
  }
  return next;
}

}  // namespace refield::dynamic
