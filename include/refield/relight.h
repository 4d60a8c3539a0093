// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <memory>
#include <span>

#include "refield/field.h"

/// Relighting of a reflectance field: many lights one after another, environments, cameras before a mesh.
namespace refield {
inline namespace v0_2 {

/// How a relighter trades error for speed, as relative RMSE against Field::relight(). `fast`: weights of 8
/// bits; 4e-4 for estimated fields, and below 1e-3 where a pixel has some ten kernels. `fine`: 16 bits and
/// sums of light in double; 2e-6, below 1e-5. Fields with negative weights are always shown `fine`: rounding
/// of what nearly cancels in a pixel weighs more there.
enum class RelightPrecision { fast, fine };

/// Shows one field of pixels under one light after another, [height × width × 3]. Keeps the light and the
/// image between calls, so that a change of part of the light costs only what it touches. Not for several
/// threads at once; its own work runs on all cores.
class REFIELD_API Relighter {
 public:
  /// Lays the field out for speed. Throws InputError for a field over a mesh and for a light map of more than
  /// 32767 texels per side.
  explicit Relighter(const Field& field, RelightPrecision precision = RelightPrecision::fast);
  Relighter(Relighter&& other) noexcept;
  ~Relighter();

  int width() const;
  int height() const;
  LightDomain light_domain() const;

  /// Throws InputError when the light does not fit light_domain() or has values that are not finite.
  Image relight(const LightMapView& light);
  void relight(const LightMapView& light, std::span<float> picture);
  /// The picture after `light` changed only inside `changed` since the last call, in less time the less of it
  /// changed. Throws InputError when `changed` lies outside the light map, too.
  void update(const LightMapView& light, const Box& changed, std::span<float> picture);

 private:
  struct Data;
  std::unique_ptr<Data> data_;
};

/// A map of the light from all directions, lat-long (twice as wide as high) or cube (six square faces stacked
/// vertically). Copies share it. From several threads at a time.
class REFIELD_API Environment {
 public:
  /// Throws InputError for other proportions, and what read_light_map() does; values that state other
  /// primaries than those of Rec.709 are converted.
  explicit Environment(const std::filesystem::path& file, const RunContext& run = {});
  /// A copy of a map [height × width × 3]; messages call it "map".
  explicit Environment(const ImageView& map, const RunContext& run = {});

  /// The light that a domain receives from the environment turned by `turn`: every texel gets the mean
  /// radiance over its solid angle, by the exact overlaps of texels on the sphere. `monitors`: placements
  /// where the domain is of monitors. Throws InputError where they are missing.
  LightMap project(const LightDomain& domain, std::span<const MonitorPlacement> monitors = {},
                   const EulerAngles& turn = {}, const RunContext& run = {}) const;

 private:
  std::shared_ptr<const LightMap> map_;
};

/// A pinhole camera in the axes of light directions (+X right, +Y up, +Z ahead, left-handed).
struct ViewCamera {
  std::array<float, 3> position{0.0f, 0.0f, -3.0f};
  std::array<float, 3> target{};
  std::array<float, 3> up{0.0f, 1.0f, 0.0f};
  float vertical_field_of_view_degrees = 35.0f;
  int width = 640;  ///< pixels
  int height = 480;
};

/// Pictures of a field over a mesh from one camera: what the camera sees is found once.
class REFIELD_API MeshView {
 public:
  /// Throws InputError for a field without a mesh, and for an empty image, a field of view outside (0, 180)
  /// degrees, a target at the camera or an `up` along the view.
  MeshView(const Field& field, const ViewCamera& camera);
  MeshView(MeshView&& other) noexcept;
  ~MeshView();

  /// The picture [camera's height × width × 3], black where no mesh is. Throws as Field::relight().
  Image relight(const LightMapView& light) const;

 private:
  struct Data;
  std::unique_ptr<const Data> data_;
};

}  // namespace v0_2
}  // namespace refield
