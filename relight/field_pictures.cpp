// SPDX-License-Identifier: Apache-2.0
#include "relight/field_pictures.h"

#include <tbb/concurrent_queue.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"

namespace refield {

/// One for each picture that is being made; they share the field's transfer.
struct FieldPictures::Relighters {
  explicit Relighters(TileRelighter&& relighter) : first(std::move(relighter)) {}

  std::unique_ptr<TileRelighter> take() {
    std::unique_ptr<TileRelighter> relighter;
    return idle.try_pop(relighter) ? std::move(relighter) : std::make_unique<TileRelighter>(first);
  }

  const TileRelighter first;
  tbb::concurrent_queue<std::unique_ptr<TileRelighter>> idle;
};

FieldPictures::FieldPictures(const ReflectanceField& field, std::vector<PinholeCamera> cameras)
    : field_(&field), cameras_(std::move(cameras)) {
  if (box_sums_suffice(field.basis)) {
    std::vector<SmallBox> boxes;
    for (const Box& box : field.basis.boxes) boxes.push_back(small_box(box));
    box_projector_ =
        std::make_shared<const BoxProjector>(field.basis.domain.width, field.basis.vector_boxes, boxes);
  }
  if (!field.mesh) {
    if (!cameras_.empty()) throw InputError("the field belongs to a fixed camera; do not give cameras");
    return;
  }
  if (cameras_.empty()) cameras_.push_back(standard_camera(field));
  for (const PinholeCamera& camera : cameras_) camera.check();
  if (cameras_.size() == 1) view_ = std::make_shared<const MeshRenderer>(field, cameras_.front());
}

int FieldPictures::width() const {
  return cameras_.empty() ? field_->width : cameras_.front().width;
}

int FieldPictures::height() const {
  return cameras_.empty() ? field_->height : cameras_.front().height;
}

void FieldPictures::lay_out(RelightPrecision precision) {
  const LightDomain& domain = field_->basis.domain;
  if (domain.width > small_box_limit || domain.height > small_box_limit) return;
  relighters_ = std::make_shared<Relighters>(TileRelighter(*field_, precision));
  if (auto boxes = relighters_->first.box_projector())
    box_projector_ = std::make_shared<const BoxProjector>(std::move(*boxes));
}

Image FieldPictures::outputs(const SceneLight& light, const RunContext& run) const {
  const auto* map = std::get_if<LightMap>(&light);
  std::vector<float> coefficients;
  if (const auto* turned = std::get_if<SceneEnvironment>(&light)) {
    if (!box_projector_) throw InputError("this field needs an environment's light map");
    coefficients = box_projector_->project(*turned->environment, turned->turn, run);
  } else if (!relighters_) {
    coefficients = field_->basis.project(*map);
  }
  Image image(field_->width, field_->height, 3);
  if (!relighters_) {
    field_->apply(coefficients, image.values);
    return image;
  }
  auto relighter = relighters_->take();
  // Without other pictures' work in between.
  tbb::this_task_arena::isolate([&] {
    map ? relighter->relight_into(*map, image.values) : relighter->relight_into(coefficients, image.values);
  });
  relighters_->idle.push(std::move(relighter));
  return image;
}

Image FieldPictures::picture(Image outputs, std::size_t frame) const {
  if (cameras_.empty()) return outputs;
  if (view_) return view_->show(outputs);
  return MeshRenderer(*field_, cameras_[frame % cameras_.size()]).show(outputs);
}

Image FieldPictures::vertices(const Image& outputs) const {
  if (!field_->mesh) throw InputError("a captured field has no mesh for a .glb file; write .exr or .png");
  if (field_->mesh->outgoing_order > 1)
    throw InputError(
        "glossy vertices look different from every side, which a .glb file cannot hold; write .exr or .png");
  Image image(static_cast<int>(field_->mesh->positions.size()), 1, 3);
  for (std::size_t v = 0; v < field_->mesh->positions.size(); ++v)
    for (std::size_t c = 0; c < 3; ++c)
      image.values[3 * v + c] =
          outputs.values[3 * pixel_of_output(v) + c] * field_->mesh->colours[v][static_cast<Eigen::Index>(c)];
  return image;
}

void FieldPictures::show_background() {
  if (cameras_.empty())
    throw InputError(
        "the field's photographs fill the picture, so that no background is seen; remove --show-environment");
  shows_background_ = true;
}

Image FieldPictures::background(const SceneLight& light, std::size_t frame) const {
  if (!shows_background_) return {};
  const PinholeCamera& camera = cameras_[frame % cameras_.size()];
  const std::vector<float> covered = coverage(frame);
  const auto* turned = std::get_if<SceneEnvironment>(&light);
  const LightMap& map = turned ? turned->environment->map() : std::get<LightMap>(light);
  const Eigen::Matrix3d back =
      turned ? Eigen::Matrix3d(rotation_of(turned->turn).transpose()) : Eigen::Matrix3d::Identity();
  Image image(camera.width, camera.height, 3);
  tbb::parallel_for(0, camera.height, [&](int y) {
    for (int x = 0; x < camera.width; ++x) {
      const float left = 1.0f - covered[static_cast<std::size_t>(y) * image.width + x];
      if (!(left > 0.0f)) continue;
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (const float dy : {0.25f, 0.75f})
        for (const float dx : {0.25f, 0.75f})
          sum += radiance_towards(map, back * camera.direction(x + dx, y + dy).cast<double>());
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = 0.25f * left * sum[c];
    }
  });
  return image;
}

std::vector<float> FieldPictures::coverage(std::size_t frame) const {
  if (cameras_.empty()) return {};
  return view_ ? view_->coverage()
               : MeshRenderer(*field_->mesh, cameras_[frame % cameras_.size()]).coverage();
}

std::string unobserved_light_warning(const LightShares& shares) {
  if (shares.unobserved <= 0.01) return {};
  return std::to_string(std::lround(100.0 * shares.unobserved)) +
         " % of the light comes from texels that were black in all training light maps" +
         (shares.interpolated > 0.0 ? ", far from all light sources of the capture" : "") +
         "; the field does not contain its effect";
}

std::vector<PinholeCamera> turntable(const PinholeCamera& start, int frames) {
  std::vector<PinholeCamera> cameras(static_cast<std::size_t>(frames), start);
  for (int i = 0; i < frames; ++i) {
    const Eigen::Matrix3f turn = rotation_of(EulerAngles{.yaw = -360.0 * i / frames}).cast<float>();
    PinholeCamera& camera = cameras[static_cast<std::size_t>(i)];
    camera.position = start.target + turn * (start.position - start.target);
    camera.up = turn * start.up;
  }
  return cameras;
}

}  // namespace refield
