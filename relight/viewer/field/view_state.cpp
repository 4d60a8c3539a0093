// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

#include "core/base/units.h"
#include "core/image/tone_map.h"

namespace refield {

ViewState::ViewState(std::shared_ptr<FieldPixels> pixels, std::unique_ptr<DetailLoader>&& loader,
                     const RunContext& run)
    : loader_(std::move(loader)),
      shown_(std::move(pixels)),
      relighter_(shown_, run),
      picture_(field()),
      kernels_(relighter_.panorama()),
      wanted_{LightSetup(field().basis.domain), std::nullopt, shown_},
      done_(wanted_),
      running_(wanted_),
      light_levels_(kernels_.levels().size()) {
  reset_light_sources();
  if (field().mesh) view_ = std::make_unique<FreeView>(field());
  expose_picture();
  refresh();
  picture_.outdate();
  is_light_old_ = true;
}

PixelGrid ViewState::grid() const {
  return view_ ? PixelGrid{{0, 0, radiance().width, radiance().height}, 1} : shown_->grid;
}

void ViewState::look_at(const std::optional<VisibleRegion>& visible) {
  if (loader_) wanted_.pixels = loader_->show(visible);
}

void ViewState::reset_light_sources() {
  setup().light_sources.clear();
  setup().ambient = 0.03;
  setup().light_sources.push_back(
      {PaintedLight::Shape::spot, 0.3, 0.35, 0.2, {1.0f, 0.72f, 0.42f}, 1.0, true});
  setup().light_sources.push_back(
      {PaintedLight::Shape::spot, 0.75, 0.6, 0.14, {0.3f, 0.55f, 1.0f}, 1.0, true});
}

void ViewState::set_light_exposure(double exposure) {
  if (exposure == light_exposure_) return;
  light_exposure_ = exposure;
  is_light_old_ = true;
}

void ViewState::expose_picture() {
  wants_picture_exposure_ = true;
  expose_if_current();
}

void ViewState::expose_light() {
  wants_light_exposure_ = true;
  expose_if_current();
}

void ViewState::expose_if_current() {
  if (!is_current()) return;
  if (std::exchange(wants_picture_exposure_, false)) {
    look(false);
    const double exposure = exposure_to_white(radiance());
    if (done_.probe)
      probe_exposure_ = exposure;
    else
      set_tone({exposure, tone().curve});
    picture_.outdate();
  }
  if (std::exchange(wants_light_exposure_, false)) set_light_exposure(exposure_to_white(shown_light()));
}

void ViewState::probe(std::optional<Box> part) {
  if (part && !part->inside(setup().domain.width, setup().domain.height)) part.reset();
  if (part == probed()) return;
  const bool begins = part && !probed();
  wanted_.probe = part;
  if (begins) expose_picture();
}

/// Relights until the image is current or patience is at its end; whether there is a new image.
bool ViewState::await_relit(std::optional<std::chrono::milliseconds> patience, Changed& done) {
  const auto start = std::chrono::steady_clock::now();
  bool relit = false;
  while (!is_current()) {
    if (!job_) {
      running_ = wanted_;
      job_ = std::make_unique<BackgroundJob<FrameTime>>(
          [this, light = running_] { return relighter_.relight(light); });
    }
    const std::chrono::duration<double, std::milli> waited(1e3 * seconds_since(start));
    if (!patience)
      job_->wait();
    else if (!job_->wait_for(std::chrono::duration_cast<std::chrono::microseconds>(*patience - waited)))
      break;
    take_result(done);
    relit = true;
  }
  done.time.wait_ms = 1e3 * seconds_since(start);
  return relit;
}

/// Of a job that has ended.
void ViewState::take_result(Changed& done) {
  const auto job = std::exchange(job_, nullptr);
  done_ = running_;  // also where it failed: it would fail again
  const FrameTime times = job->take();
  if (shown_ != running_.pixels) {
    shown_ = running_.pixels;
    picture_.replace(field());
  }
  if (relighter_.show(relit_)) {
    is_light_old_ = true;
    if (field().basis.domain.parameterisation != Parameterisation::cube)
      light_shares_ = field().light_shares(relit_.light);
  }
  ++relit_count_;
  done.time.light_ms += times.light_ms;
  done.time.relight_ms += times.relight_ms;
}

/// Makes the camera's picture anew where the light or the camera is another. Whether there is a new picture.
bool ViewState::look(bool relit) {
  if (!view_) return relit;
  const bool moved = view_->update();
  if (!moved && !relit) return false;
  seen_ = view_->seen().show(relit_.outputs);
  if (moved) kernels_.follow(view_->camera(), *field().mesh);
  return true;
}

ViewState::Changed ViewState::refresh(std::optional<std::chrono::milliseconds> patience) {
  Changed done;
  const bool relit = await_relit(patience, done);
  auto start = std::chrono::steady_clock::now();
  if (look(relit)) {
    if (view_) done.time.view_ms = 1e3 * seconds_since(start);
    picture_.set_relit();
  }
  expose_if_current();
  start = std::chrono::steady_clock::now();
  const bool is_cube = field().basis.domain.parameterisation == Parameterisation::cube;
  done.picture = picture_.draw(radiance(), tone_in_use().exposure, is_cube ? nullptr : &relit_.light);
  done.light = draw_light();
  if (done.picture || done.light) done.time.tone_ms = 1e3 * seconds_since(start);
  done.kernels = kernels_.draw(*shown_);
  if (loader_ && patience && !done.picture) loader_->wait_at_rest();
  return done;
}

bool ViewState::draw_light() {
  if (!std::exchange(is_light_old_, false)) return false;
  tone_map_rgba(shown_light(), light_tone_.table({light_exposure_, ToneOperator::clip}), light_levels_);
  return true;
}

}  // namespace refield
