// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/mesh.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// Where a line of sight meets a mesh first.
struct SeenPoint {
  static constexpr std::uint32_t nothing = 0xffffffffu;

  std::uint32_t triangle = nothing;
  bool front = true;             ///< whether its front is seen
  std::array<float, 3> share{};  ///< of the triangle's vertices in the point; add up to 1
};

/// Where in a pixel lines of sight go through, from its top left corner: one in the middle, or four on a
/// turned grid, so that edges near the horizontal and the vertical get four steps, too.
std::span<const Eigen::Vector2f> sight_points(int samples);

/// What a camera sees of a mesh, [pixels × samples], the samples of a pixel together; `samples` is 1 or 4.
/// Triangles are rasterised in homogeneous coordinates (Olano and Greer 1997), so that none needs clipping,
/// and edges belong to both their triangles, so that no gaps open between them. Its work runs on all cores;
/// an image of 1024×768 and 150 000 triangles take some 20 ms on two.
std::vector<SeenPoint> rasterise(const Mesh& mesh, const PinholeCamera& camera, int samples);

/// A camera in front of a mesh (it looks along +Z) and a little above, from where all of it is to be seen.
PinholeCamera framing_camera(const Mesh& mesh, int width, int height);

/// The camera that a field brings along, else framing_camera() with its standard size.
/// Throws InputError for a field without a mesh.
PinholeCamera standard_camera(const FieldOutline& field);

/// Pictures of a field over a mesh from one camera: what the camera sees is found once, and then each light's
/// outputs become a picture by a sum over the vertices that each pixel shows.
class MeshRenderer {
 public:
  /// `samples`: 1 or 4 lines of sight a pixel. The field's mesh must outlive this. Throws InputError for a
  /// field without a mesh and what PinholeCamera::check() throws.
  MeshRenderer(const FieldOutline& field, const PinholeCamera& camera, int samples = 4);

  /// View of a mesh whose vertices' radiance is passed to show(); the mesh must outlive this.
  MeshRenderer(const Mesh& mesh, const PinholeCamera& camera, int samples = 4);

  const PinholeCamera& camera() const { return camera_; }

  /// The picture, [camera height × width × 3]: black where no mesh is, and where its back is seen. `outputs`
  /// is the field relit, as by TileRelighter::relight(); vertices multiply it by their colours. Where
  /// vertices have harmonics as outputs, they are summed for the direction of the line of sight mirrored by
  /// the normal (Fujita and Kanai 2004, section 2.3). Costs about as much as copying some pictures: 10 ms at
  /// 1024×768 on two cores.
  Image show(const Image& outputs) const;
  /// The picture of radiance [vertices] towards the camera, colours included.
  Image show(std::span<const Eigen::Array3f> radiance) const;

  /// [pixels]: the share of each pixel's lines of sight that meet the mesh, from whichever side.
  std::vector<float> coverage() const;

  /// The vertex that has the largest share in a pixel; none where no mesh is.
  std::optional<std::uint32_t> vertex_at(int x, int y) const;

 private:
  struct Share {
    std::uint32_t vertex;
    float share;
  };

  void gather_shares(const Mesh& mesh, int samples);
  void evaluate_mirrored_sight(const Mesh& mesh, int order);
  Eigen::Array3f radiance(const Image& outputs, std::uint32_t vertex) const;

  PinholeCamera camera_;
  const Mesh* mesh_;
  std::vector<std::uint32_t> first_;  // [pixels + 1], in shares_
  std::vector<Share> shares_;
  std::vector<std::uint8_t> hits_;  // [pixels], lines of sight that meet the mesh
  int samples_ = 0;
  std::size_t outputs_a_vertex_ = 1;
  std::vector<float> harmonics_;  // [vertices × outputs]; empty where vertices shine alike in all directions
};

/// Cube map of `resolution` texels per face of what shines, as seen from `middle`: the colours of `emitters`
/// are radiance, both sides shine, the nearest is seen (Fujita and Kanai 2004, section 3.2). Each texel is
/// the mean over its solid angle of many lines of sight, so that lights keep their power as they move across
/// texels. No correction for the solid angle of texels is done here: fields with Measure::solid_angle weigh
/// them, exactly, where the paper's weight ∆A ∕ √(x² + y² + 1) is off by up to a factor of three and does not
/// add up to the sphere.
LightMap emitter_map(const Mesh& emitters, const Eigen::Vector3f& middle, int resolution);

}  // namespace refield
