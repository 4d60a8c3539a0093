// SPDX-License-Identifier: Apache-2.0
#include "refield/relight.h"

#include "core/base/files.h"
#include "core/image/image_io.h"
#include "library/data.h"
#include "relight/environment/environment.h"
#include "relight/mesh/mesh_view.h"
#include "relight/relight.h"
#include "simulate/prt/area_lights.h"
#include "simulate/prt/harmonic_transfer.h"

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

ViewCamera view_of(const PinholeCamera& camera) {
  const auto array = [](const Eigen::Vector3f& v) { return std::array{v[0], v[1], v[2]}; };
  return {array(camera.position), array(camera.target),
          array(camera.up),       camera.vertical_field_of_view_degrees,
          camera.width,           camera.height};
}

}  // namespace

// ---- lights

void v0_2::require_light(const Field& field, const fs::path& file) {
  const ImageHeader header = read_image_header(file);
  const LightDomain domain = field.light_domain();
  if (header.width != domain.width || header.height != domain.height)
    throw InputError(file, ": is ", header.width, "×", header.height, " texels, but the field requires a ",
                     name_of(domain.parameterisation), " light map of ", domain.width, "×", domain.height,
                     "; resample it to that size, or give it with --env if it is an environment map");
}

struct v0_2::AreaLights::Data {
  Field field;
  prt::AreaLights lights;
};

AreaLights::AreaLights(const Field& field, const fs::path& file, const RunContext& run) {
  if (!field.has_mesh() || field.light_domain().parameterisation != Parameterisation::cube)
    throw InputError("--area-lights requires a mesh field; ", field.internal().name,
                     " is an image field: use --light or --env");
  data_ = guarded(run, [&] { return std::make_shared<const Data>(field, prt::read_area_lights(file, run)); });
}

double AreaLights::duration() const {
  return data_->lights.duration();
}

LightMap AreaLights::light(double time) const {
  const FieldOutline& outline = data_->field.internal().outline();
  return guarded({}, [&] {
    return emitter_map(data_->lights.at(time), prt::middle(*outline.mesh), outline.basis.domain.width);
  });
}

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
      throw InputError("there is room for ", picture.size(), " values of a picture, which has ",
                       image.values.size());
    std::ranges::copy(image.values, picture.begin());
  });
}

// ---- Environment

Environment::Environment(const fs::path& file, const RunContext& run)
    : map_(guarded(run, [&] {
        return std::make_shared<const PreparedEnvironment>(read_environment(file, run), run);
      })) {}

Environment::Environment(const ImageView& map, const RunContext& run) {
  LightMap environment = copied({map, require_environment_kind(map.width, map.height, "the map")});
  repair_light_map(environment, "map", run);
  map_ =
      guarded(run, [&] { return std::make_shared<const PreparedEnvironment>(std::move(environment), run); });
}

Environment::Environment(double day, const SkyOptions& sky, const RunContext& run)
    : map_(guarded(run, [&] {
        return std::make_shared<const PreparedEnvironment>(clear_sky(sun_direction(day, sky), sky), run);
      })) {}

LightMap Environment::project(const LightDomain& domain, std::span<const MonitorPlacement> monitors,
                              const EulerAngles& turn, const RunContext& run, EnvironmentShare* seen) const {
  constexpr std::int64_t max_texels = std::int64_t{1} << 27;  // cube maps with faces of 4096×4096
  if (domain.height < 1 || domain.width < 1 || std::int64_t{domain.height} * domain.width > max_texels)
    throw InputError("shape is ", domain.height, "×", domain.width,
                     "; give at least one row and one column, and at most ", max_texels, " texels");
  return guarded(run, [&] {
    EnvironmentLight light = EnvironmentProjector(domain, monitors, run).project(*map_, turn, run);
    if (seen) *seen = light.share;
    return std::move(light.light);
  });
}

// ---- cameras

ViewCamera v0_2::standard_camera(const Field& field, int width, int height) {
  const FieldOutline& outline = field.internal().outline();
  PinholeCamera camera = standard_camera(outline);
  if (width > 0 && height > 0) {
    camera.width = width;
    camera.height = height;
    if (!outline.mesh->camera) camera = framing_camera(*outline.mesh, width, height);
  }
  return view_of(camera);
}

std::vector<ViewCamera> v0_2::turntable(const ViewCamera& start, int frames) {
  std::vector<ViewCamera> cameras;
  for (const PinholeCamera& camera : turntable(camera_of(start), frames)) cameras.push_back(view_of(camera));
  return cameras;
}

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

// ---- pictures on disk

void PictureOptions::check() const {
  VideoOptions{frames_per_second, exposure}.check();
}

namespace {

/// A field's pictures and their lights, as the stage `relight` takes them.
class PictureWork {
 public:
  /// `count` pictures.
  PictureWork(const Field& field, std::span<const IlluminationFunction> lights, std::size_t count,
              const PictureOptions& options, RelightPrecision precision, const RunContext& run)
      : rows_(field.internal().rows()),
        monitors_(options.monitors.empty() ? field.monitors() : options.monitors),
        run_(run),
        seen_(count) {
    options.check();
    if (count == 0) throw InputError("there are no pictures to make; give at least one light");
    if (lights.size() != count && lights.size() != 1)
      throw InputError(lights.size(), " lights do not belong to ", count,
                       " pictures; give one for each, or one for all");
    check_placements(monitors_, field.light_domain(),
                     options.monitors.empty() ? field.internal().name : "--placement");
    std::vector<PinholeCamera> cameras;
    for (const ViewCamera& camera : options.cameras) cameras.push_back(camera_of(camera));
    pictures_.emplace(*rows_, std::move(cameras));
    if (options.show_environment) pictures_->show_background();
    if (count >= min_pictures_for_layout) pictures_->lay_out(precision);
    for (std::size_t i = 0; i < lights.size(); ++i)
      functions.emplace_back([this, light = lights[i], i] { return scene_light(light(), i); });
    if (lights.size() < count) functions.assign(count, [light = functions.front()()] { return light; });
  }

  const FieldPictures& pictures() const { return *pictures_; }

  PictureReport report(const ExposureReport& exposure) const {
    return {exposure.factors, exposure.clipped, exposure.light_shares.interpolated,
            exposure.light_shares.unobserved, sees_ ? seen_ : std::vector<EnvironmentShare>()};
  }

  std::vector<LightFunction> functions;  ///< [pictures]

 private:
  SceneLight scene_light(Illumination&& light, std::size_t i) {
    if (auto* map = std::get_if<LightMap>(&light)) return std::move(*map);
    const auto& [environment, turn] = std::get<TurnedEnvironment>(light);
    const auto& map = environment.internal();
    if (box_sums_suffice(rows_->basis) && map->has_path_sums()) return SceneEnvironment{map, turn};
    tbb::collaborative_call_once(once_, [&] { projector_.emplace(rows_->basis.domain, monitors_, run_); });
    EnvironmentLight projected = projector_->project(*map, turn, run_);
    seen_[i] = projected.share;
    if (rows_->basis.domain.parameterisation == Parameterisation::monitor) sees_ = true;
    return std::move(projected.light);
  }

  std::shared_ptr<const ReflectanceField> rows_;
  std::vector<MonitorPlacement> monitors_;
  const RunContext& run_;
  std::optional<FieldPictures> pictures_;
  tbb::collaborative_once_flag once_;
  std::optional<EnvironmentProjector> projector_;
  std::vector<EnvironmentShare> seen_;
  std::atomic<bool> sees_ = false;
};

}  // namespace

PictureReport v0_2::relight_to_files(const Field& field, std::span<const IlluminationFunction> lights,
                                     std::span<const fs::path> files, const PictureOptions& options,
                                     const RunContext& run) {
  return guarded(run, [&] {
    PictureWork work(field, lights, files.size(), options, RelightPrecision::fine, run);
    std::vector<RelightJob> jobs;
    fs::path created;
    for (std::size_t i = 0; i < files.size(); ++i) {
      if (const auto folder = fs::absolute(files[i]).parent_path(); folder != created)
        create_folders(created = folder);
      jobs.push_back({work.functions[i], files[i]});
    }
    return work.report(relight_to_files(work.pictures(), jobs, {options.exposure, options.is_sequence}, run));
  });
}

PictureReport v0_2::relight_to_video(const Field& field, std::span<const IlluminationFunction> lights,
                                     const fs::path& file, const PictureOptions& options,
                                     const RunContext& run) {
  return guarded(run, [&] {
    const std::size_t count = std::max(lights.size(), options.cameras.size());
    PictureWork work(field, lights, count, options, RelightPrecision::fast, run);
    create_folders(fs::absolute(file).parent_path());
    return work.report(relight_to_video(work.pictures(), work.functions, file,
                                        {options.frames_per_second, options.exposure}, run));
  });
}

}  // namespace refield
