// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/light/harmonics.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

struct HarmonicOptions {
  int order = 5;          ///< of the light, and of what glossy surfaces receive and send out: 2 to 8
  int directions = 2048;  ///< samples over the whole sphere, the same at every vertex
  /// Interreflection ends with the pass that brings the surfaces less than this share of the light that the
  /// first, the shadow pass, brought them (under uniform light); 1 and more: no interreflection.
  double until = 0.002;
  int max_passes = 16;  ///< of interreflection
  /// Radius of the sphere that the lights are on, around the middle() of the mesh; 0: infinitely far. Each of
  /// its points shines like a small ball, as bright seen from anywhere in the scene as from the middle
  /// (section 3.1, which leaves the emitter's cosine to the cube map, where it is that of the middle).
  double radius = 0.0;
  int map_resolution = 32;  ///< of the cube maps that the field is relit with: texels per face

  /// Throws InputError, naming the value.
  void check() const;
};

struct HarmonicStatistics {
  /// Light that arrives at the surfaces in each pass, the shadow pass first: mean irradiance ∕ π under
  /// uniform light of radiance one, weighted by the vertices' areas, mean of the channels.
  std::vector<double> pass_energy;
};

/// What vertices do to light given as harmonics: dense signed matrices.
struct HarmonicTransfer {
  int order = 0;     ///< of the light: columns = order²
  int outputs = 1;   ///< a vertex: 1 where all is diffuse, else order²
  int channels = 1;  ///< 3 where interreflection is coloured or a vertex is both diffuse and glossy, else 1
  /// [vertices × outputs × channels × columns]: output = Σ_j value_j · L_j, before the vertex' colour.
  std::vector<float> values;
  /// [vertices]: what outputs are to be multiplied by.
  std::vector<Eigen::Array3f> colours;

  int columns() const { return harmonics_of(order); }
  std::size_t vertices() const { return colours.size(); }
  /// [columns] of one output and channel; grey transfers answer every channel with the same.
  std::span<const float> row(std::size_t vertex, int output, int channel) const;
};

/// Band factors λ_l, l < order, of Material's lobe (n + 2)/2π · tⁿ over t > 0: what it leaves of band l when
/// it averages light around a direction, 2π ∫ lobe(t) P_l(t) dt (Funk and Hecke). In closed form:
/// λ_0 = (n + 2)/(n + 1), λ_1 = 1, λ_l = λ_(l−2) (n − l + 2)/(n + l + 1).
std::vector<double> lobe_factors(double exponent, int order);

/// Middle of the box around a mesh: where the sphere of lights and cube maps of area lights have theirs.
Eigen::Vector3f middle(const Mesh& mesh);

/// Radiance transfer by harmonics (Fujita and Kanai 2004; Sloan et al. 2002). With light given as its
/// coefficients L_j = ∫ L(ω) y_j(ω) dω, as seen from the scene's middle:
///  - Shadow pass (section 2.2): I_ij = ∫ V(ω) max(cos θ, 0) y_i(ω) y_j(ω) dω, the harmonics i of light that
///    arrives at a vertex, times its cosine. Diffuse vertices reflect ∫ I = I_0 ∕ y_00.
///  - Interreflection passes: where a ray meets the front of a triangle, what its vertices sent out in the
///    pass before, weighted as the point divides the triangle, replaces V y_j. Backs are black.
///  - A lobe k(r · ω), r the mirrored line of sight R, turns I_ij into harmonics of the radiance over R by
///    band factors λ_l (α G* of equation 3): radiance = Σ_i λ_l(i) y_i(R) Σ_j I_ij L_j.
/// Deviation: the paper's glossy passes have no cosine; it then belongs to the lobe, which is not that of
/// Material. Here it stands in I, so that glossy and diffuse surfaces and the path-traced reference are lit
/// alike.
/// Finite radius r (section 3.1): coefficients are still those of the light seen from the middle, taken as
/// light at distance r. The shadow pass integrates over points r ω' of that sphere, with
/// cos θ dω' r² ∕ |r ω' − x|² instead of cos θ dω (r² does not stand in the paper: with it the scene's middle
/// is as bright as under distant light, and r → ∞ is the distant case). Throws InputError where a vertex does
/// not lie well inside the sphere.
/// A scene with any glossy material has order² outputs a vertex. Progress and Ctrl-C for each pass.
HarmonicTransfer harmonic_transfer(const Scene& scene, const HarmonicOptions& options,
                                   HarmonicStatistics& statistics, const RunContext& run = {});

/// The transfer as a field over cube maps of `map_resolution` texels per face, which sums harmonics of the
/// light and relights as all fields do. Output s is number s mod outputs of vertex s ∕ outputs; a positive
/// value goes to the kernel of its harmonic, a negative one to that of its opposite. Provenance is the
/// caller's.
FieldRows harmonic_field(const Scene& scene, HarmonicTransfer transfer, int map_resolution);
/// The field of harmonic_transfer(); provenance has the options and statistics.
FieldRows harmonic_field(const Scene& scene, const HarmonicOptions& options, const RunContext& run = {});

}  // namespace refield::prt
