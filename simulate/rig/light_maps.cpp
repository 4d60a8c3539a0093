// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/light_maps.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>

#include "core/base/rng.h"
#include "core/base/run_context.h"
#include "core/image/metrics.h"

namespace refield {

namespace {

constexpr int views_of_a_panorama = 6;
// A view of 70° then has about one panorama pixel a texel.
constexpr int panorama_widths_of_a_map = 8;
constexpr int largest_panorama = 3072;
constexpr int first_coloured_view = 9999 * views_of_a_panorama;  // of panoramas that show no other light

std::string numbered(const char* role, int number) {
  char text[32];
  std::snprintf(text, sizeof text, "%s_%03d", role, number);
  return text;
}

void fill(Image& image, int x0, int y0, int x1, int y1) {
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = 1.0f;
}

// Scales a view so that its bright parts reach about 1, and clips, as a camera with automatic exposure does.
void expose(Image& view, double stops) {
  std::vector<float> brightness(view.pixel_count());
  for (std::size_t p = 0; p < brightness.size(); ++p)
    brightness[p] = std::max({view.values[3 * p], view.values[3 * p + 1], view.values[3 * p + 2]});
  const double bright = std::max(1e-3, quantile(std::move(brightness), 0.95));
  const auto scale = static_cast<float>(std::exp2(stops) / bright);
  for (float& v : view.values) v = std::clamp(v * scale, 0.0f, 1.0f);
}

int view_of(const LightSpec& spec) {
  return spec.kind == "coloured" ? first_coloured_view + spec.number : spec.number;
}

Image natural_light(const Image& panorama, std::uint64_t seed, std::uint64_t stream, int view_number,
                    int width, int height) {
  Rng rng(seed, 0x766965u, stream, view_number);
  PanoramaView view;
  view.turn.yaw = 360.0 * (view_number % views_of_a_panorama + rng.uniform()) / views_of_a_panorama;
  view.turn.pitch = rng.uniform(-35.0, 35.0);
  view.turn.roll = rng.uniform(-25.0, 25.0);
  view.horizontal_fov_degrees = rng.uniform(50.0, 90.0);
  Image image = view_of_panorama(panorama, view, width, height);
  expose(image, rng.uniform(-0.4, 0.6));
  return image;
}

/// Leaves one or two channels of a view.
void colour(Image& view, int number) {
  constexpr int kept[] = {1, 2, 4, 6, 5, 3};  // bits of red, green, blue
  for (std::size_t i = 0; i < view.values.size(); ++i)
    if ((kept[number % 6] >> i % 3 & 1) == 0) view.values[i] = 0.0f;
}

LightMap made_light(const LightSpec& spec, int count, const LightDomain& domain) {
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  Image& image = light.radiance;
  if (spec.kind == "white") fill(image, 0, 0, domain.width, domain.height);
  if (spec.kind == "bar") {
    const int width = std::max(1, domain.width / 8);
    const double step = count > 1 ? static_cast<double>(domain.width - width) / (count - 1) : 0.0;
    const int left = static_cast<int>(std::lround(spec.number * step));
    fill(image, left, 0, left + width, domain.height);
  }
  if (spec.kind == "square") {
    const int side = std::max(1, domain.width / 16);
    // The R2 sequence (Roberts 2018) spreads any number of places evenly.
    const double u = std::fmod(0.5 + 0.7548776662466927 * (spec.number + 1), 1.0);
    const double v = std::fmod(0.5 + 0.5698402909980532 * (spec.number + 1), 1.0);
    const int x = static_cast<int>(u * (domain.width - side + 1)),
              y = static_cast<int>(v * (domain.height - side + 1));
    fill(image, x, y, x + side, y + side);
  }
  return light;
}

}  // namespace

std::vector<LightSpec> list_lights(const LightPlan& plan) {
  std::vector<LightSpec> list;
  for (int i = 0; i < plan.train; ++i) list.push_back({numbered("train", i), FrameRole::train, plan.kind, i});
  int number = 0;
  const auto add = [&](const char* kind, int count) {
    for (int i = 0; i < count; ++i) list.push_back({numbered("test", number++), FrameRole::test, kind, i});
  };
  add("natural", plan.natural);
  add("bar", plan.bars);
  add("square", plan.squares);
  add("coloured", plan.coloured);
  add("white", plan.white);
  add("black", plan.black);
  return list;
}

void make_lights(const std::vector<LightSpec>& list, const LightDomain& domain, std::uint64_t seed,
                 const std::function<void(std::size_t, LightMap&&)>& sink, const RunContext& run) {
  const ThreadLimit limit(run);
  // Views grouped by panorama: (stream, places). Test panoramas are streams of their own.
  std::map<std::uint64_t, std::vector<std::size_t>> places_of;
  std::map<std::string, int> count_of;
  for (std::size_t place = 0; place < list.size(); ++place) {
    const LightSpec& spec = list[place];
    ++count_of[spec.kind];
    if (spec.kind != "natural" && spec.kind != "coloured") continue;
    const std::uint64_t test = spec.role == FrameRole::train ? 0 : 1;
    places_of[2 * static_cast<std::uint64_t>(view_of(spec) / views_of_a_panorama) + test].push_back(place);
  }
  Progress progress(run, "light maps", list.size());
  const std::vector<std::pair<std::uint64_t, std::vector<std::size_t>>> groups(places_of.begin(),
                                                                               places_of.end());
  const int panorama_width = std::min(largest_panorama, panorama_widths_of_a_map * domain.width) / 2 * 2;
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    run.throw_if_stopped();
    const auto& [stream, places] = groups[g];
    const Image panorama = make_panorama(seed, stream, panorama_width);
    for (const std::size_t place : places) {
      run.throw_if_stopped();
      const LightSpec& spec = list[place];
      Image view = natural_light(panorama, seed, stream, view_of(spec), domain.width, domain.height);
      if (spec.kind == "coloured") colour(view, spec.number);
      sink(place, {std::move(view), domain.parameterisation});
      progress.advance();
    }
  });
  std::optional<LeafPatterns> leaves;
  for (std::size_t place = 0; place < list.size(); ++place) {
    run.throw_if_stopped();
    const LightSpec& spec = list[place];
    if (spec.kind == "natural" || spec.kind == "coloured") continue;
    if (spec.kind == "designed") {
      if (!leaves) leaves.emplace(domain, seed);
      sink(place, leaves->next());
    } else {
      sink(place, made_light(spec, count_of[spec.kind], domain));
    }
    progress.advance();
  }
}

}  // namespace refield
