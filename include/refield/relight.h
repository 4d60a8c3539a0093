// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "refield/field.h"

/// Relighting of a reflectance field: many lights one after another, environments, cameras before a mesh,
/// pictures and videos on disk.
namespace refield {

class PreparedEnvironment;

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

// ---- lights

/// Throws InputError unless the light map of a file has the size of the field's light_domain(). Reads its
/// header alone.
REFIELD_API void require_light(const Field& field, const std::filesystem::path& file);

/// Frame `frame` of `frames` of a vertical bar of light that slides from left to right (Matusik et al. 2004,
/// figure 9: a white bar of 100 columns in a map of 800). `width_fraction`: of the map's width, in (0, 1].
/// Columns that the bar covers in part are lit in part, so that slow sequences move smoothly. On a monitor
/// the bar goes from edge to edge; in a lat-long map, whose edges meet, it goes once around. Throws
/// InputError for a fraction or frame out of range.
REFIELD_API LightMap sliding_bar(const LightDomain& domain, double width_fraction, int frame, int frames,
                                 float radiance = 1.0f);

/// A lat-long map turned about the vertical axis by `turns` (1 = full circle), content moving to the right;
/// columns are interpolated linearly. Throws InputError for another parameterisation.
REFIELD_API LightMap rotated(const LightMap& light, double turns);

/// Light `a` that fades to light `b`: (1 − share) · a + share · b. Throws InputError unless they are maps of
/// one size and parameterisation.
REFIELD_API LightMap mixed(const LightMap& a, const LightMap& b, double share);

/// What of an environment reaches a field's light map. Energy is radiance times solid angle, all channels
/// together.
struct EnvironmentShare {
  double sphere = 1.0;  ///< of all directions: what the light map's windows cover
  double energy = 1.0;  ///< of the map's light: what comes from there; 1 for a black map
};

/// A clear sky over level ground.
struct REFIELD_API SkyOptions {
  double turbidity = 3.0;        ///< haze: 2 a clear day in the mountains, 3 clear, 6 hazy
  double latitude_degrees = 45;  ///< of the place, which decides how high the sun climbs
  int width = 1024;              ///< of the map, even

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// A map of the light from all directions, lat-long (twice as wide as high) or cube (six square faces stacked
/// vertically), with the sums that its projection needs, 24 bytes per texel. Copies share it. From several
/// threads at a time.
class REFIELD_API Environment {
 public:
  /// Throws InputError for other proportions, and what read_light_map() does; values that state other
  /// primaries than those of Rec.709 are converted.
  explicit Environment(const std::filesystem::path& file, const RunContext& run = {});
  /// A copy of a map [height × width × 3]; messages call it "map".
  explicit Environment(const ImageView& map, const RunContext& run = {});
  /// A clear sky when the share `day` (0 to 1) of an equinox day from sunrise to sunset is over. South is
  /// ahead (+Z), sunrise at the left. Radiance 1 stands for 1000 cd/m². Source: Preetham, Shirley and Smits
  /// 1999. Throws what SkyOptions::check() throws.
  explicit Environment(double day, const SkyOptions& sky, const RunContext& run = {});

  /// The light that a domain receives from the environment turned by `turn`: every texel gets the mean
  /// radiance over its solid angle, by the exact overlaps of texels on the sphere. `monitors`: placements
  /// where the domain is of monitors. Throws InputError where they are missing. `seen`, where given, becomes
  /// the part of the environment that reaches the domain.
  LightMap project(const LightDomain& domain, std::span<const MonitorPlacement> monitors = {},
                   const EulerAngles& turn = {}, const RunContext& run = {},
                   EnvironmentShare* seen = nullptr) const;

  /// For the library itself.
  const std::shared_ptr<const PreparedEnvironment>& internal() const { return map_; }

 private:
  std::shared_ptr<const PreparedEnvironment> map_;
};

/// Area lights that move around the mesh of a field, as a file describes them
/// (docs/reference/scene-files.md). Copies share them. From several threads at a time.
class REFIELD_API AreaLights {
 public:
  /// Throws InputError for a field without a mesh, and InputError and FormatError for a description or mesh
  /// that cannot be used.
  AreaLights(const Field& field, const std::filesystem::path& file, const RunContext& run = {});
  double duration() const;  ///< of the motion, seconds
  /// What the middle of the field's mesh receives at a time, in seconds: a light map of the field.
  LightMap light(double time) const;

 private:
  struct Data;
  std::shared_ptr<const Data> data_;
};

// ---- cameras

/// A pinhole camera in the axes of light directions (+X right, +Y up, +Z ahead, left-handed).
struct ViewCamera {
  std::array<float, 3> position{0.0f, 0.0f, -3.0f};
  std::array<float, 3> target{};
  std::array<float, 3> up{0.0f, 1.0f, 0.0f};
  float vertical_field_of_view_degrees = 35.0f;
  int width = 640;  ///< pixels
  int height = 480;
};

/// The camera that a field over a mesh is shown to: the scene's own, else one that frames the mesh. Its
/// picture has the given size, where that is not 0. Throws InputError for a field without a mesh.
REFIELD_API ViewCamera standard_camera(const Field& field, int width = 0, int height = 0);

/// `frames` cameras on a full circle about the target, along the horizon (around +Y), from `start` on; seen
/// from above they go to the right of the first one's sight.
REFIELD_API std::vector<ViewCamera> turntable(const ViewCamera& start, int frames);

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

// ---- pictures on disk

/// An environment that lights a scene, turned.
struct TurnedEnvironment {
  Environment environment;
  EulerAngles turn{};
};
/// What a picture is lit by: a light map of the field's light_domain(), or an environment.
using Illumination = std::variant<LightMap, TurnedEnvironment>;
/// Reads or computes one when its turn comes; called from several threads at a time.
using IlluminationFunction = std::function<Illumination()>;

/// How pictures are taken and written.
struct REFIELD_API PictureOptions {
  /// Of a field over a mesh: one for all pictures or one a picture, all of the first one's size; none: its
  /// standard_camera().
  std::vector<ViewCamera> cameras{};
  bool show_environment = false;  ///< behind the mesh, instead of transparency (files) or black (videos)
  /// Where the monitor stands that shows environments; none: the field's monitors().
  std::vector<MonitorPlacement> monitors{};
  /// Factor on the radiance of PNG and .glb files and videos; none: the 99th percentile of the brightest
  /// channel over the pixels that show light becomes white.
  std::optional<double> exposure{};
  bool is_sequence = false;         ///< files are frames of a sequence, which share an automatic exposure
  double frames_per_second = 30.0;  ///< of a video

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// How pictures were exposed, and what the field knows of their light.
struct PictureReport {
  std::vector<double> exposures;  ///< one for all, or one per picture; empty: EXR alone
  /// Share of the pixels that show light and are clipped in some channel, mean over the pictures; 0 for
  /// automatic exposures, which clip fewer than 1 %.
  double clipped = 0.0;
  /// Shares of a light map's energy, each of the picture where it is largest: from directions between the
  /// lights of the capture, and from texels that no training light lit.
  double interpolated_light = 0.0, unobserved_light = 0.0;
  /// [pictures]: what the monitor sees of each environment; empty for light maps that cover all directions
  /// and for `lights` that are light maps.
  std::vector<EnvironmentShare> seen;
};

/// Relights a field and writes a file per picture, atomically, several at a time. `lights` [files], or one
/// for all. The extension chooses the format: .exr (scene-linear, float), .png (sRGB, 8 bits) or, of a field
/// over a mesh, .glb, the mesh with its light as vertex colours. Creates folders. Throws InputError for other
/// extensions before any work, for a light that does not fit the field or makes pixels that are not finite,
/// and Interrupted between pictures.
REFIELD_API PictureReport relight_to_files(const Field& field, std::span<const IlluminationFunction> lights,
                                           std::span<const std::filesystem::path> files,
                                           const PictureOptions& options = {}, const RunContext& run = {});
/// The same as a video (.mp4, H.264) by the program ffmpeg: `lights` [frames], or one for all cameras of
/// `options`. The file appears when it is complete. Throws DeviceError where ffmpeg is missing or fails.
REFIELD_API PictureReport relight_to_video(const Field& field, std::span<const IlluminationFunction> lights,
                                           const std::filesystem::path& file,
                                           const PictureOptions& options = {}, const RunContext& run = {});

}  // namespace v0_2
}  // namespace refield
