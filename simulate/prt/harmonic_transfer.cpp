// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/harmonic_transfer.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <numbers>

#include "core/base/json.h"
#include "core/field/transfer_tiles.h"
#include "core/light/cube_map.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

namespace {

using RowMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// How the vertices of a scene reflect harmonics of the light that arrives at them times its cosine, I_i,
/// over the mirrored line of sight R: radiance(R) = Σ_i response_i I_i y_i(R). A lobe takes the harmonics one
/// by one, a diffuse surface the mean: kd/π · I_0/y_00, as a constant over R the coefficient 4 kd I_0. The
/// lobe of a GGX material is multiplied by its GgxGain at R · normal, which mixes the harmonics.
class SurfaceResponse {
 public:
  SurfaceResponse(const Scene& scene, int order);

  /// 1 where the whole scene is diffuse (I_0 alone matters), else order².
  int outputs() const { return outputs_; }
  /// Whether all vertices reflect the three channels alike.
  bool is_grey() const { return grey_; }
  /// What a field multiplies a vertex by last: its diffuse or specular reflectance, white where it has both.
  Eigen::Array3f colour(std::size_t vertex) const;
  /// What a vertex sends in each of `channels` (1 where they are alike, or 3), [outputs × columns of the
  /// light]; `light` [1 or 3 channels]; with colour() or before it.
  std::vector<RowMatrix> reflect(std::size_t vertex, std::span<const RowMatrix> light, int channels,
                                 bool with_colour) const;

 private:
  /// Scale and offset as matrices over the harmonics of the mirrored line of sight.
  std::array<RowMatrix, 2> gain(std::size_t vertex) const;
  const Material& material(std::size_t vertex) const {
    return scene_->materials[scene_->material_of_vertex[vertex]];
  }
  Eigen::Array3f diffuse(std::size_t vertex) const;

  const Scene* scene_;
  int outputs_ = 1;
  bool grey_ = true;
  std::vector<Eigen::VectorXf> lobe_;               // [materials][order²]
  std::vector<std::optional<GgxGain>> gain_;        // [materials]
  Eigen::Matrix<float, Eigen::Dynamic, 3> sights_;  // where gains are sampled; no rows: there are none
  RowMatrix at_sights_;                             // [sights × order²]
};

/// For each vertex and channel a matrix I: row i, the harmonics of light that arrives times its cosine
/// (I_0 alone where all is diffuse); column j, the harmonics of the scene's light.
struct ArrivingLight {
  int rows = 0, columns = 0, channels = 0;
  std::vector<float> values;  ///< [vertices × rows × channels × columns]

  ArrivingLight(std::size_t vertices, int rows, int columns, int channels);
  using Strided = Eigen::Map<RowMatrix, 0, Eigen::OuterStride<>>;
  using ConstStrided = Eigen::Map<const RowMatrix, 0, Eigen::OuterStride<>>;
  Strided of(std::size_t vertex, int channel);
  ConstStrided of(std::size_t vertex, int channel) const;
  std::vector<RowMatrix> channels_of(std::size_t vertex) const;

 private:
  std::size_t start(std::size_t vertex, int channel) const;
};

/// The passes of harmonic_transfer(). Keeps, as the paper does, a bit for each vertex and direction: whether
/// a ray that way meets a surface that reflects, so that interreflection traces those alone.
class HarmonicPasses {
 public:
  HarmonicPasses(const Scene& scene, const HarmonicOptions& options, const SurfaceResponse& response);

  /// One channel: what lies in the way dims all alike.
  ArrivingLight shadow(const RunContext& run = {});
  /// Light that arrives by one reflection more than `before`. All its channels.
  ArrivingLight interreflection(const ArrivingLight& before, const RunContext& run = {});

 private:
  static constexpr std::size_t block = MeshRays::packet;
  struct Block;  // successive vertices and their samples' weights
  struct Sight;  // a sample of the light sphere as a vertex sees it

  void see_distant(Block& block);
  void see_near(Block& block) const;
  Sight sight_of(const Eigen::Vector3f& from, std::size_t sample) const;
  void integrate(const Block& block, std::size_t lane, ArrivingLight& light) const;
  /// What surfaces send out of the light that arrives.
  ArrivingLight reflect(const ArrivingLight& light) const;
  /// The front that a ray from a vertex meets.
  std::optional<MeshHit> reflector(std::size_t vertex, std::size_t sample) const;
  /// The first `count` harmonics of the line of sight along a ray, mirrored where the ray meets a surface.
  Eigen::RowVectorXf mirrored_harmonics(const MeshHit& hit, const Eigen::Vector3f& direction,
                                        int count) const;
  void gather(std::size_t vertex, const ArrivingLight& sent, ArrivingLight& light);

  std::uint64_t* blocked_of(std::size_t vertex) { return &blocked_[vertex * words_]; }
  std::size_t samples() const { return directions_.size(); }

  const Scene& scene_;
  const HarmonicOptions& options_;
  const SurfaceResponse& response_;
  MeshRays rays_;
  Eigen::Vector3f middle_;
  std::vector<Eigen::Vector3f> directions_;
  RowMatrix harmonics_;  // [samples × order²]
  float solid_angle_;    // of a sample
  std::size_t words_;    // of a vertex' bits
  std::vector<std::uint64_t> blocked_;
};

/// Diffuse radiance as the coefficient of y_00 over I_00: (1/π) (I_0 / y_00) / y_00.
constexpr float diffuse_factor = 4.0f;
/// Directions at which a gain is sampled.
constexpr int gain_samples = 384;

/// Values of the first `count` harmonics, count a square.
Eigen::RowVectorXf harmonics_towards(const Eigen::Vector3f& direction, Eigen::Index count) {
  const int order = static_cast<int>(std::lround(std::sqrt(static_cast<double>(count))));
  Eigen::RowVectorXd values(count);
  evaluate_harmonics(order, direction.cast<double>().normalized(),
                     {values.data(), static_cast<std::size_t>(count)});
  return values.cast<float>();
}

bool is_grey(const Eigen::Array3f& colour) {
  return (colour == colour[0]).all();
}

}  // namespace

std::vector<double> lobe_factors(double exponent, int order) {
  std::vector<double> factors = {(exponent + 2.0) / (exponent + 1.0), 1.0};
  for (int l = 2; l < order; ++l)
    factors.push_back(factors[static_cast<std::size_t>(l) - 2] * (exponent - l + 2.0) / (exponent + l + 1.0));
  factors.resize(static_cast<std::size_t>(order));
  return factors;
}

SurfaceResponse::SurfaceResponse(const Scene& scene, int order) : scene_(&scene) {
  bool gains = false;
  for (const Material& material : scene.materials) {
    if (!material.is_diffuse()) outputs_ = harmonics_of(order);
    const std::vector<double> bands = lobe_factors(material.exponent, order);
    Eigen::VectorXf& lobe = lobe_.emplace_back(harmonics_of(order));
    for (int l = 0; l < order; ++l)
      lobe.segment(l * l, 2 * l + 1).setConstant(static_cast<float>(bands[static_cast<std::size_t>(l)]));
    gain_.emplace_back();
    if (material.is_diffuse() || material.roughness <= 0.0f) continue;
    gain_.back().emplace(material.roughness);
    gains = true;
  }
  if (gains) {
    const std::vector<Eigen::Vector3d> sights = hammersley_sphere(gain_samples);
    sights_.resize(gain_samples, 3);
    at_sights_.resize(gain_samples, harmonics_of(order));
    for (Eigen::Index i = 0; i < gain_samples; ++i) {
      sights_.row(i) = sights[static_cast<std::size_t>(i)].transpose().cast<float>();
      at_sights_.row(i) = harmonics_towards(sights_.row(i).transpose(), at_sights_.cols());
    }
  }
  for (std::size_t v = 0; v < scene.mesh.positions.size() && grey_; ++v)
    grey_ = prt::is_grey(diffuse(v)) && prt::is_grey(scene.specular(v));
}

Eigen::Array3f SurfaceResponse::diffuse(std::size_t vertex) const {
  return material(vertex).diffuse * scene_->mesh.colours[vertex];
}

Eigen::Array3f SurfaceResponse::colour(std::size_t vertex) const {
  if (material(vertex).is_diffuse()) return diffuse(vertex);
  if ((diffuse(vertex) == 0.0f).all()) return scene_->specular(vertex);
  return Eigen::Array3f::Ones();
}

std::array<RowMatrix, 2> SurfaceResponse::gain(std::size_t vertex) const {
  const GgxGain& gain = *gain_[scene_->material_of_vertex[vertex]];
  const Eigen::VectorXf cosines = sights_ * scene_->mesh.normals[vertex];
  constexpr float weight = 4.0f * std::numbers::pi_v<float> / gain_samples;
  Eigen::VectorXf scale(cosines.size()), offset(cosines.size());
  for (Eigen::Index i = 0; i < cosines.size(); ++i) {
    const GgxGain::At at = gain(cosines[i]);
    scale[i] = weight * (at.scale - 1.0f);  // a gain of one is the identity, whatever the samples
    offset[i] = weight * at.offset;
  }
  std::array<RowMatrix, 2> matrices = {at_sights_.transpose() * scale.asDiagonal() * at_sights_,
                                       at_sights_.transpose() * offset.asDiagonal() * at_sights_};
  matrices[0].diagonal().array() += 1.0f;
  return matrices;
}

std::vector<RowMatrix> SurfaceResponse::reflect(std::size_t vertex, std::span<const RowMatrix> light,
                                                int channels, bool with_colour) const {
  const std::uint16_t material = scene_->material_of_vertex[vertex];
  const Eigen::Array3f diffuse = this->diffuse(vertex);
  const bool shines = !scene_->materials[material].is_diffuse(), both = (diffuse != 0.0f).any();
  const bool coloured = with_colour || (shines && both);  // colour() is white there
  std::array<RowMatrix, 2> gain;
  if (shines && gain_[material]) gain = this->gain(vertex);
  std::vector<RowMatrix> sent(static_cast<std::size_t>(channels));
  for (std::size_t c = 0; c < sent.size(); ++c) {
    const RowMatrix& arriving = light[std::min(c, light.size() - 1)];
    RowMatrix& out = sent[c] = RowMatrix::Zero(arriving.rows(), arriving.cols());
    const auto k = static_cast<Eigen::Index>(c);
    const auto part = [&](float reflectance) { return coloured ? reflectance : 1.0f; };
    if (shines) {
      const float specular = part(scene_->specular(vertex)[k]);
      const RowMatrix lobe = lobe_[material].asDiagonal() * arriving;
      if (!gain_[material])
        out = specular * lobe;
      else if (both && specular > 0.0f)
        out.noalias() = (specular * gain[0] + gain[1]) * lobe;
      else  // as GgxGain::At: metals keep their colour
        out.noalias() = specular * (gain[0] + gain[1]) * lobe;
    }
    if (!shines || both) out.row(0) += diffuse_factor * part(diffuse[k]) * arriving.row(0);
  }
  return sent;
}

namespace {

/// Calls work(begin, end) for blocks of successive vertices on all cores.
template <class Work>
void for_blocks(const char* label, std::size_t vertices, std::size_t block, const Work& work,
                const RunContext& run) {
  Progress progress(run, label, vertices);
  tbb::parallel_for(std::size_t{0}, (vertices + block - 1) / block, [&](std::size_t b) {
    run.throw_if_stopped();
    const std::size_t begin = b * block, end = std::min(begin + block, vertices);
    work(begin, end);
    progress.advance(end - begin);
  });
}

}  // namespace

ArrivingLight::ArrivingLight(std::size_t vertices, int row_count, int column_count, int channel_count)
    : rows(row_count),
      columns(column_count),
      channels(channel_count),
      values(vertices * static_cast<std::size_t>(row_count * column_count * channel_count)) {}

std::size_t ArrivingLight::start(std::size_t vertex, int channel) const {
  return (vertex * static_cast<std::size_t>(rows * channels) + static_cast<std::size_t>(channel)) *
         static_cast<std::size_t>(columns);
}

ArrivingLight::Strided ArrivingLight::of(std::size_t vertex, int channel) {
  return {values.data() + start(vertex, channel), rows, columns,
          Eigen::OuterStride<>(Eigen::Index{channels} * columns)};
}

ArrivingLight::ConstStrided ArrivingLight::of(std::size_t vertex, int channel) const {
  return {values.data() + start(vertex, channel), rows, columns,
          Eigen::OuterStride<>(Eigen::Index{channels} * columns)};
}

std::vector<RowMatrix> ArrivingLight::channels_of(std::size_t vertex) const {
  std::vector<RowMatrix> all;
  for (int c = 0; c < channels; ++c) all.emplace_back(of(vertex, c));
  return all;
}

struct HarmonicPasses::Block {
  std::size_t begin, lanes;
  std::vector<Eigen::Vector3f> points;  // [lanes], off their surfaces
  RowMatrix weight;                     // [lanes × samples], 0 where the sample is not seen
};

struct HarmonicPasses::Sight {
  Eigen::Vector3f direction;  // unit
  float distance;
  float gain;  // of a sample's light over what it gives the scene's middle
};

HarmonicPasses::HarmonicPasses(const Scene& scene, const HarmonicOptions& options,
                               const SurfaceResponse& response)
    : scene_(scene),
      options_(options),
      response_(response),
      rays_(scene.mesh),
      middle_(middle(scene.mesh)),
      harmonics_(options.directions, harmonics_of(options.order)),
      solid_angle_(static_cast<float>(4.0 * std::numbers::pi / options.directions)),
      words_((static_cast<std::size_t>(options.directions) + 63) / 64),
      blocked_(words_ * scene.mesh.positions.size()) {
  for (const Eigen::Vector3d& direction : hammersley_sphere(options.directions)) {
    harmonics_.row(static_cast<Eigen::Index>(directions_.size())) =
        harmonics_towards(direction.cast<float>(), harmonics_.cols());
    directions_.push_back(direction.cast<float>());
  }
}

HarmonicPasses::Sight HarmonicPasses::sight_of(const Eigen::Vector3f& from, std::size_t sample) const {
  const auto radius = static_cast<float>(options_.radius);
  const Eigen::Vector3f away = middle_ + radius * directions_[sample] - from;
  const float distance = away.norm();
  return {away / distance, distance, radius * radius / (distance * distance)};
}

void HarmonicPasses::see_distant(Block& now) {
  for (std::size_t k = 0; k < samples(); ++k) {
    const std::uint32_t free = rays_.unoccluded(now.points, directions_[k]);
    for (std::size_t lane = 0; lane < now.lanes; ++lane) {
      const float cosine = scene_.mesh.normals[now.begin + lane].dot(directions_[k]);
      if (cosine <= 0.0f) continue;
      if (free >> lane & 1)
        now.weight(static_cast<Eigen::Index>(lane), static_cast<Eigen::Index>(k)) = cosine * solid_angle_;
      else
        blocked_of(now.begin + lane)[k / 64] |= std::uint64_t{1} << (k % 64);
    }
  }
}

void HarmonicPasses::see_near(Block& now) const {
  std::vector<Eigen::Vector3f> directions(now.lanes);
  std::vector<float> distances(now.lanes);
  for (std::size_t k = 0; k < samples(); ++k) {
    const auto column = static_cast<Eigen::Index>(k);
    for (std::size_t lane = 0; lane < now.lanes; ++lane) {
      const Sight sight = sight_of(now.points[lane], k);
      const float cosine = scene_.mesh.normals[now.begin + lane].dot(sight.direction);
      now.weight(static_cast<Eigen::Index>(lane), column) =
          std::max(cosine, 0.0f) * sight.gain * solid_angle_;
      directions[lane] = sight.direction;
      distances[lane] = sight.distance;
    }
    const std::uint32_t free = rays_.unoccluded(now.points, directions, distances);
    for (std::size_t lane = 0; lane < now.lanes; ++lane)
      if (!(free >> lane & 1)) now.weight(static_cast<Eigen::Index>(lane), column) = 0.0f;
  }
}

void HarmonicPasses::integrate(const Block& now, std::size_t lane, ArrivingLight& light) const {
  const auto weight = now.weight.row(static_cast<Eigen::Index>(lane));
  if (light.rows == 1) {
    light.of(now.begin + lane, 0) = harmonics_(0, 0) * (weight * harmonics_);
    return;
  }
  // Few of the samples are seen: those alone make dense factors.
  RowMatrix arriving(weight.size(), light.rows), sent(weight.size(), light.columns);
  Eigen::Index seen = 0;
  for (Eigen::Index k = 0; k < weight.size(); ++k) {
    if (weight[k] <= 0.0f) continue;
    sent.row(seen) = harmonics_.row(k);
    if (options_.radius > 0.0)
      arriving.row(seen++) =
          weight[k] *
          harmonics_towards(sight_of(now.points[lane], static_cast<std::size_t>(k)).direction, light.rows);
    else
      arriving.row(seen++) = weight[k] * harmonics_.row(k);
  }
  light.of(now.begin + lane, 0).noalias() = arriving.topRows(seen).transpose() * sent.topRows(seen);
}

ArrivingLight HarmonicPasses::shadow(const RunContext& run) {
  const Mesh& mesh = scene_.mesh;
  ArrivingLight light(mesh.positions.size(), response_.outputs(), static_cast<int>(harmonics_.cols()), 1);
  // Rays to a near light end there: whether more lies in that direction is not known yet.
  if (options_.radius > 0.0) std::ranges::fill(blocked_, ~std::uint64_t{0});
  for_blocks(
      "shadow pass", mesh.positions.size(), block,
      [&](std::size_t begin, std::size_t end) {
        Block now{begin, end - begin, {}, {}};
        for (std::size_t v = begin; v < end; ++v)
          now.points.push_back(rays_.off_surface(mesh.positions[v], mesh.normals[v]));
        now.weight = RowMatrix::Zero(static_cast<Eigen::Index>(now.lanes), options_.directions);
        if (options_.radius > 0.0)
          see_near(now);
        else
          see_distant(now);
        for (std::size_t lane = 0; lane < now.lanes; ++lane) integrate(now, lane, light);
      },
      run);
  return light;
}

ArrivingLight HarmonicPasses::reflect(const ArrivingLight& light) const {
  const std::size_t vertices = scene_.mesh.positions.size();
  ArrivingLight sent(vertices, light.rows, light.columns, response_.is_grey() ? 1 : 3);
  tbb::parallel_for(std::size_t{0}, vertices, [&](std::size_t v) {
    const std::vector<RowMatrix> out = response_.reflect(v, light.channels_of(v), sent.channels, true);
    for (int c = 0; c < sent.channels; ++c) sent.of(v, c) = out[static_cast<std::size_t>(c)];
  });
  return sent;
}

Eigen::RowVectorXf HarmonicPasses::mirrored_harmonics(const MeshHit& hit, const Eigen::Vector3f& direction,
                                                      int count) const {
  if (count == 1) return harmonics_.row(0).head(1);
  const auto& corners = scene_.mesh.triangles[hit.triangle];
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  for (std::size_t k = 0; k < 3; ++k) normal += hit.share[k] * scene_.mesh.normals[corners[k]];
  normal.normalize();
  return harmonics_towards(direction - 2.0f * normal.dot(direction) * normal, count);
}

std::optional<MeshHit> HarmonicPasses::reflector(std::size_t vertex, std::size_t sample) const {
  const Mesh& mesh = scene_.mesh;
  if (mesh.normals[vertex].dot(directions_[sample]) <= 0.0f) return std::nullopt;
  const auto hit =
      rays_.intersect(rays_.off_surface(mesh.positions[vertex], mesh.normals[vertex]), directions_[sample]);
  return hit && hit->front ? hit : std::nullopt;
}

void HarmonicPasses::gather(std::size_t vertex, const ArrivingLight& sent, ArrivingLight& light) {
  Eigen::RowVectorXf from_hit(light.columns);
  for (std::size_t k = 0; k < samples(); ++k) {
    std::uint64_t& word = blocked_of(vertex)[k / 64];
    const std::uint64_t bit = std::uint64_t{1} << (k % 64);
    if (!(word & bit)) continue;
    const auto hit = reflector(vertex, k);
    if (!hit) {
      word &= ~bit;
      continue;
    }
    const Eigen::RowVectorXf mirrored = mirrored_harmonics(*hit, directions_[k], light.rows);
    const float weight = scene_.mesh.normals[vertex].dot(directions_[k]) * solid_angle_;
    const Eigen::RowVectorXf arriving =
        weight * harmonics_.row(static_cast<Eigen::Index>(k)).head(light.rows);
    for (int c = 0; c < light.channels; ++c) {
      from_hit.setZero();
      for (std::size_t corner = 0; corner < 3; ++corner)
        from_hit.noalias() +=
            (hit->share[corner] * mirrored) * sent.of(scene_.mesh.triangles[hit->triangle][corner], c);
      light.of(vertex, c).noalias() += arriving.transpose() * from_hit;
    }
  }
}

ArrivingLight HarmonicPasses::interreflection(const ArrivingLight& before, const RunContext& run) {
  const std::size_t vertices = scene_.mesh.positions.size();
  const ArrivingLight sent = reflect(before);
  ArrivingLight light(vertices, sent.rows, sent.columns, sent.channels);
  for_blocks(
      "interreflection", vertices, block,
      [&](std::size_t begin, std::size_t end) {
        for (std::size_t v = begin; v < end; ++v) gather(v, sent, light);
      },
      run);
  return light;
}

namespace {

/// Vertices may lie as far from the middle as this share of the lights' radius: nearer to the lights the
/// samples stand out one by one.
constexpr float farthest_share = 0.95f;

void check_radius(const Mesh& mesh, double radius) {
  if (radius == 0.0) return;
  const Eigen::Vector3f centre = middle(mesh);
  float farthest = 0.0f;
  for (const auto& position : mesh.positions) farthest = std::max(farthest, (position - centre).norm());
  if (farthest > farthest_share * radius)
    throw InputError("harmonics: radius ", radius, " of the sphere of lights: the scene reaches ", farthest,
                     " from its middle; give at least ", farthest / farthest_share,
                     ", or 0 for distant light");
}

/// HarmonicStatistics::pass_energy of a pass. Uniform light has the coefficient √4π of y_00 alone, and
/// irradiance is I_0 ∕ y_00.
double energy_of(const ArrivingLight& light, const std::vector<float>& areas) {
  double sum = 0.0, area = 0.0;
  for (std::size_t v = 0; v < areas.size(); ++v) {
    for (int c = 0; c < light.channels; ++c) sum += 4.0 * areas[v] * light.of(v, c)(0, 0) / light.channels;
    area += areas[v];
  }
  return area > 0.0 ? sum / area : 0.0;
}

/// `total` with as many channels as `pass`, plus it.
void add(ArrivingLight& total, const ArrivingLight& pass, std::size_t vertices) {
  if (total.channels == pass.channels) {
    std::ranges::transform(total.values, pass.values, total.values.begin(), std::plus<>());
    return;
  }
  ArrivingLight sum = pass;
  for (std::size_t v = 0; v < vertices; ++v)
    for (int c = 0; c < sum.channels; ++c) sum.of(v, c) += total.of(v, 0);
  total = std::move(sum);
}

ArrivingLight all_passes(const Scene& scene, const HarmonicOptions& options, const SurfaceResponse& response,
                         std::vector<double>& energy, const RunContext& run) {
  const std::vector<float> areas = vertex_areas(scene.mesh.positions, scene.mesh.triangles);
  HarmonicPasses passes(scene, options, response);
  ArrivingLight last = passes.shadow(run);
  ArrivingLight total = last;
  energy = {energy_of(last, areas)};
  for (int pass = 0; pass < options.max_passes && energy.back() > options.until * energy.front(); ++pass) {
    last = passes.interreflection(last, run);
    energy.push_back(energy_of(last, areas));
    add(total, last, scene.mesh.positions.size());
  }
  return total;
}

HarmonicTransfer reflect(const ArrivingLight& light, const Scene& scene, const HarmonicOptions& options,
                         const SurfaceResponse& response) {
  const std::size_t vertices = scene.mesh.positions.size();
  HarmonicTransfer transfer;
  transfer.order = options.order;
  transfer.outputs = light.rows;
  for (std::size_t v = 0; v < vertices; ++v) transfer.colours.push_back(response.colour(v));
  // Where a vertex is both diffuse and glossy, its channels may differ though the light's do not.
  const bool grey = light.channels == 1 && (light.rows == 1 || response.is_grey());
  transfer.channels = grey ? 1 : 3;
  const float y_00 = static_cast<float>(std::sqrt(0.25 / std::numbers::pi));
  const auto of_vertex = static_cast<std::size_t>(light.rows) * transfer.channels * light.columns;
  transfer.values.resize(vertices * of_vertex);
  tbb::parallel_for(std::size_t{0}, vertices, [&](std::size_t v) {
    const std::vector<RowMatrix> sent = response.reflect(v, light.channels_of(v), transfer.channels, false);
    float* to = transfer.values.data() + v * of_vertex;
    for (int i = 0; i < light.rows; ++i)
      for (int c = 0; c < transfer.channels; ++c, to += light.columns)
        Eigen::Map<Eigen::RowVectorXf>(to, light.columns) =
            (light.rows == 1 ? y_00 : 1.0f) * sent[static_cast<std::size_t>(c)].row(i);
  });
  return transfer;
}

}  // namespace

void HarmonicOptions::check() const {
  const auto require = [](bool good, const std::string& what, const std::string& remedy) {
    if (!good) throw InputError("harmonics: ", what, ": ", remedy);
  };
  require(order >= 2 && order <= 8, "order " + std::to_string(order), "give 2 to 8");
  require(directions >= 64 && directions <= 1 << 20, "directions " + std::to_string(directions),
          "give 64 to 1048576");
  require(until > 0.0, "until " + std::to_string(until), "give a share above 0, such as 0.002");
  require(max_passes >= 0, "max_passes " + std::to_string(max_passes), "give 0 or more");
  require(radius >= 0.0 && std::isfinite(radius), "radius " + std::to_string(radius),
          "give a length in units of the scene, or 0 for distant light");
  require(map_resolution >= 4 && map_resolution <= 4096, "map_resolution " + std::to_string(map_resolution),
          "give 4 to 4096 texels per face");
}

std::span<const float> HarmonicTransfer::row(std::size_t vertex, int output, int channel) const {
  const auto width = static_cast<std::size_t>(columns());
  const std::size_t at = (vertex * static_cast<std::size_t>(outputs) + static_cast<std::size_t>(output)) *
                             static_cast<std::size_t>(channels) +
                         static_cast<std::size_t>(std::min(channel, channels - 1));
  return {values.data() + at * width, width};
}

Eigen::Vector3f middle(const Mesh& mesh) {
  const Eigen::AlignedBox3f box = bounds_of(mesh);
  return box.isEmpty() ? Eigen::Vector3f::Zero() : Eigen::Vector3f(box.center());
}

HarmonicTransfer harmonic_transfer(const Scene& scene, const HarmonicOptions& options,
                                   HarmonicStatistics& statistics, const RunContext& run) {
  const ThreadLimit limit(run);
  options.check();
  if (scene.mesh.empty()) throw InputError("harmonics: the scene has no vertices; give it a mesh");
  check_radius(scene.mesh, options.radius);
  const SurfaceResponse response(scene, options.order);
  return reflect(all_passes(scene, options, response, statistics.pass_energy, run), scene, options, response);
}

namespace {

constexpr std::size_t dark = std::numeric_limits<std::size_t>::max();

/// Number of the output at each pixel of some image rows, or `dark` where there is none.
std::vector<std::size_t> outputs_at(RowRange rows, std::size_t outputs) {
  std::vector<std::size_t> at(static_cast<std::size_t>(rows.last - rows.first) * output_image_width, dark);
  // A row of tiles holds successive outputs.
  constexpr std::size_t of_tile_row = std::size_t{output_image_width} * tile_side_px;
  const std::size_t first = static_cast<std::size_t>(rows.first / tile_side_px) * of_tile_row,
                    last =
                        static_cast<std::size_t>((rows.last + tile_side_px - 1) / tile_side_px) * of_tile_row;
  const std::size_t before = static_cast<std::size_t>(rows.first) * output_image_width;
  for (std::size_t s = first; s < std::min(last, outputs); ++s) {
    const std::size_t pixel = pixel_of_output(s);
    if (pixel >= before && pixel - before < at.size()) at[pixel - before] = s;
  }
  return at;
}

/// Kernels and weights of one output.
struct SignedRow {
  std::vector<std::uint32_t> kernels;
  std::vector<float> weights;

  void set(const HarmonicTransfer& transfer, std::size_t output) {
    kernels.clear();
    weights.clear();
    const auto outputs = static_cast<std::size_t>(transfer.outputs);
    std::span<const float> channel[3];
    for (int c = 0; c < 3; ++c)
      channel[c] = transfer.row(output / outputs, static_cast<int>(output % outputs), c);
    for (std::size_t j = 0; j < channel[0].size(); ++j)
      for (const float sign : {1.0f, -1.0f}) {
        const float weight[3] = {std::max(0.0f, sign * channel[0][j]), std::max(0.0f, sign * channel[1][j]),
                                 std::max(0.0f, sign * channel[2][j])};
        if (weight[0] + weight[1] + weight[2] <= 0.0f) continue;
        kernels.push_back(static_cast<std::uint32_t>(2 * j + (sign < 0.0f)));
        weights.insert(weights.end(), weight, weight + 3);
      }
  }
};

}  // namespace

FieldRows harmonic_field(const Scene& scene, HarmonicTransfer transfer, int map_resolution) {
  FieldRows field;
  FieldOutline& outline = field.outline;
  outline.basis.domain = cube_domain(map_resolution);
  outline.basis.measure = Measure::solid_angle;
  outline.basis.harmonics = {transfer.order};
  OutputMesh mesh{scene.mesh, transfer.outputs == 1 ? 0 : transfer.order, scene.camera};
  mesh.colours = std::move(transfer.colours);
  outline.width = output_image_width;
  outline.height = output_image_height(mesh.outputs());
  const std::size_t outputs = mesh.outputs();
  outline.mesh = std::move(mesh);
  field.rows = [shared = std::make_shared<const HarmonicTransfer>(std::move(transfer)),
                outputs](RowRange range) {
    SparseTransfer rows;
    SignedRow row;
    for (const std::size_t output : outputs_at(range, outputs)) {
      if (output == dark)
        rows.append_row({}, {});
      else {
        row.set(*shared, output);
        rows.append_row(row.kernels, row.weights);
      }
    }
    return rows;
  };
  return field;
}

FieldRows harmonic_field(const Scene& scene, const HarmonicOptions& options, const RunContext& run) {
  HarmonicStatistics statistics;
  FieldRows field =
      harmonic_field(scene, harmonic_transfer(scene, options, statistics, run), options.map_resolution);
  field.outline.provenance = json_text({{"order", options.order},
                                        {"window", "none"},
                                        {"directions", options.directions},
                                        {"radius", options.radius},
                                        {"pass_energy", statistics.pass_energy}});
  return field;
}

}  // namespace refield::prt
