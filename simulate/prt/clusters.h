// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/light/light_map.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

/// What a weight says of an output's transfer from a square: the constant that stands for it, or the value of
/// a linear function of the direction at one of three corners.
enum class SquareKernel : std::uint8_t { constant, upper_left, upper_right, lower_left };

/// The transfer of 16 outputs from some light clusters, one byte each weight with a common scale for a
/// kernel (section 6 of Johan and Nishita has one byte and no zeros; here kernels that give nothing to all 16
/// are dropped).
struct GroupWeights {
  std::vector<std::uint32_t> kernel;  ///< kernel_key() while clustering, then number in the basis
  std::vector<float> scale;           ///< [kernels]
  std::vector<std::uint8_t> weight;   ///< [kernels × values]

  static std::uint32_t kernel_key(std::uint32_t square, SquareKernel kernel) {
    return 4 * square + static_cast<std::uint32_t>(kernel);
  }
  /// `values` ≥ 0, as many for each kernel.
  void append(std::uint32_t key, std::span<const float> values) {
    constexpr float largest = 255.0f, half = 0.5f;
    const float top = *std::ranges::max_element(values);
    if (top <= 0.0f) return;
    kernel.push_back(key);
    scale.push_back(top / largest);
    for (const float value : values)
      weight.push_back(static_cast<std::uint8_t>(value / top * largest + half));
  }
};

/// A square of a cube map's face, in texels of the stacked faces (core/light/cube_map.h), and its name in the
/// quadtree of its face. Where a side is odd the first half is the larger one, so that sides of squares
/// differ by one at most and any resolution will do.
struct CubeSquare {
  Box box;
  std::uint32_t name = 0;  ///< 8 + face, then two bits for each quadrisection
};

inline constexpr int largest_cube_resolution = 4096;  ///< 12 quadrisections, 28 bits of a name

CubeSquare face_square(int face, int resolution);
/// Some are empty (area 0) where a side is one texel.
std::array<CubeSquare, 4> quadrisect(const CubeSquare& square);
/// The box of a name.
Box box_of_name(std::uint32_t name, int resolution);

/// Directions of a square's corners: upper left, upper right, lower left, lower right.
std::array<Eigen::Vector3d, 4> corners_of(const Box& square, int resolution);
/// The linear functions of the direction, vector · ω, that are 1 at one of the first three corners and 0 at
/// the others: weights of a function that is nowhere negative in the square are its values there.
std::array<Eigen::Vector3d, 3> corner_functions(const Box& square, int resolution);

/// Which outputs decide together how light is clustered.
///  - all_outputs: one clustering for all, by the norm over all outputs (Johan and Nishita, eq. 11).
///  - group: each group of 16 neighbours has its own cut through the same quadtrees.
enum class Similarity { all_outputs, group };

struct ClusterOptions {
  Relighting relighting = Relighting::geometry;
  Similarity similarity = Similarity::group;
  int resolution = 1024;  ///< R: the light has 6 R² texels; 1 to 4096
  int samples = 3;        ///< s: lights tried along a square's side, 2 to 16
  /// Clustering error threshold.
  ///  - all_outputs: ε of eq. 11, ‖T_C − T_l‖ ∕ N < ε for all samples l (and, of an image, each channel).
  ///  - group: a square of solid angle Ω is cut while Ω · σ > ε for an output (and channel) of the group,
  ///    σ² being the mean squared difference between T and its fit over the square's samples: what the output
  ///    changes by, of what white would give under white light, when the square's light is as strong but
  ///    comes from elsewhere in it.
  double epsilon = 1e-4;
  int pixel_samples = 1;  ///< image relighting: points along a pixel's side, 1 to 8
  int bounces = 0;        ///< of light between diffuse surfaces; 0 to 16. The paper has none
};

struct ClusterStatistics {
  std::uint64_t clusters = 0;  ///< light clusters in the basis
  std::uint64_t entries = 0;   ///< weights (output × square) that are not zero in some channel
  /// What the paper counts as data: bytes that are not zero once white facing the light is 255, all channels.
  std::uint64_t bytes_of_paper = 0;
  /// Lights whose transfer vectors were computed; with cuts of groups, that many on average.
  double lights = 0.0;
  std::uint64_t rays = 0;
  std::uint64_t peak_vectors = 0;  ///< transfer vectors held at a time; 0 with cuts of groups
  double seconds = 0.0;
};

/// The scene's transfer from squares of a cube map: a field over boxes with Measure::solid_angle; a weight is
/// the mean of T over a square's samples (eq. 10), or with cuts of groups the fit of T by a linear function
/// of the direction (VectorBox). Throws InputError for options out of range and scenes that do not suit
/// (layout_of()), Interrupted after Ctrl-C. Results do not depend on the number of threads. The rows hold
/// what they need of the scene.
FieldRows cluster_transfer(const Scene& scene, const ClusterOptions& options, ClusterStatistics& statistics,
                           const RunContext& run = {});

/// One clustering for all outputs (Johan and Nishita, section 4): squares are quadrisected until the samples'
/// transfer vectors are similar. A light that is sampled again within a part of its square is not traced
/// again; its vector is dropped once its square is a cluster. Memory holds the vectors of one path through
/// the quadtree, never all lights. Returns the weights of each group.
std::vector<GroupWeights> cluster_lights(const TransferSamples& transfer, std::size_t outputs,
                                         const ClusterOptions& options, ClusterStatistics& statistics,
                                         const RunContext& run);

/// For each group of 16 outputs its own cut through the quadtrees of light (Similarity::group). Every face
/// is looked at in squares of an eighth of its side at least, and in squares as narrow as the lobe where
/// outputs mirror; a square whose samples differ is quadrisected; then squares are joined again from the
/// bottom up as long as the loss allows, assessed by all samples under them, each counting by its solid
/// angle.
///
/// In a square T is fitted by a constant, one weight, or where that does not do by a linear function of the
/// direction, three: exact for a diffuse surface that sees all of the square, as most do. The fit has the
/// mean of T, and is scaled towards it where it would be negative, so that no weight is negative.
std::vector<GroupWeights> cut_groups(const TransferSamples& transfer, const ClusterOptions& options,
                                     ClusterStatistics& statistics, const RunContext& run);

}  // namespace refield::prt
