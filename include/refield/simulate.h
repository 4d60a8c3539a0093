// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <memory>
#include <optional>

#include "refield/field.h"
#include "refield/session.h"

/// Captures and fields that are computed: simulated sessions, precomputed transport of meshes, moving scenes.
namespace refield {
inline namespace v0_2 {

/// What replaces a recipe's own values; what is empty stays.
struct SimulationOptions {
  std::optional<int> width, height;                  ///< of the photographs, pixels
  std::optional<int> light_width, light_height;      ///< of the light maps, texels
  std::optional<int> train, natural, bars, squares;  ///< numbers of training and held-out frames
  std::optional<int> seed;
  int quality = 2;              ///< of tracing, 1 to 3
  double noise = 0.0;           ///< relative standard deviation of Gaussian noise on every photograph
  bool keep_transport = false;  ///< write the exact transport, transport.rfield
};

/// Traces a recipe's scene (docs/reference/synthetic-scenes.md) and writes a complete capture session into
/// `folder`, which must be empty or new. Throws InputError for values out of range.
REFIELD_API Session simulate(const std::filesystem::path& recipe, const std::filesystem::path& folder,
                             const SimulationOptions& options = {}, const RunContext& run = {});

/// How transport is precomputed; what is empty has the default of the method.
struct PrecomputeOptions {
  /// Johan and Nishita's light clusters, or spherical harmonics (Fujita and Kanai 2004).
  enum class Method { clusters, harmonics };
  Method method = Method::clusters;
  // Of clusters.
  std::optional<int> resolution;  ///< of the cube maps, texels per face's side
  std::optional<double> epsilon;  ///< clustering error threshold
  std::optional<int> diffuse_bounces;
  bool image = false;  ///< outputs are the pixels of the scene's camera, not the vertices
  std::optional<int> pixel_samples;
  // Of harmonics.
  std::optional<int> order;       ///< 2 to 8
  std::optional<int> directions;  ///< samples over the whole sphere
  std::optional<double> radius;   ///< of the sphere that the lights are on; 0: infinitely far
};

/// A scene of meshes (docs/reference/scene-files.md) as a packed field over a cube map. Throws InputError for
/// scenes that do not suit and options out of range.
REFIELD_API Field precompute(const std::filesystem::path& scene, const PrecomputeOptions& options = {},
                             const RunContext& run = {});

/// Pictures of a scene of moving objects and area lights (Iwasaki et al. 2007), precomputed once. One picture
/// at a time.
class REFIELD_API MovingPictures {
 public:
  /// `as_published`: the paper's method in all details. Throws InputError and FormatError for a scene or mesh
  /// that cannot be used.
  explicit MovingPictures(const std::filesystem::path& scene, bool as_published = false,
                          const RunContext& run = {});
  MovingPictures(MovingPictures&& other) noexcept;
  ~MovingPictures();

  double duration() const;  ///< of the motion, seconds
  /// Scene-linear radiance [height × width × 3] at a time of 0 or more seconds with 0 or more `bounces` of
  /// indirect light. Throws InputError for values out of range.
  Image picture(double time, int bounces = 3);

 private:
  struct Data;
  std::unique_ptr<Data> data_;
};

}  // namespace v0_2
}  // namespace refield
