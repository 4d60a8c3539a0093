// SPDX-License-Identifier: Apache-2.0
#include "cli/report/report.h"

#include <cmath>

#include "cli/common/options.h"
#include "cli/report/page.h"
#include "cli/report/request.h"
#include "core/base/files.h"
#include "core/base/run_context.h"
#include "core/field/predicted_error.h"
#include "core/image/tone_map.h"
#include "estimate/job/estimate_job.h"
#include "estimate/quality/frame_check.h"
#include "estimate/rig/verdict.h"

namespace refield::report {

namespace {

int rank_of(const std::string& kind) {
  static const std::vector<std::string> first = {"natural", "bar", "square", "white"};
  if (kind == "black") return 100;
  return static_cast<int>(std::ranges::find(first, kind) - first.begin());
}

bool comes_before(const std::string& a, const std::string& b) {
  return std::pair(rank_of(a), a) < std::pair(rank_of(b), b);
}

/// Median time to relight one frame, over up to a third of a second after one run that warms caches and
/// threads.
double measure_relighting(const ReflectanceField& field, const LightMap& light) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::duration<double> budget(0.3);
  constexpr std::size_t fewest = 3, most = 50;
  field.relight(light);
  std::vector<float> seconds;
  const auto start = Clock::now();
  while (seconds.size() < fewest || (seconds.size() < most && Clock::now() - start < budget)) {
    const auto before = Clock::now();
    field.relight(light);
    seconds.push_back(std::chrono::duration<float>(Clock::now() - before).count());
  }
  return quantile(seconds, 0.5);
}

/// Errors of `field` on the held-out frames, sorted as kinds_of() sorts. `noise_scale`: held_out_errors().
std::vector<HeldOutError> sorted_errors(const ReflectanceField& field, const CaptureSession& reference,
                                        double noise_scale, const RunContext& run) {
  auto errors = held_out_errors(field, reference, nullptr, FrameRole::test, noise_scale, run);
  std::ranges::stable_sort(errors, comes_before, &HeldOutError::kind);
  return errors;
}

/// [height × width × 1]: relative RMSE of each pixel over the held-out frames of a kind.
Image held_out_map(const ReflectanceField& field, const CaptureSession& reference, const std::string& kind,
                   const RunContext& run) {
  SeriesError error;
  for (const CaptureFrame& frame : reference.frames_of(FrameRole::test)) {
    if (frame.kind != kind) continue;
    run.throw_if_stopped();
    const LightMap light = read_illumination(frame, reference.light.parameterisation, run);
    const Photograph photograph = read_observed(frame);
    error.add(field.relight(light), photograph.radiance, photograph.sigma);
  }
  return error.relative_rmse_map();
}

Json options_json(const EstimateOptions& options) {
  return {{"mode", name_of(options.mode)},
          {"kernels", options.kernels},
          {"spatial_passes", options.spatial_passes}};
}

Json field_json(const FieldEntry& entry, const FieldFigures& figures) {
  const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
  const KernelStatistics& statistics = entry.statistics;
  Json json = {{"path", entry.path.string()},
               {"label", entry.label},
               {"options", entry.options_recorded ? options_json(entry.options) : Json(nullptr)},
               {"file_bytes", entry.file_bytes},
               {"bytes_per_pixel", static_cast<double>(entry.file_bytes) / pixels},
               {"relight_ms", 1000.0 * figures.relight_seconds}};
  json["statistics"] = {{"distinct_boxes", statistics.distinct_boxes},
                        {"mean_kernels", statistics.mean_stored},
                        {"nonzero_share", statistics.nonzero_share},
                        {"share_of_99_percent", statistics.share_of_99_percent},
                        {"share_of_95_percent", statistics.share_of_95_percent}};
  json["errors"] = Json::object();
  for (const ReferenceErrors& errors : figures.errors)
    json["errors"][errors.reference] = cli::held_out_figures(errors.kinds);
  return json;
}

constexpr int max_kernel_width = 160;

Json photo_json(const Image& image, double exposure) {
  return picture_json(shrunk(image, max_picture_width), exposure);
}

/// The session's folder; the one around it where that is called "session", as captures are often kept. Of
/// pairs the folder of the photographs, or the one that holds the light maps' folder, too.
std::string session_name(const CaptureSession& session) {
  if (session.folder.empty() && !session.frames.empty()) {
    const CaptureFrame& frame = session.frames.front();
    const auto observed = fs::weakly_canonical(frame.observed).parent_path();
    const auto light = fs::weakly_canonical(frame.illumination).parent_path();
    const bool side_by_side = observed != light && observed.parent_path() == light.parent_path();
    return (side_by_side ? observed.parent_path() : observed).filename().string();
  }
  auto folder = fs::weakly_canonical(session.folder);
  if (!folder.has_filename()) folder = folder.parent_path();
  if (folder.filename() == "session" && folder.has_parent_path()) folder = folder.parent_path();
  return folder.filename().string();
}

/// How many frames of a role show each kind of light.
Json kinds_json(const CaptureSession& session, FrameRole role) {
  std::map<std::string, int> kinds;
  for (const CaptureFrame& frame : session.frames_of(role)) ++kinds[frame.kind];
  return kinds;
}

void add_session(Json& json, const CaptureSession& session) {
  json["is_folder"] = !session.folder.empty();
  json["parameterisation"] = name_of(session.light.parameterisation);
  json["train"] = kinds_json(session, FrameRole::train);
  json["test"] = kinds_json(session, FrameRole::test);
  json["ambient"] = session.ambient.has_value();
  json["mask"] = session.mask.has_value();
}

/// Adds to a field's errors, in the order of kinds, how far single images lie apart, in their place.
void add_details(Json& errors, const std::vector<HeldOutError>& kinds) {
  auto json = errors.begin();
  for (const HeldOutError& error : kinds) {
    if (!error.per_image.empty()) {
      const ErrorSpread spread = spread_of(error.per_image);
      (*json)["spread"] = {{"median", spread.median},
                           {"mean", spread.mean},
                           {"largest", spread.largest},
                           {"worst", error.per_image[spread.worst].name}};
    }
    json->erase("per_image");
    ++json;
  }
}

/// The noise of a field's median pixel.
double median_noise(const ReflectanceField& field) {
  std::vector<float> noise;
  for (std::size_t p = 0; p < field.quality.photograph_noise.size(); ++p)
    if (field.quality.predicted_error[p] > 0.0f) noise.push_back(field.quality.photograph_noise[p]);
  return noise.empty() ? 0.0 : quantile(std::move(noise), 0.5);
}

/// Error against the share of the training images, as measured and beyond; null where that is not known.
Json learning_json(const ReflectanceField& field) {
  const LearningCurve curve(field.quality.learning_curve, median_noise(field));
  if (!curve.known()) return nullptr;
  Json measured, extrapolated;
  for (const LearningPoint& point : field.quality.learning_curve)
    measured.push_back({point.share, point.error});
  for (const double share : {0.8, 1.0, 1.25, 1.5, 1.75, 2.0})
    extrapolated.push_back({share, curve.error_at(share)});
  return {{"measured", measured}, {"extrapolated", extrapolated}, {"advice", curve.advice()}};
}

/// Shares of pixels by their number of kernels, from 1.
Json kernel_histogram(const KernelStatistics& statistics) {
  Json shares = Json::array();
  for (std::size_t count = 1; count < statistics.histogram.size(); ++count)
    shares.push_back(static_cast<double>(statistics.histogram[count]) /
                     static_cast<double>(std::max<std::uint64_t>(1, statistics.pixels)));
  return shares;
}

/// The predicted error up to which histograms of `fields` reach; 0 where no field predicts any.
double predicted_high(const std::vector<FieldEntry>& fields) {
  double high = 0.0;
  for (const FieldEntry& entry : fields)
    if (!entry.field.quality.predicted_error.empty())
      high = std::max(high, quantile(entry.field.quality.predicted_error, 0.95));
  return high > 0.0 ? round_up(high) : 0.0;
}

/// Shares of pixels by predicted error, in equal steps up to `high`; the last one takes all above. Null where
/// none is predicted.
Json predicted_histogram(const ReflectanceField& field, double high) {
  constexpr int steps = 12;
  std::vector<double> shares(steps);
  double pixels = 0.0;
  for (const float error : field.quality.predicted_error)
    if (error > 0.0f && high > 0.0) {
      shares[std::min(static_cast<int>(steps * (error / high)), steps - 1)] += 1.0;
      pixels += 1.0;
    }
  if (!(pixels > 0.0)) return nullptr;
  for (double& share : shares) share /= pixels;
  return shares;
}

Image kernel_count_map(const ReflectanceField& field) {
  Image map(field.width, field.height, 1);
  for (std::size_t p = 0; p < map.pixel_count(); ++p)
    map.values[p] = static_cast<float>(field.transfer.row_start[p + 1] - field.transfer.row_start[p]);
  return map;
}

struct ErrorMap {
  std::string title;
  Image map;
};

/// Errors pixel by pixel, where known: on the training images, on the first kind of held-out light.
std::vector<ErrorMap> error_maps(const ReportInput& input, const FieldEntry& entry, const RunContext& run) {
  std::vector<ErrorMap> maps;
  const auto add = [&](const char* title, const std::vector<float>& values) {
    if (values.empty()) return;
    maps.push_back({title, Image(entry.field.width, entry.field.height, 1)});
    maps.back().map.values.assign(values.begin(), values.end());
  };
  add("relative RMSE on its training images", entry.field.quality.training_error);
  add("relative RMSE predicted for new photographs", entry.field.quality.predicted_error);
  const auto kinds = kinds_of(input.session);
  if (!kinds.empty())
    maps.push_back({"relative RMSE on held-out light" + (kinds.front().empty() ? "" : ", " + kinds.front()),
                    held_out_map(entry.field, input.reference(), kinds.front(), run)});
  return maps;
}

/// A row of maps for each field; all rows share their scales, which are returned.
Json add_maps(Json& fields, const ReportInput& input, const RunContext& run) {
  double max_kernels = 1.0, worst = 0.0;
  std::vector<std::vector<ErrorMap>> errors;
  for (const FieldEntry& entry : input.fields) {
    max_kernels = std::max(max_kernels, static_cast<double>(entry.statistics.histogram.size()) - 1.0);
    errors.push_back(error_maps(input, entry, run));
    for (const ErrorMap& error : errors.back())
      worst = std::max(worst, quantile(values_in_mask(error.map, input.mask), 0.9));
  }
  const double error_high = worst > 0.0 && std::isfinite(worst) ? round_up(worst) : 0.01;
  const auto map_json = [&](const Image& map, double high) {
    return photo_json(false_coloured(map, high, input.mask), 1.0);
  };
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    fields[f]["kernel_map"] = map_json(kernel_count_map(input.fields[f].field), max_kernels);
    fields[f]["error_maps"] = Json::array();
    for (const ErrorMap& error : errors[f])
      fields[f]["error_maps"].push_back(
          {{"title", error.title}, {"picture", map_json(error.map, error_high)}});
  }
  return {{"kernels_high", max_kernels}, {"error_high", error_high}};
}

void add_fields(Json& fields, const ReportInput& input, const std::vector<FieldFigures>& evaluated) {
  const double high = predicted_high(input.fields);
  for (std::size_t f = 0; f < input.fields.size(); ++f) {
    const ReflectanceField& field = input.fields[f].field;
    const auto& errors = evaluated[f].errors;
    Json& json = fields[f];
    json["number"] = f;
    json["entries"] = field.transfer.entries();
    json["learning"] = learning_json(field);
    json["histogram"] = kernel_histogram(input.fields[f].statistics);
    json["predicted"] = predicted_histogram(field, high);
    for (const ReferenceErrors& against : errors)
      add_details(json["errors"][against.reference], against.kinds);
    if (!errors.empty()) json["warning"] = training_warning(errors.front().kinds);
  }
}

/// One prediction beside its photograph.
Json first_impression(const ReportInput& input, const RunContext& run) {
  const auto kinds = kinds_of(input.session);
  if (kinds.empty()) return nullptr;
  const CaptureFrame frame = spread_frames(input.session, kinds.front(), 1).front();
  const LightMap light = read_illumination(frame, input.session.light.parameterisation, run);
  const Image observed = read_observed(frame).radiance;
  const double exposure = display_exposure(observed, input.mask);
  return {{"light", photo_json(light.radiance, display_exposure(light.radiance, {}))},
          {"photograph", photo_json(observed, exposure)},
          {"prediction", photo_json(input.fields.front().field.relight(light), exposure)}};
}

std::size_t pictures_of(const std::string& kind) {
  if (kind == "natural" || kind.empty()) return 3;
  if (kind == "bar") return 2;
  return kind == "black" ? 0 : 1;
}

/// One held-out light: all of its pictures at one exposure.
Json light_json(const ReportInput& input, const CaptureFrame& frame, const RunContext& run) {
  const LightMap light = read_illumination(frame, input.session.light.parameterisation, run);
  const Image observed = read_observed(frame).radiance;
  const auto same_frame = std::ranges::find(input.reference().frames, frame.name, &CaptureFrame::name);
  const Image reference = read_observed(*same_frame).radiance;
  const double light_exposure = display_exposure(light.radiance, {});
  const double exposure = display_exposure(reference, input.mask);

  std::vector<Image> predicted, errors;
  double high = 0.0;
  for (const FieldEntry& entry : input.fields) {
    predicted.push_back(entry.field.relight(light));
    errors.push_back(error_magnitude(predicted.back(), reference));
    high = std::max(high, quantile(values_in_mask(errors.back(), input.mask), 0.98) * exposure);
  }
  // The best-known round number below which 98 % of the worst field's pixels lie, as a share of the pictures'
  // white.
  high = high > 0.0 && std::isfinite(high) ? round_up(high) : 0.01;
  Json fields = Json::array();
  for (std::size_t f = 0; f < predicted.size(); ++f)
    fields.push_back({{"predicted", photo_json(predicted[f], exposure)},
                      {"error", photo_json(false_coloured(errors[f], high / exposure, input.mask), 1.0)},
                      {"relative_rmse", relative_rmse(predicted[f], reference, input.mask)}});
  return {{"kind", frame.kind},
          {"name", frame.name},
          {"light", photo_json(light.radiance, light_exposure)},
          {"light_exposure", light_exposure},
          {"photograph", photo_json(observed, exposure)},
          {"exposure", exposure},
          {"error_high", high},
          {"fields", fields}};
}

Json lights_json(const ReportInput& input, const RunContext& run) {
  std::vector<CaptureFrame> frames;
  for (const std::string& kind : kinds_of(input.session))
    std::ranges::copy(spread_frames(input.session, kind, pictures_of(kind)), std::back_inserter(frames));
  Json lights = Json::array();
  Progress progress(run, "pictures", frames.size());
  for (const CaptureFrame& frame : frames) {
    run.throw_if_stopped();
    lights.push_back(light_json(input, frame, run));
    progress.advance();
  }
  return lights;
}

Json density_json(const std::optional<Image>& density) {
  if (!density) return nullptr;
  const float highest = *std::ranges::max_element(density->values);
  return picture_json(shrunk_by_maximum(*density, max_kernel_width), highest > 0.0f ? 1.0 / highest : 1.0);
}

/// Kernels of chosen pixels, and the photograph in which they are marked.
Json kernels_json(const ReportInput& input, const KernelStudy& study) {
  Json json = {{"subdivisions", study.subdivisions},
               {"kernels", study.kernels},
               {"mode", name_of(input.fields.front().options.mode)},
               {"is_shrunk", input.session.light.width > max_kernel_width},
               {"pixels", Json::array()}};
  for (const PixelKernels& kernels : study.pixels) {
    const ChosenPixel& pixel = kernels.pixel;
    Json after = Json::array();
    for (const auto& density : kernels.after) after.push_back(density_json(density));
    json["pixels"].push_back({{"x", pixel.x},
                              {"y", pixel.y},
                              {"kind", pixel.kind},
                              {"after", after},
                              {"in_field", density_json(kernels.in_field)},
                              {"exact", density_json(kernels.exact)}});
  }
  if (study.pixels.empty()) return json;
  const auto kinds = kinds_of(input.session);
  const CaptureFrame frame =
      kinds.empty() ? input.session.frames.front() : spread_frames(input.session, kinds.front(), 1).front();
  const Image photograph = read_observed(frame).radiance;
  json["width"] = photograph.width;
  json["height"] = photograph.height;
  json["photograph"] =
      picture_json(shrunk(photograph, 2 * max_picture_width), display_exposure(photograph, input.mask));
  return json;
}

Json logs_json(const std::vector<RunLog>& found) {
  const auto or_null = [](const auto& value) { return value ? Json(*value) : Json(nullptr); };
  Json logs = Json::array();
  for (const RunLog& log : found) {
    std::string made = log.path.string();
    if (const auto end = made.rfind(".log.json"); end != std::string::npos) made.resize(end);
    logs.push_back({{"stage", log.stage},
                    {"made", made},
                    {"seconds", or_null(log.seconds)},
                    {"peak_memory_bytes", or_null(log.peak_memory_bytes)},
                    {"threads", or_null(log.threads)},
                    {"details", log.details}});
  }
  return logs;
}

std::vector<ChosenPixel> asked_pixels(const ReportRequest& request, const CaptureSession& session) {
  std::vector<ChosenPixel> pixels;
  for (const auto& [x, y] : request.pixels) {
    if (x < 0 || y < 0 || x >= session.width || y >= session.height)
      throw InputError("--pixel ", x, ",", y, ": lies outside the photographs of ", text_of(session),
                       "; give 0 to ", session.width - 1, ", 0 to ", session.height - 1);
    pixels.push_back({x, y, "asked for"});
  }
  return pixels;
}

/// The check of a capture as it lies on disk; null where photographs are too few to estimate from.
Json check_of(const CaptureSession& capture, const RunContext& run) try {
  RunContext quiet = run;
  quiet.on_note = {};  // the page says it
  EstimateJob job = open_job(capture, {}, quiet);
  const auto photographs = static_cast<int>(job.frames.size());
  return check_json(check_frames(job, {}, quiet), photographs);
} catch (const InputError&) {
  return nullptr;
}

/// The colours of false_coloured() from 0 to high, evenly spaced, as CSS.
Json false_colours_json() {
  Json colours;
  for (const auto& [red, green, blue] : false_colour_stops) {
    const auto byte = [](float value) { return std::to_string(std::lround(255.0f * value)); };
    colours.push_back("rgb(" + byte(red) + "," + byte(green) + "," + byte(blue) + ")");
  }
  return colours;
}

}  // namespace

std::vector<std::string> kinds_of(const CaptureSession& session) {
  std::vector<std::string> kinds;
  for (const CaptureFrame& frame : session.frames_of(FrameRole::test)) kinds.push_back(frame.kind);
  std::ranges::sort(kinds, comes_before);
  kinds.erase(std::unique(kinds.begin(), kinds.end()), kinds.end());
  return kinds;
}

std::vector<FieldFigures> evaluate(const ReportInput& input, const RunContext& run) {
  std::vector<FieldFigures> figures(input.fields.size());
  const auto held_out = input.session.frames_of(FrameRole::test);
  for (std::size_t f = 0; f < figures.size(); ++f) {
    run.throw_if_stopped();
    const ReflectanceField& field = input.fields[f].field;
    if (!held_out.empty()) {
      figures[f].errors.push_back({"photographs", sorted_errors(field, input.session, 1.0, run)});
      if (input.truth)
        figures[f].errors.push_back({"exact images", sorted_errors(field, *input.truth, 0.0, run)});
    }
    if (!input.session.frames.empty()) {
      const CaptureFrame& frame = held_out.empty() ? input.session.frames.front() : held_out.front();
      figures[f].relight_seconds =
          measure_relighting(field, read_illumination(frame, input.session.light.parameterisation, run));
    }
  }
  return figures;
}

std::vector<CaptureFrame> spread_frames(const CaptureSession& session, const std::string& kind,
                                        std::size_t count) {
  auto frames = session.frames_of(FrameRole::test);
  std::erase_if(frames, [&](const CaptureFrame& frame) { return frame.kind != kind; });
  count = std::min(count, frames.size());
  std::vector<CaptureFrame> chosen;
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(frames[(2 * i + 1) * frames.size() / (2 * count)]);
  return chosen;
}

Json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                  const std::vector<ChosenPixel>& pixels) {
  const CaptureSession& session = input.session;
  Json json;
  json["session"] = {{"folder", text_of(session)},
                     {"width", session.width},
                     {"height", session.height},
                     {"light_width", session.light.width},
                     {"light_height", session.light.height},
                     {"training_images", session.frames_of(FrameRole::train).size()},
                     {"held_out_images", session.frames_of(FrameRole::test).size()}};
  json["fields"] = Json::array();
  for (std::size_t f = 0; f < figures.size(); ++f)
    json["fields"].push_back(field_json(input.fields[f], figures[f]));
  json["pixels"] = Json::array();
  for (const ChosenPixel& pixel : pixels)
    json["pixels"].push_back({{"x", pixel.x}, {"y", pixel.y}, {"kind", pixel.kind}});
  return json;
}

Json check_json(const FrameReport& found, int photographs) {
  const RigModel& rig = found.rig.model;
  Json mixing = nullptr;
  if (rig.mixes_colours())
    for (const auto& channel : rig.mixing.rowwise()) mixing.push_back({channel[0], channel[1], channel[2]});
  return {{"rows", verdict_json(verdict_of(found, photographs)).at("properties")},
          {"residuals_before", found.residuals_before},
          {"residuals_corrected", rig.is_identity() ? std::vector<double>() : found.residuals},
          {"shift_px", rig.shift_px},
          {"gain", rig.gain},
          {"room", rig.room},
          {"mixing", mixing}};
}

Json page_data(const ReportInput& input, const std::vector<FieldFigures>& evaluated, const KernelStudy& study,
               const std::vector<RunLog>& logs, Json figures, Json check, const RunContext& run) {
  figures["page"] = "report";
  figures["command"] = "refield compare";
  figures["name"] = session_name(input.session);
  figures["kinds"] = kinds_of(input.session);
  if (input.truth) figures["truth_note"] = input.truth_note;
  figures["reference_name"] = input.reference_name();
  figures["false_colours"] = false_colours_json();
  figures["first"] = first_impression(input, run);
  add_session(figures["session"], input.session);
  add_fields(figures["fields"], input, evaluated);
  figures["check"] = std::move(check);
  figures["pictures"] = lights_json(input, run);
  figures["kernels"] = kernels_json(input, study);
  figures["predicted_high"] = predicted_high(input.fields);
  figures["maps"] = add_maps(figures["fields"], input, run);
  figures["logs"] = logs_json(logs);
  return figures;
}

Json write_report(const ReportRequest& request, const RunContext& run) {
  if (request.fields.empty()) throw InputError("a report needs a field; give --field FILE.rfield");
  const TemporaryFolder scratch;
  const ReportInput input =
      load_input(request.session.internal(), request.fields, request.truth, scratch.path(), run);
  std::vector<ChosenPixel> pixels = asked_pixels(request, input.session);
  if (pixels.empty()) pixels = choose_pixels(input.fields.front().field, input.mask, run);
  const auto logs = find_run_logs(input);
  const auto evaluated = evaluate(input, run);
  const auto figures = figures_json(input, evaluated, pixels);
  const auto data = page_data(input, evaluated, study_kernels(input, pixels, run), logs, figures,
                              check_of(request.session.internal(), run), run);
  write_text_atomically(request.output, page_html(data));
  return figures;
}

}  // namespace refield::report
