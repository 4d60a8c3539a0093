// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "core/base/run_context.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

/// The binary digits of k behind the point, the lowest first: in [0, 1), well spread for successive k.
double radical_inverse(std::uint32_t k);

/// `count` unit directions, evenly over the sphere: Hammersley's points, the height from the running number,
/// the azimuth from its binary digits reversed (Wong, Luk and Heng 1997). Each stands for 4π ∕ count
/// steradians.
std::vector<Eigen::Vector3d> hammersley_sphere(int count);

/// A point that gathers light from its environment; a zero normal: none.
struct Gatherer {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();  ///< off its surface
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
};

/// Diffuse interreflection: the light that reaches points by way of other surfaces, for each direction of
/// incident light. As this changes slowly with the direction, it is computed for 8×8 cells of each cube face
/// (four directions a cell) and interpolated between their middles. Surfaces on the way reflect by their
/// diffuse part alone; how bright they are is computed at the mesh' vertices, so coarse meshes are to be
/// refined. Each point looks around by 128 rays, the same for all, so what it misses shows as bias rather
/// than noise.
class BouncedLight {
 public:
  static constexpr std::size_t block = MeshRays::packet;

  /// `bounces` ≥ 1 surfaces on the way. Throws Interrupted. `rays` are needed here alone.
  BouncedLight(const Scene& scene, const MeshRays& rays, std::span<const Gatherer> points, int bounces,
               const RunContext& run);

  /// Adds what white points [16 of a block] reflect of light that was bounced: E ∕ π for light from a unit
  /// direction, `values` [channels × 16]; one channel takes the first.
  void add(std::size_t of_block, const Eigen::Vector3f& direction, std::span<float> values) const;

 private:
  std::size_t blocks_;
  std::vector<Eigen::half> table_;  // [blocks × cells × 3 × 16]
};

/// Whether all diffuse reflectance is grey, so that indirect light has the colour of the incident light.
bool bounces_grey(const Scene& scene);

/// What is relit (Johan and Nishita, section 3.1): a diffuse scene's vertices, seen from anywhere, or the
/// pixels of one view, of any material.
enum class Relighting { geometry, image };

/// An image whose pixels are a scene's outputs, and which of them are computed together.
struct OutputLayout {
  static constexpr std::uint32_t none = ~0u;
  int width = 0;
  int height = 0;
  /// [groups × 16]: vertices, or row-major pixels of the view; none where a group is not full. A group is a
  /// square of 4×4 pixels, row by row.
  std::vector<std::uint32_t> outputs;
  std::vector<std::uint32_t> place_of_pixel;  ///< [width × height], in `outputs`; none beyond the last output
};

/// Throws InputError for a scene without triangles, without a camera (image relighting) or with glossy
/// materials (geometry relighting).
OutputLayout layout_of(const Scene& scene, Relighting relighting);

struct TransferOptions {
  Relighting relighting = Relighting::geometry;
  int pixel_samples = 1;  ///< image relighting: a pixel is the mean over this many points along each side
  int bounces = 0;        ///< diffuse surfaces on the way of light (BouncedLight); the paper has none
};

/// A narrow lobe of reflection of one output: what must not fall between samples of the light.
struct Lobe {
  Eigen::Vector3f direction;  ///< unit, in which the line of sight is mirrored
  float exponent = 0.0f;
};

/// The transfer function of outputs for single directions of light, by ray tracing:
/// T = V f(ω, ω_o) max(ω · n, 0) (eqs. 2 and 3 of Johan and Nishita), and indirect light. A vertex' f is that
/// of white, 1/π: its colour multiplies last (core/field/mesh.h), so there is one channel for all unless
/// light bounces off coloured surfaces.
class TransferSamples {
 public:
  static constexpr std::size_t group_outputs = MeshRays::packet;

  /// `outputs`: as of OutputLayout, any of them. The scene must outlive this. Throws Interrupted.
  TransferSamples(const Scene& scene, const TransferOptions& options, std::span<const std::uint32_t> outputs,
                  const RunContext& run = {});

  int channels() const { return channels_; }
  std::size_t groups() const { return points_.size() / (group_outputs * packets_); }
  /// Values of a group.
  std::size_t group_values() const { return group_outputs * static_cast<std::size_t>(channels_); }

  /// The transfer of a group's outputs for light from a unit direction, `values` [channels × 16]. Returns the
  /// number of rays: outputs that face away cost none. May be called by several threads.
  std::uint32_t evaluate(std::size_t group, const Eigen::Vector3f& direction, std::span<float> values) const;

  /// Lobes of exponent `narrow` and above.
  std::vector<Lobe> lobes(std::size_t group, float narrow) const;

 private:
  struct Point {
    Eigen::Vector3f position = Eigen::Vector3f::Zero();  // off the surface
    Eigen::Vector3f normal = Eigen::Vector3f::Zero();    // zero: nothing is seen there
    Eigen::Vector3f mirrored = Eigen::Vector3f::Zero();  // line of sight
    Eigen::Array3f diffuse = Eigen::Array3f::Zero();     // all values of f, shared out among a pixel's points
    Eigen::Array3f specular = Eigen::Array3f::Zero();
    float exponent = 0.0f;
  };
  Point vertex_point(const Scene& scene, std::uint32_t vertex) const;
  Point pixel_point(const Scene& scene, float x, float y, float share) const;
  void prepare_bounces(const Scene& scene, int bounces, const RunContext& run);
  /// Returns the number of rays.
  std::uint32_t add_direct(const Point* points, const Eigen::Vector3f& direction,
                           std::span<float> values) const;
  void add_bounced(std::size_t group, const Eigen::Vector3f& direction, std::span<float> values) const;

  MeshRays rays_;
  std::map<float, GgxGain> gains_;  // of roughness
  int channels_ = 1;
  std::size_t packets_ = 1;    // of a group: points of a pixel
  std::vector<Point> points_;  // [groups × packets × 16]
  std::optional<BouncedLight> bounced_;
  std::vector<Eigen::Array3f> reflectance_;  // [groups × 16], of indirect light
};

}  // namespace refield::prt
