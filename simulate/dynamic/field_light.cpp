// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/field_light.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulate/dynamic/tangent_frame.h"

namespace refield::dynamic {

namespace {

using Eigen::Index;
using HarmonicsOfLight = Eigen::Matrix<float, Eigen::Dynamic, 3, 0, most_harmonics, 3>;

/// Edges are never sharper than that, radians.
constexpr float least_blur = 0.02f;

/// The lamps' points in some object's axes.
struct LampPoints {
  Eigen::Matrix3Xf position, normal, power;
  Eigen::ArrayXf area;
};

LampPoints lamps_seen_from(std::span<const AreaPoint> points, const Pose& to_object) {
  const auto count = static_cast<Index>(points.size());
  LampPoints lamps{Eigen::Matrix3Xf(3, count), Eigen::Matrix3Xf(3, count), Eigen::Matrix3Xf(3, count),
                   Eigen::ArrayXf(count)};
  for (Index j = 0; j < count; ++j) {
    const AreaPoint& point = points[static_cast<std::size_t>(j)];
    lamps.position.col(j) = to_object * point.position;
    lamps.normal.col(j) = to_object.linear() * point.normal;
    lamps.power.col(j) = point.power.matrix();
    lamps.area[j] = point.area;
  }
  return lamps;
}

/// Those of them that stand above a vertex' horizon, the first `count` of each array.
struct LampsAbove {
  LampsAbove(Index points, Index harmonics)
      : number(static_cast<std::size_t>(points)),
        direction(3, points),
        arriving(3, points),
        harmonic(harmonics, points),
        cosine(points),
        radius(points),
        behind(points) {}

  Index count = 0;
  std::vector<Index> number;             // among all
  Eigen::Matrix3Xf direction, arriving;  // arriving: on a plane that faces it
  Eigen::MatrixXf harmonic;              // [n² × points]
  Eigen::ArrayXf cosine, radius;         // radius: of the disc it stands for, radians
  Eigen::ArrayXf behind;                 // 1 where an object may stand before it, else 0

  void look(const LampPoints& lamps, const Eigen::Vector3f& from, const Eigen::Vector3f& normal, int order) {
    count = 0;
    for (Index j = 0; j < lamps.area.size(); ++j) {
      const Eigen::Vector3f way = lamps.position.col(j) - from;
      const float height = normal.dot(way);
      if (height <= 0.0f) continue;
      const float squared = way.squaredNorm(), distance = std::sqrt(squared);
      number[static_cast<std::size_t>(count)] = j;
      direction.col(count) = way / distance;
      cosine[count] = height / distance;
      radius[count] = std::sqrt(lamps.area[j] / std::numbers::pi_v<float>) / distance;
      const float across = std::abs(lamps.normal.col(j).dot(direction.col(count)));
      arriving.col(count++) = across / std::max(squared, lamps.area[j]) * lamps.power.col(j);
    }
    evaluate_harmonics(order, direction.leftCols(count), harmonic.leftCols(count));
  }
  HarmonicsOfLight light() const {
    return harmonic.leftCols(count).lazyProduct(arriving.leftCols(count).transpose());
  }
};

bool meets_box(const Eigen::Array3f& half_size, const Eigen::Vector3f& from, const Eigen::Vector3f& way) {
  float enter = 0.0f, leave = 1.0f;
  for (Index i = 0; i < 3; ++i) {
    if (way[i] == 0.0f) {
      if (std::abs(from[i]) > half_size[i]) return false;
      continue;
    }
    const float a = (-half_size[i] - from[i]) / way[i], b = (half_size[i] - from[i]) / way[i];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave;
}

/// Another object that may stand before lamps.
struct Blocker {
  SeenObject seen;
  Eigen::Array3f half_size;
  Eigen::Matrix3Xf lamps;  // in its axes

  /// Marks the lamps behind it; whether there are any.
  bool stands_in_the_way(const Eigen::Vector3f& from, LampsAbove& above) const {
    bool any = false;
    for (Index j = 0; j < above.count; ++j) {
      const bool met =
          meets_box(half_size, from, lamps.col(above.number[static_cast<std::size_t>(j)]) - from);
      above.behind[j] = met ? 1.0f : 0.0f;
      any |= met;
    }
    return any;
  }
};

/// Takes from what arrives what an object covers, each lamp by itself.
void hide_within_edge(const Harmonics& covered, const CapEdges& edges, LampsAbove& above) {
  // ∫ V dω of the harmonic y_00 = 1/√4π
  const float share = covered[0] / std::sqrt(4.0f * std::numbers::pi_v<float>);
  const CapEdges::Edge edge = edges.at(share);
  for (Index j = 0; j < above.count; ++j) {
    if (above.behind[j] == 0.0f) continue;
    const float blur = std::max(2.0f * std::max(above.radius[j], least_blur) * edge.slope, 1e-6f);
    const float within = covered.dot(above.harmonic.col(j)) - edge.value;
    above.arriving.col(j) *= 1.0f - std::clamp(0.5f + within / blur, 0.0f, 1.0f);
  }
}

/// The same by a product, of what is left of the light of all lamps behind it together.
void hide_by_product(const Harmonics& covered, const HarmonicProduct& product, const LampsAbove& above,
                     HarmonicsOfLight& light) {
  const auto arriving = above.arriving.leftCols(above.count);
  const Eigen::Matrix3Xf behind = arriving * above.behind.head(above.count).matrix().asDiagonal();
  const Eigen::Array3f all = arriving.rowwise().sum() * above.harmonic(0, 0);  // y_00 is the same everywhere
  const Eigen::Array3f left = (light.row(0).transpose().array() / all.max(1e-30f)).max(0.0f).min(1.0f);
  const HarmonicsOfLight reached =
      above.harmonic.leftCols(above.count).lazyProduct(behind.transpose()) * left.matrix().asDiagonal();
  light.noalias() -=
      product.matrix({covered.data(), static_cast<std::size_t>(covered.size())}).lazyProduct(reached);
}

}  // namespace

FieldLight::FieldLight(const DynamicScene& scene, std::span<const ObjectTransport> transport)
    : scene_(scene), edges_(transport.empty() ? 1 : transport.front().order) {
  for (std::size_t o = 0; o < transport.size(); ++o) {
    Eigen::Array3f half = Eigen::Array3f::Zero();
    for (const auto& point : scene.objects[o].mesh.positions) half = half.max(point.array().abs());
    half_size_.push_back(half);
    first_.push_back(first_term(transport[o].factors, transport[o].order));
  }
}

DirectLight FieldLight::direct(std::span<const PlacedObject> objects, std::size_t target,
                               std::span<const AreaPoint> points, const Eigen::Vector3f& eye,
                               FieldShadow shadow, const HarmonicProduct& product) const {
  const Mesh& mesh = scene_.objects[target].mesh;
  const Brdf& brdf = scene_.objects[target].brdf;
  const ObjectTransport& own = *objects[target].transport;
  const FirstTerm& first = first_[target];
  const Pose to_own = objects[target].pose.inverse();
  const LampPoints lamps = lamps_seen_from(points, to_own);
  std::vector<Blocker> blockers;
  for (std::size_t o = 0; o < objects.size(); ++o)
    if (o != target)
      blockers.push_back({seen_object(objects[o], objects[target].pose), half_size_[o],
                          lamps_seen_from(points, objects[o].pose.inverse()).position});
  const Index terms = own.terms();
  const std::size_t vertices = mesh.positions.size();
  DirectLight light{TermLight::Zero(static_cast<Index>(vertices) * terms, 3),
                    std::vector<Eigen::Array3f>(vertices, Eigen::Array3f::Zero())};
  const Eigen::Vector3f own_eye = to_own * eye;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, vertices, 64), [&](const auto& range) {
    LampsAbove above(lamps.area.size(), own.receiving.rows());
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      above.look(lamps, mesh.positions[v], mesh.normals[v], own.order);
      if (above.count == 0) continue;
      HarmonicsOfLight arriving(own.receiving.rows(), 3);
      if (shadow == FieldShadow::product) arriving = above.light();
      for (const Blocker& blocker : blockers) {
        const Eigen::Vector3f from = blocker.seen.from_target * mesh.positions[v];
        if (!blocker.stands_in_the_way(from, above)) continue;
        const Harmonics covered = covered_by(blocker.seen, blocker.seen.transport->grid.around(from));
        if (shadow == FieldShadow::product)
          hide_by_product(covered, product, above, arriving);
        else
          hide_within_edge(covered, edges_, above);
      }
      if (shadow == FieldShadow::edge) arriving = above.light();

      // What the first term would take with nothing else hidden: exactly, and by harmonics.
      Eigen::Array3f exact = Eigen::Array3f::Zero(), low = exact, to_eye = exact;
      const Eigen::Matrix3f frame = tangent_frame(mesh.normals[v]);
      const Eigen::Vector3f sight = frame * (own_eye - mesh.positions[v]).normalized();
      for (Index j = 0; j < above.count; ++j) {
        const Eigen::Array3f part = above.arriving.col(j);
        if (!(part.maxCoeff() > 0.0f)) continue;
        exact += first.exact(above.cosine[j]) * part;
        low += std::max(first.by_harmonics(above.cosine[j]), first.least) * part;
        to_eye += above.cosine[j] * part * brdf(frame * above.direction.col(j), sight);
      }
      auto rows = light.terms.middleRows(static_cast<Index>(v) * terms, terms);
      rows = own.receiving.middleCols(static_cast<Index>(v) * terms, terms).transpose().lazyProduct(arriving);
      const Eigen::Array3f safe = low.max(1e-30f);
      const Eigen::Array3f left = first.sign * rows.row(0).transpose().array() / safe;
      constexpr float most = 2.0f;  // near the horizon harmonics tell too little
      const Eigen::Array3f scale = (left > 0.0f).select((exact / safe).min(most), 0.0f);
      rows.array().rowwise() *= scale.transpose();
      light.to_eye[v] = left.max(0.0f).min(1.0f) * to_eye;
    }
  });
  return light;
}

}  // namespace refield::dynamic
