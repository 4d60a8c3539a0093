// SPDX-License-Identifier: Apache-2.0
#include "refield/relight.h"

#include <algorithm>
#include <string>

#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "library/data.h"
#include "relight/environment/environment.h"
#include "relight/mesh/mesh_view.h"

namespace refield {

namespace {

PinholeCamera camera_of(const ViewCamera& camera) {
  const auto vector = [](const std::array<float, 3>& v) { return Eigen::Vector3f(v[0], v[1], v[2]); };
  return {vector(camera.position),
          vector(camera.target),
          vector(camera.up),
          camera.vertical_field_of_view_degrees,
          camera.width,
          camera.height};
}

}  // namespace

// ---- Relighter

struct v0_2::Relighter::Data {
  TileRelighter relighter;
  int width, height;
};

Relighter::Relighter(const Field& field, RelightPrecision precision) {
  if (field.has_mesh()) throw InputError("relighter() is for images; Field.relight() shows fields of meshes");
  data_ = guarded({}, [&] {
    return std::make_unique<Data>(field.internal().relighter(precision), field.width(), field.height());
  });
}
Relighter::Relighter(Relighter&&) noexcept = default;
Relighter::~Relighter() = default;

int Relighter::width() const {
  return data_->width;
}
int Relighter::height() const {
  return data_->height;
}
LightDomain Relighter::light_domain() const {
  return data_->relighter.domain();
}

Image Relighter::relight(const LightMapView& light) {
  Image picture(width(), height(), 3);
  relight(light, picture.values);
  return picture;
}

void Relighter::relight(const LightMapView& light, std::span<float> picture) {
  guarded({}, [&] { data_->relighter.relight_into(light, picture); });
}

void Relighter::update(const LightMapView& light, const Box& changed, std::span<float> picture) {
  guarded({}, [&] {
    const Image& image = data_->relighter.update(copied(light), changed);
    if (picture.size() != image.values.size())
      throw InputError("there is room for " + std::to_string(picture.size()) +
                       " values of a picture, which has " + std::to_string(image.values.size()));
    std::ranges::copy(image.values, picture.begin());
  });
}

// ---- Environment

Environment::Environment(const std::filesystem::path& file, const RunContext& run)
    : map_(std::make_shared<const LightMap>(read_environment(file, run))) {}

Environment::Environment(const ImageView& map, const RunContext& run) {
  LightMap environment = copied({map, require_environment_kind(map.width, map.height, "the map")});
  repair_light_map(environment, "map", run);
  map_ = std::make_shared<const LightMap>(std::move(environment));
}

LightMap Environment::project(const LightDomain& domain, std::span<const MonitorPlacement> monitors,
                              const EulerAngles& turn, const RunContext& run) const {
  constexpr std::int64_t max_texels = std::int64_t{1} << 27;  // cube maps with faces of 4096×4096
  if (domain.height < 1 || domain.width < 1 || std::int64_t{domain.height} * domain.width > max_texels)
    throw InputError("shape is " + std::to_string(domain.height) + "×" + std::to_string(domain.width) +
                     "; give at least one row and one column, and at most " + std::to_string(max_texels) +
                     " texels");
  return guarded(run,
                 [&] { return EnvironmentProjector(domain, monitors, run).project(*map_, turn, run).light; });
}

// ---- MeshView

struct v0_2::MeshView::Data {
  Field field;
  MeshRenderer view;
};

MeshView::MeshView(const Field& field, const ViewCamera& camera)
    : data_(guarded({}, [&] {
        return std::make_unique<const Data>(field,
                                            MeshRenderer(field.internal().outline(), camera_of(camera)));
      })) {}
MeshView::MeshView(MeshView&&) noexcept = default;
MeshView::~MeshView() = default;

Image MeshView::relight(const LightMapView& light) const {
  return guarded({}, [&] {
    const LightMap map = copied(light);
    require_finite(map.radiance, "light", true, "replace it");
    return data_->view.show(data_->field.internal().rows()->relight(map));
  });
}

}  // namespace refield
