// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/data.h"

#include <algorithm>
#include <cmath>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "simulate/tabletop/recipe.h"

namespace refield::chart {

namespace fs = std::filesystem;

namespace {

constexpr const char* charted_kinds[] = {"natural", "bar", "square"};
constexpr float black_share = 1e-3f;  // of the brightest texel: renderers leave traces where light is off

/// The folder's exact images by frame name, where its transport was not kept.
fs::path exact_image(const CaptureSession& exact, const CaptureFrame& frame) {
  const auto match = std::ranges::find(exact.frames, frame.name, &CaptureFrame::name);
  if (match == exact.frames.end())
    throw InputError(exact.folder.string() + ": has no frame '" + frame.name +
                     "'; give the truth that this session was acquired from");
  return match->observed;
}

void require_fit(const ReflectanceField& transport, const fs::path& path, const CaptureSession& session) {
  if (transport.width != session.width || transport.height != session.height ||
      transport.basis.domain != session.light)
    throw InputError(path.string() +
                     ": its image or light map has another size than the session's; give the truth that this "
                     "session was acquired from");
}

void load_truth(ChartData& data, const fs::path& truth, std::optional<CaptureSession>& exact) {
  if (truth.empty()) {
    data.reference_note = "held-out photographs, whose noise is part of every error";
    return;
  }
  const bool is_folder = fs::is_directory(truth);
  const fs::path transport = is_folder ? truth / "transport.rfield" : truth;
  if (is_folder && !fs::exists(transport)) {
    exact = read_capture_session(truth);
    data.reference_note = "the simulation's exact images";
    return;
  }
  data.transport = read_image_field(transport, run_context());
  require_fit(*data.transport, transport, data.session);
  data.reference_note = "exact images";
}

void load_kinds(ChartData& data, const Sources& sources) {
  if (!sources.kinds) return;
  const CaptureSession& session = data.session;
  data.kinds_note = "pixel classes from " + sources.kinds->filename().string();
  if (sources.kinds->extension() == ".toml") {
    SceneDescription scene = read_recipe(*sources.kinds).scene;
    scene.camera.width = session.width;
    scene.camera.height = session.height;
    data.pixel_kinds = scene_kinds(TabletopScene(scene), run_context());
  } else {
    data.pixel_kinds = read_pixel_kinds(*sources.kinds, session.width, session.height);
  }
}

}  // namespace

std::string light_kind_of(const LightMap& light) {
  const Image& map = light.radiance;
  const float brightest = *std::ranges::max_element(map.values);
  if (brightest <= black_share) return "black";
  Box lit{map.width, map.height, 0, 0};
  std::int64_t lit_texels = 0;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      const auto [low, high] = std::minmax({map.at(x, y, 0), map.at(x, y, 1), map.at(x, y, 2)});
      if (high <= black_share * brightest) continue;
      if (low < (1.0f - black_share) * brightest) return "natural";
      ++lit_texels;
      lit = {std::min(lit.x0, x), std::min(lit.y0, y), std::max(lit.x1, x + 1), std::max(lit.y1, y + 1)};
    }
  if (lit.area() != lit_texels) return "natural";
  const bool across = lit.width() == map.width, down = lit.height() == map.height;
  return across && down ? "white" : across || down ? "bar" : "square";
}

ChartData load_chart_data(const Sources& sources) {
  ChartData data;
  data.session = sources.session;
  const CaptureSession& test_session = sources.test ? *sources.test : sources.session;
  auto test_frames = test_session.frames_of(sources.test ? FrameRole::train : FrameRole::test);
  if (test_frames.empty())
    throw InputError(
        "nothing is held out to measure errors on: give a session with test frames, or --test-light and "
        "--test-observed");
  data.session.frames = sources.session.frames_of(FrameRole::train);
  // Methods are compared by their number of patterns.
  std::erase_if(data.session.frames, [](const CaptureFrame& frame) { return frame.kind == "primary"; });
  if (data.session.frames.size() < 2)
    throw InputError("a chart needs training images; the capture has " +
                     std::to_string(data.session.frames.size()));
  check_image_sizes(data.session);
  if (data.session.mask) data.mask = read_mask(*data.session.mask, data.session.width, data.session.height);
  std::optional<CaptureSession> exact;
  load_truth(data, sources.truth, exact);
  load_kinds(data, sources);
  data.noise = NoiseCurve(data.session.frames);
  Progress progress(run_context(), "reading held-out frames", test_frames.size());
  for (const CaptureFrame& frame : test_frames) {
    run_context().throw_if_stopped();
    TestFrame test{frame.kind,
                   read_light_map(frame.illumination, data.session.light.parameterisation, run_context()),
                   {}};
    if (test.kind.empty()) test.kind = light_kind_of(test.light);
    progress.advance();
    if (std::ranges::find(charted_kinds, test.kind) == std::end(charted_kinds)) continue;
    if (data.transport)
      test.reference.radiance = data.transport->relight(test.light);
    else
      test.reference = read_photograph(exact ? exact_image(*exact, frame) : frame.observed);
    if (test.light.domain() != data.session.light || test.reference.radiance.width != data.session.width ||
        test.reference.radiance.height != data.session.height)
      throw InputError(frame.observed.string() +
                       ": it or its light map is not as large as the training "
                       "images");
    data.tests.push_back(std::move(test));
  }
  for (const char* kind : charted_kinds)
    if (std::ranges::any_of(data.tests, [&](const TestFrame& test) { return test.kind == kind; }))
      data.light_kinds.emplace_back(kind);
  if (data.tests.empty())
    throw InputError("no held-out frame is of kind natural, bar or square; name kinds in session.toml");
  return data;
}

}  // namespace refield::chart
