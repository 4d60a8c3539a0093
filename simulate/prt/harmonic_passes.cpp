// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/harmonic_passes.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/run_context.h"
#include "core/light/harmonics.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

namespace {

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

}  // namespace refield::prt
