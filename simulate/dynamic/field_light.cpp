// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/dynamic_light.h"

#include <tbb/parallel_for.h>

#include "core/light/harmonics.h"
#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

constexpr double whole_sphere = 4.0 * std::numbers::pi;
constexpr int zonal_samples = 513;  // odd: one lies on the horizon

double legendre(std::size_t band, double cosine) {
  return std::legendre(static_cast<unsigned>(band), cosine);
}

/// Σ_l (2l + 1)/4π c_l P_l, the function of which c_l = ∫ f P_l dω.
double zonal_sum(std::span<const double> bands, double cosine) {
  double sum = 0.0;
  for (std::size_t l = 0; l < bands.size(); ++l)
    sum += (2.0 * static_cast<double>(l) + 1.0) / whole_sphere * bands[l] * legendre(l, cosine);
  return sum;
}

}  // namespace

float ZonalTable::operator()(float cosine) const {
  const float last = static_cast<float>(samples_.size() - 1);
  const float place = std::clamp(0.5f * (cosine + 1.0f) * last, 0.0f, last);
  const auto i = std::min(static_cast<std::size_t>(place), samples_.size() - 2);
  return samples_[i] + (place - static_cast<float>(i)) * (samples_[i + 1] - samples_[i]);
}

FirstTerm first_term(const BrdfFactors& factors, int order) {
  std::vector<float> exact(zonal_samples, 0.0f), by_harmonics, h(static_cast<std::size_t>(factors.terms()));
  std::vector<double> bands(static_cast<std::size_t>(order), 0.0);
  const auto cosine_of = [](int i) { return 2.0 * i / (zonal_samples - 1) - 1.0; };
  for (int i = zonal_samples / 2 + 1; i < zonal_samples && !h.empty(); ++i) {
    const double z = cosine_of(i);
    factors.incoming({static_cast<float>(std::sqrt(1.0 - z * z)), 0.0f, static_cast<float>(z)}, h);
    exact[static_cast<std::size_t>(i)] = h[0] * static_cast<float>(z);
    const double weight = whole_sphere / (zonal_samples - 1) * (i + 1 == zonal_samples ? 0.5 : 1.0);
    for (std::size_t l = 0; l < bands.size(); ++l) bands[l] += weight * h[0] * z * legendre(l, z);
  }
  FirstTerm first;
  first.sign = bands[0] < 0.0 ? -1.0f : 1.0f;
  for (int i = 0; i < zonal_samples; ++i)
    by_harmonics.push_back(first.sign * static_cast<float>(zonal_sum(bands, cosine_of(i))));
  for (float& value : exact) value *= first.sign;
  constexpr float small = 0.02f;
  first.least = small * std::ranges::max(by_harmonics);
  first.exact = ZonalTable(std::move(exact));
  first.by_harmonics = ZonalTable(std::move(by_harmonics));
  return first;
}

namespace {

struct Node {
  double place, weight;
};

/// Gauss's nodes on [−1, 1]: roots of Legendre's polynomial by Newton's steps.
std::vector<Node> gauss_nodes(int count) {
  std::vector<Node> nodes;
  for (int i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5)), slope = 1.0;
    for (int step = 0; step < 50; ++step) {
      double before = 1.0, now = x;
      for (int l = 1; l < count; ++l) {
        const double after = ((2.0 * l + 1.0) * x * now - l * before) / (l + 1.0);
        before = now;
        now = after;
      }
      slope = count * (x * now - before) / (x * x - 1.0);
      const double change = now / slope;
      x -= change;
      if (std::abs(change) < 1e-15) break;
    }
    nodes.push_back({x, 2.0 / ((1.0 - x * x) * slope * slope)});
  }
  return nodes;
}

}  // namespace

HarmonicProduct::HarmonicProduct(int order) {
  const int count = harmonics_of(order);
  // Three factors below `order` each: exact from that many nodes and azimuths on.
  const int azimuths = 3 * order;
  Eigen::MatrixXd values(count, 2 * order * azimuths);
  Eigen::VectorXd weights(values.cols());
  Eigen::Index column = 0;
  for (const auto& [z, weight] : gauss_nodes(2 * order))
    for (int a = 0; a < azimuths; ++a, ++column) {
      const double phi = 2.0 * std::numbers::pi * a / azimuths, across = std::sqrt(1.0 - z * z);
      evaluate_harmonics(order, {across * std::cos(phi), across * std::sin(phi), z},
                         {values.col(column).data(), static_cast<std::size_t>(count)});
      weights[column] = weight * 2.0 * std::numbers::pi / azimuths;
    }
  first_.push_back(0);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < count; ++j)
      for (int k = 0; k < count; ++k) {
        const double gamma =
            (values.row(i).array() * values.row(j).array() * values.row(k).array()).matrix() * weights;
        if (std::abs(gamma) < 1e-9) continue;
        pair_.push_back({static_cast<std::uint8_t>(j), static_cast<std::uint8_t>(k)});
        value_.push_back(static_cast<float>(gamma));
      }
    first_.push_back(static_cast<std::uint32_t>(value_.size()));
  }
}

Eigen::MatrixXf HarmonicProduct::matrix(std::span<const float> b) const {
  const auto count = static_cast<Eigen::Index>(first_.size() - 1);
  Eigen::MatrixXf matrix = Eigen::MatrixXf::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i)
    for (std::uint32_t p = first_[static_cast<std::size_t>(i)]; p < first_[static_cast<std::size_t>(i) + 1];
         ++p)
      matrix(i, pair_[p].j) += value_[p] * b[pair_[p].k];
  return matrix;
}

namespace {

using Eigen::Index;
using HarmonicsOfLight = Eigen::Matrix<float, Eigen::Dynamic, 3, 0, max_harmonics, 3>;

/// The area lights' points in some object's axes.
struct LightSamples {
  Eigen::Matrix3Xf position, normal, power;
  Eigen::ArrayXf area;
};

LightSamples area_lights_seen_from(std::span<const AreaPoint> points, const Pose& to_object) {
  const auto count = static_cast<Index>(points.size());
  LightSamples area_lights{Eigen::Matrix3Xf(3, count), Eigen::Matrix3Xf(3, count), Eigen::Matrix3Xf(3, count),
                           Eigen::ArrayXf(count)};
  for (Index j = 0; j < count; ++j) {
    const AreaPoint& point = points[static_cast<std::size_t>(j)];
    area_lights.position.col(j) = to_object * point.position;
    area_lights.normal.col(j) = to_object.linear() * point.normal;
    area_lights.power.col(j) = point.power.matrix();
    area_lights.area[j] = point.area;
  }
  return area_lights;
}

/// Those of them that stand above a vertex' horizon, the first `count` of each array.
struct AreaLightsAbove {
  AreaLightsAbove(Index points, Index harmonics)
      : number(static_cast<std::size_t>(points)),
        direction(3, points),
        arriving(3, points),
        harmonic(harmonics, points),
        cosine(points),
        behind(points) {}

  Index count = 0;
  std::vector<Index> number;             // among all
  Eigen::Matrix3Xf direction, arriving;  // arriving: on a plane that faces it
  Eigen::MatrixXf harmonic;              // [n² × points]
  Eigen::ArrayXf cosine;
  Eigen::ArrayXf behind;  // 1 where an object may stand before it, else 0

  void look(const LightSamples& area_lights, const Eigen::Vector3f& from, const Eigen::Vector3f& normal,
            int order) {
    count = 0;
    for (Index j = 0; j < area_lights.area.size(); ++j) {
      const Eigen::Vector3f way = area_lights.position.col(j) - from;
      const float height = normal.dot(way);
      if (height <= 0.0f) continue;
      const float squared = way.squaredNorm(), distance = std::sqrt(squared);
      number[static_cast<std::size_t>(count)] = j;
      direction.col(count) = way / distance;
      cosine[count] = height / distance;
      const float across = std::abs(area_lights.normal.col(j).dot(direction.col(count)));
      arriving.col(count++) = across / std::max(squared, area_lights.area[j]) * area_lights.power.col(j);
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

/// Another object that may stand before area lights.
struct Blocker {
  SeenObject seen;
  Eigen::Array3f half_size;
  Eigen::Matrix3Xf area_lights;  // in its axes

  /// Marks the area lights behind it; whether there are any.
  bool stands_in_the_way(const Eigen::Vector3f& from, AreaLightsAbove& above) const {
    bool any = false;
    for (Index j = 0; j < above.count; ++j) {
      const bool met =
          meets_box(half_size, from, area_lights.col(above.number[static_cast<std::size_t>(j)]) - from);
      above.behind[j] = met ? 1.0f : 0.0f;
      any |= met;
    }
    return any;
  }
};

/// Hides light by a product with what is left of the light of all area lights behind it together.
void hide_by_product(const Harmonics& covered, const HarmonicProduct& product, const AreaLightsAbove& above,
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
    : scene_(scene) {
  for (std::size_t o = 0; o < transport.size(); ++o) {
    Eigen::Array3f half = Eigen::Array3f::Zero();
    for (const auto& point : scene.objects[o].mesh.positions) half = half.max(point.array().abs());
    half_size_.push_back(half);
    first_.push_back(first_term(transport[o].factors, transport[o].order));
  }
}

TermLight FieldLight::direct(std::span<const PlacedObject> objects, std::size_t target,
                             std::span<const AreaPoint> points, const HarmonicProduct& product) const {
  const Mesh& mesh = scene_.objects[target].mesh;
  const ObjectTransport& target_transport = *objects[target].transport;
  const FirstTerm& first = first_[target];
  const LightSamples area_lights = area_lights_seen_from(points, objects[target].pose.inverse());
  std::vector<Blocker> blockers;
  for (std::size_t o = 0; o < objects.size(); ++o)
    if (o != target)
      blockers.push_back({seen_object(objects[o], objects[target].pose), half_size_[o],
                          area_lights_seen_from(points, objects[o].pose.inverse()).position});
  const Index terms = target_transport.terms();
  const std::size_t vertices = mesh.positions.size();
  TermLight light = TermLight::Zero(static_cast<Index>(vertices) * terms, 3);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, vertices, 64), [&](const auto& range) {
    AreaLightsAbove above(area_lights.area.size(), target_transport.receiving.rows());
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      above.look(area_lights, mesh.positions[v], mesh.normals[v], target_transport.order);
      if (above.count == 0) continue;
      HarmonicsOfLight arriving = above.light();
      for (const Blocker& blocker : blockers) {
        const Eigen::Vector3f from = blocker.seen.from_target * mesh.positions[v];
        if (!blocker.stands_in_the_way(from, above)) continue;
        const Harmonics covered = covered_by(blocker.seen, blocker.seen.transport->grid.around(from));
        hide_by_product(covered, product, above, arriving);
      }

      // What the first term would take with nothing else hidden: exactly, and by harmonics.
      Eigen::Array3f exact = Eigen::Array3f::Zero(), low = exact;
      for (Index j = 0; j < above.count; ++j) {
        const Eigen::Array3f part = above.arriving.col(j);
        if (!(part.maxCoeff() > 0.0f)) continue;
        exact += first.exact(above.cosine[j]) * part;
        low += std::max(first.by_harmonics(above.cosine[j]), first.least) * part;
      }
      auto rows = light.middleRows(static_cast<Index>(v) * terms, terms);
      rows = target_transport.receiving.middleCols(static_cast<Index>(v) * terms, terms)
                 .transpose()
                 .lazyProduct(arriving);
      const Eigen::Array3f safe = low.max(1e-30f);
      const Eigen::Array3f left = first.sign * rows.row(0).transpose().array() / safe;
      constexpr float max_factor = 2.0f;  // near the horizon harmonics tell too little
      const Eigen::Array3f scale = (left > 0.0f).select((exact / safe).min(max_factor), 0.0f);
      rows.array().rowwise() *= scale.transpose();
    }
  });
  return light;
}

SeenObject seen_object(const PlacedObject& object, const Pose& target) {
  const Pose from_target = object.pose.inverse() * target;
  const Eigen::Matrix3d rotation = from_target.linear().cast<double>();
  const Eigen::MatrixXf turn_back = harmonic_rotation(object.transport->order, rotation).cast<float>();
  return {object.transport, from_target, from_target.inverse().translation(), turn_back.transpose(),
          turn_back};
}

Harmonics covered_by(const SeenObject& object, const ShellGrid::Corners& corners) {
  const Eigen::MatrixXf& coverage = object.transport->coverage;
  Harmonics sum = Harmonics::Zero(coverage.rows());
  for (std::size_t i = 0; i < corners.point.size(); ++i)
    sum += corners.weight[i] * coverage.col(corners.point[i]);
  return object.turn * sum;
}

namespace {

/// Below the first share of the source's light an object is left out, from the second on it counts wholly:
/// between them it comes in smoothly.
constexpr float slight = 0.01f, full = 0.03f;

/// What one vertex of the target sees of the others: where to look it up, how much of each direction they
/// cover, and the matrix that takes from a function what is hidden, made when it is first needed.
class View {
 public:
  View(std::span<const SeenObject> others, const HarmonicProduct& product)
      : others_(others),
        product_(product),
        corners_(others.size()),
        covered_(others.size()),
        hidden_(others.size()) {}

  void look(const Eigen::Vector3f& position, std::size_t target, bool occlusion) {
    position_ = position;
    for (std::size_t o = 0; o < others_.size(); ++o) {
      if (o == target) continue;
      const ObjectTransport& object = *others_[o].transport;
      corners_[o] = object.grid.around(others_[o].from_target * position);
      leave_out_inside(object.outside, corners_[o]);
      if (!occlusion) continue;
      covered_[o] = covered_by(others_[o], corners_[o]);
      hidden_[o].resize(0, 0);
    }
  }

  const ShellGrid::Corners& corners(std::size_t object) const { return corners_[object]; }

  /// Takes from `receiving` [n² × K] what `occluder` hides of `source`; false where that is next to nothing.
  bool hide(std::size_t occluder, std::size_t source, Eigen::MatrixXf& receiving) {
    const SeenObject &front = others_[occluder], &back = others_[source];
    const float lit = covered_[source].squaredNorm();
    if (!(lit > 0.0f) ||
        !stands_before(position_, front.middle, front.transport->radius, back.middle, back.transport->radius))
      return false;
    const float share = covered_[source].dot(covered_[occluder]) / lit;
    if (share < slight) return false;
    Eigen::MatrixXf& hidden = hidden_[occluder];
    if (hidden.size() == 0)
      hidden = product_.matrix({covered_[occluder].data(), static_cast<std::size_t>(receiving.rows())});
    receiving -= std::min((share - slight) / (full - slight), 1.0f) * (hidden * receiving).eval();
    return true;
  }

 private:
  std::span<const SeenObject> others_;
  const HarmonicProduct& product_;
  Eigen::Vector3f position_ = Eigen::Vector3f::Zero();
  std::vector<ShellGrid::Corners> corners_;  // [objects]
  std::vector<Harmonics> covered_;           // [objects]
  std::vector<Eigen::MatrixXf> hidden_;      // [objects], n² × n²; empty: not made yet
};

}  // namespace

void leave_out_inside(const std::vector<bool>& outside, ShellGrid::Corners& corners) {
  float all = 0.0f, kept = 0.0f;
  for (std::size_t i = 0; i < corners.point.size(); ++i) {
    all += corners.weight[i];
    if (outside[corners.point[i]])
      kept += corners.weight[i];
    else
      corners.weight[i] = 0.0f;
  }
  // A place with next to nothing outside of the object is in it: nothing comes there, smoothly.
  constexpr float min_share = 0.05f;
  const float factor = all / std::max(kept, min_share * std::max(all, 1e-30f));
  for (float& weight : corners.weight) weight *= factor;
}

bool stands_before(const Eigen::Vector3f& from, const Eigen::Vector3f& middle, float radius,
                   const Eigen::Vector3f& other_middle, float other_radius) {
  const float apart = (middle - other_middle).norm();
  const bool within = apart < other_radius, around = apart < radius;
  if (within != around) return within;
  if (within && around) return radius < other_radius;
  return (from - middle).norm() - radius < (from - other_middle).norm() - other_radius;
}

void place_pairs(std::span<const PlacedObject> objects, std::size_t target,
                 std::span<const Eigen::Vector3f> positions, const HarmonicProduct& product,
                 std::span<PairTransport> pairs) {
  const ObjectTransport& target_transport = *objects[target].transport;
  const Index terms = target_transport.terms();
  std::vector<SeenObject> others;
  for (const PlacedObject& object : objects) others.push_back(seen_object(object, objects[target].pose));
  for (std::size_t source = 0; source < objects.size(); ++source) {
    if (source == target) continue;
    pairs[source].corners.resize(positions.size());
    pairs[source].receiving.resize(target_transport.receiving.rows(), target_transport.receiving.cols());
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, positions.size(), 64), [&](const auto& range) {
    const auto first = static_cast<Index>(range.begin()) * terms;
    const auto count = static_cast<Index>(range.size()) * terms;
    for (std::size_t source = 0; source < objects.size(); ++source)
      if (source != target)
        pairs[source].receiving.middleCols(first, count).noalias() =
            others[source].turn_back * target_transport.receiving.middleCols(first, count);
    View view(others, product);
    const bool hides = objects.size() > 2;
    Eigen::MatrixXf receiving;
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      view.look(positions[v], target, hides);
      const auto column = static_cast<Index>(v) * terms;
      for (std::size_t source = 0; source < objects.size(); ++source) {
        if (source == target) continue;
        pairs[source].corners[v] = view.corners(source);
        bool hidden = false;
        receiving = target_transport.receiving.middleCols(column, terms);
        for (std::size_t other = 0; other < objects.size() && hides; ++other)
          if (other != source && other != target) hidden |= view.hide(other, source, receiving);
        if (hidden)
          pairs[source].receiving.middleCols(column, terms).noalias() = others[source].turn_back * receiving;
      }
    }
  });
}

void PairTransport::add(std::size_t vertex, const Eigen::MatrixXf& radiance,
                        Eigen::Ref<TermLight> light) const {
  const ShellGrid::Corners& from = corners[vertex];
  const Index count = receiving.rows(), terms = light.rows();
  Eigen::Matrix<float, Eigen::Dynamic, 1, 0, 3 * max_harmonics, 1> arriving;
  arriving.setZero(3 * count);
  for (std::size_t i = 0; i < from.point.size(); ++i)
    if (from.weight[i] != 0.0f)  // points that no one looks up hold nothing, not even zero
      arriving += from.weight[i] * radiance.col(from.point[i]);
  const auto taken = receiving.middleCols(static_cast<Index>(vertex) * terms, terms);
  for (Index k = 0; k < terms; ++k)
    for (Index c = 0; c < 3; ++c) light(k, c) += taken.col(k).dot(arriving.segment(c * count, count));
}

}  // namespace refield::dynamic
