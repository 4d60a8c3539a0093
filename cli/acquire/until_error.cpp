// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/until_error.h"

#include <algorithm>
#include <charconv>
#include <cstdio>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "estimate/quality/light_order.h"

namespace refield::cli {

void order_lights(std::vector<CaptureLight>& lights, const std::string& order, std::uint64_t seed) {
  if (order == "given") return;
  if (order != "random" && order != "useful")
    throw InputError("--order " + order + ": give useful, given or random");
  const auto others = std::stable_partition(
      lights.begin(), lights.end(), [](const CaptureLight& light) { return light.role == FrameRole::train; });
  const std::vector<CaptureLight> trained(lights.begin(), others);
  std::vector<int> places;
  if (order == "random") {
    places = random_order(static_cast<int>(trained.size()), seed);
  } else {
    std::vector<LightMap> maps;
    Progress progress(run_context(), "ordering lights", trained.size());
    for (const CaptureLight& light : trained) {
      run_context().throw_if_stopped();
      maps.push_back(read_light_map(light.wanted, Parameterisation::monitor, run_context()));
      progress.advance();
    }
    places = max_useful_order(maps);
  }
  for (std::size_t i = 0; i < places.size(); ++i) lights[i] = trained[places[i]];
}

double error_from_text(const std::string& text) {
  double value = 0.0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string unit(end, text.data() + text.size());
  if (unit == "%") value /= 100.0;
  if (problem != std::errc() || (!unit.empty() && unit != "%") || !(value > 0.0 && value < 1.0))
    throw InputError("--until-error " + text +
                     ": give a relative error between 0 and 100 %, such as 2% or 0.02");
  return value;
}

UntilError::UntilError(double error, int min_images, int check_every)
    : error_(error), min_images_(min_images), check_every_(check_every), follower_(EstimateOptions()) {
  if (min_images < 10)
    throw InputError("--min-images is " + std::to_string(min_images) +
                     "; give 10 or more, since the prediction needs that many images");
  if (check_every < 1)
    throw InputError("--check-every is " + std::to_string(check_every) + "; give 1 or more");
}

void UntilError::attach(CaptureRequest& request) {
  std::vector<LightMap> natural;
  constexpr std::size_t max_lights = 12;
  for (const CaptureLight& light : request.lights) {
    if (light.role != FrameRole::test || natural.size() == max_lights) continue;
    LightMap map = read_light_map(light.wanted, Parameterisation::monitor, run_context());
    if (kind_of_light(map.radiance) == "natural") natural.push_back(std::move(map));
  }
  follower_.expect(std::move(natural));
  request.is_enough = [this](const CaptureFrame& frame) { return is_enough(frame); };
  if (error_ == 0.0) return;
  char rule[128];
  std::snprintf(rule, sizeof rule, "predicted error %.6g, from %d images, every %d", error_, min_images_,
                check_every_);
  request.stop_rule = rule;
}

bool UntilError::is_enough(const CaptureFrame& frame) {
  follower_.add(frame, Parameterisation::monitor, run_context());
  const int images = follower_.images();
  if (images < min_images_ || (images - min_images_) % check_every_ != 0) return false;
  last_ = follower_.predict(run_context());
  char text[160];
  if (!last_.predicted) {
    std::snprintf(
        text, sizeof text,
        "after %d photographs: the error cannot be predicted from %d lights that differ; it takes %d", images,
        last_.lights, min_lights_for_errors);
    run_context().note(text);
    return false;
  }
  const double predicted = *last_.predicted;
  if (error_ == 0.0) {
    std::snprintf(text, sizeof text, "after %d photographs: predicted error %.2f %%", images,
                  100.0 * predicted);
    run_context().note(text);
    return false;
  }
  reached_ = predicted <= error_;
  const int needed = reached_ ? 0 : follower_.images_for(error_);
  std::snprintf(text, sizeof text, "after %d photographs: predicted error %.2f %% (target: %.2f %%)%s",
                images, 100.0 * predicted, 100.0 * error_,
                needed > 0 ? (", about " + std::to_string(needed) + " photographs are needed").c_str() : "");
  run_context().note(text);
  return reached_;
}

}  // namespace refield::cli
