// SPDX-License-Identifier: Apache-2.0
#include "relight/field_pictures.h"

#include <utility>

#include "core/errors.h"
#include "core/turn.h"

namespace refield {

FieldPictures::FieldPictures(const ReflectanceField& field, std::vector<PinholeCamera> cameras)
    : field_(&field), cameras_(std::move(cameras)) {
  if (field.mesh.empty()) {
    if (!cameras_.empty())
      throw InputError("the field is a photograph's, seen from where its camera stood; leave cameras out");
    return;
  }
  if (cameras_.empty()) cameras_.push_back(standard_camera(field));
  for (const PinholeCamera& camera : cameras_) camera.check();
  if (cameras_.size() == 1) view_ = std::make_shared<const MeshView>(field, cameras_.front());
}

int FieldPictures::width() const {
  return cameras_.empty() ? field_->width : cameras_.front().width;
}

int FieldPictures::height() const {
  return cameras_.empty() ? field_->height : cameras_.front().height;
}

Image FieldPictures::picture(const LightMap& light, std::size_t frame) const {
  Image outputs = field_->relight(light);
  if (cameras_.empty()) return outputs;
  if (view_) return view_->show(outputs);
  return MeshView(*field_, cameras_[frame % cameras_.size()]).show(outputs);
}

std::vector<PinholeCamera> turntable(const PinholeCamera& start, int frames) {
  std::vector<PinholeCamera> cameras(static_cast<std::size_t>(frames), start);
  for (int i = 0; i < frames; ++i) {
    const Eigen::Matrix3f turn = Turn{.yaw = -360.0 * i / frames}.matrix().cast<float>();
    PinholeCamera& camera = cameras[static_cast<std::size_t>(i)];
    camera.position = start.target + turn * (start.position - start.target);
    camera.up = turn * start.up;
  }
  return cameras;
}

}  // namespace refield
