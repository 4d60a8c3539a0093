// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/estimate_job.h"

#include <fstream>

#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/light/cube_map.h"
#include "estimate/job/estimate_band.h"

namespace refield {

namespace {

/// Whether hat h has a weight in any channel; one that is no number counts, and is refused later.
bool holds_hat(const PixelKernels& pixel, std::size_t h) {
  const float* weight = pixel.smooth.data() + 3 * h;
  return !(weight[0] <= 0.0f && weight[1] <= 0.0f && weight[2] <= 0.0f);
}

}  // namespace

FieldAssembler::FieldAssembler(const EstimateJob& job, const EstimateOptions& options)
    : with_evidence_(options.predict_errors),
      is_whole_(!options.rows),
      images_(static_cast<double>(job.frames.size())) {
  field_.width = job.session.width;
  field_.height = job.rows.count();
  field_.basis.domain = job.session.light;
  field_.monitors = job.session.monitors;
  field_.colour_space = job.session.colour_space();
  if (job.rig.mixes_colours()) field_.output_from_primaries = job.rig.mixing.cast<float>();
  field_.basis.hats = hats_of(options, job.session.light, static_cast<int>(job.frames.size()));
  field_.provenance = provenance_of(job, options);
  // Growing vectors would hold the statistics of a large picture twice.
  const std::size_t pixels = static_cast<std::size_t>(field_.width) * field_.height;
  field_.transfer.row_start.reserve(pixels + 1);
  field_.quality.training_error.reserve(pixels);
  if (!with_evidence_) return;
  field_.quality.training_signal.reserve(pixels);
  field_.quality.light_class.reserve(pixels);
  error_evidence_.reserve(pixels);
}

void FieldAssembler::note(std::span<const PixelKernels> kernels) {
  const auto is_nonzero = [](float weight) { return weight != 0.0f; };
  std::vector<std::uint64_t>& row_start = field_.transfer.row_start;
  for (const PixelKernels& pixel : kernels) {
    std::uint64_t entries = pixel.boxes.size();
    for (std::size_t h = 0; 3 * h < pixel.smooth.size(); ++h) entries += holds_hat(pixel, h);
    row_start.push_back(row_start.back() + entries);
    for (const Box& box : pixel.boxes)
      if (numbers_.try_emplace(box, static_cast<std::uint32_t>(field_.basis.size())).second)
        field_.basis.boxes.push_back(box);
    has_weights_ = has_weights_ || std::ranges::any_of(pixel.weights, is_nonzero) ||
                   std::ranges::any_of(pixel.smooth, [](float weight) { return !(weight <= 0.0f); });
    field_.quality.training_error.push_back(
        pixel.squared_samples > 0.0
            ? static_cast<float>(std::sqrt(pixel.squared_residual / pixel.squared_samples))
            : 0.0f);
    if (!with_evidence_) continue;
    field_.quality.training_signal.push_back(static_cast<float>(std::sqrt(pixel.squared_samples / images_)));
    field_.quality.light_class.push_back(pixel.evidence.light_class);
    error_evidence_.push_back(pixel.evidence);
  }
}

SparseTransfer FieldAssembler::transfer_of(std::span<const PixelKernels> kernels) const {
  SparseTransfer transfer;
  std::vector<std::uint32_t> columns;
  std::vector<float> weights;
  for (const PixelKernels& pixel : kernels) {
    columns.clear();
    weights.clear();
    for (std::size_t h = 0; 3 * h < pixel.smooth.size(); ++h) {
      if (!holds_hat(pixel, h)) continue;
      columns.push_back(static_cast<std::uint32_t>(h));
      weights.insert(weights.end(), pixel.smooth.data() + 3 * h, pixel.smooth.data() + 3 * h + 3);
    }
    weights.insert(weights.end(), pixel.weights.begin(), pixel.weights.end());
    for (const Box& box : pixel.boxes) columns.push_back(numbers_.at(box));
    transfer.append_row(columns, weights);
  }
  return transfer;
}

void FieldAssembler::append(std::span<const PixelKernels> kernels) {
  note(kernels);
  const SparseTransfer rows = transfer_of(kernels);
  SparseTransfer& all = field_.transfer;
  all.column.insert(all.column.end(), rows.column.begin(), rows.column.end());
  all.weight.insert(all.weight.end(), rows.weight.begin(), rows.weight.end());
}

ReflectanceField FieldAssembler::take(std::vector<Box> observed_light, LightErrorModel light_error) {
  if (light_error.classes() < 2) field_.quality.light_class.clear();
  field_.quality.light_error = std::move(light_error);
  field_.observed_light = std::move(observed_light);
  if (is_whole_) {
    predict_errors(field_, error_evidence_);
    field_.fit_interpolation();
  }
  return std::move(field_);
}

namespace {

/// Everything but the input files that the result depends on.
Json options_of(const EstimateOptions& options) {
  Json description = {{"program", "refield"},
                      {"version", REFIELD_VERSION},
                      {"mode", name_of(options.mode)},
                      {"kernels", options.kernels},
                      {"spatial_passes", options.spatial_passes},
                      {"predict_errors", options.predict_errors}};
  if (std::isfinite(options.clip_level)) description["clip_level"] = options.clip_level;
  return description;
}

std::vector<fs::path> inputs_of(const EstimateJob& job) {
  std::vector<fs::path> paths;
  if (job.refinement) paths.push_back(job.refinement->path());
  if (job.session.mask) paths.push_back(*job.session.mask);
  for (const CaptureFrame& frame : job.frames) {
    paths.push_back(frame.illumination);
    paths.push_back(frame.observed);
  }
  if (job.drift.significant)
    for (const CaptureFrame& frame : job.references) paths.push_back(frame.observed);
  return paths;
}

void add_bytes(std::uint64_t& hash, std::string_view bytes) {  // FNV-1a, 64 bits
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3ull;
}

/// Name, size and a sample of the content: the first 4 KiB, which in an EXR file hold the header and where
/// each compressed block begins, hence how well it compressed, and pieces from there to the end. Every shard
/// reads this of every file; all of the content would be all that a cluster's file system has to deliver.
void add_file(std::uint64_t& hash, const fs::path& path) {
  constexpr std::uint64_t head_bytes = 4096, piece_bytes = 256, pieces = 8;
  const std::uint64_t size = fs::file_size(path);
  add_bytes(hash, path.filename().string() + ' ' + std::to_string(size) + '\n');
  std::ifstream file;
  file.rdbuf()->pubsetbuf(nullptr, 0);  // reads what is asked for
  file.open(path, std::ios::binary);
  std::string bytes;
  const auto add = [&](std::uint64_t first, std::uint64_t count) {
    bytes.resize(count);
    if (!file.seekg(static_cast<std::streamoff>(first)) ||
        !file.read(bytes.data(), static_cast<std::streamsize>(count)))
      throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot read the file");
    add_bytes(hash, bytes);
  };
  add(0, std::min(size, head_bytes));
  if (size <= head_bytes) return;
  const std::uint64_t piece = std::min(piece_bytes, size - head_bytes);
  for (std::uint64_t i = 1; i <= pieces; ++i)
    add(head_bytes + (size - head_bytes - piece) * i / pieces, piece);
}

}  // namespace

std::string name_of(const CaptureSession& session) {
  if (!session.folder.empty() || session.frames.empty()) return session.folder.string();
  if (session.frames.front().views) return "the capture in memory";
  return session.frames.front().observed.parent_path().string();
}

std::map<std::string, JournalFile> journal_files(const CaptureSession& session) {
  std::map<std::string, JournalFile> files;
  if (session.folder.empty()) return files;
  for (const JournalEntry& entry : read_journal(session.folder / "journal"))
    for (const JournalFile& file : entry.files) files[file.path] = file;
  return files;
}

void require_enough_frames(const EstimateJob& job, const EstimateOptions& options) {
  const int images = static_cast<int>(job.frames.size());
  if (images < 2)
    throw InputError(name_of(job.session), ": holds ",
                     images == 0 ? "no training image" : "one training image only",
                     "; a reflectance field needs many lights, about 100 for 25 kernels per pixel");
  if (options.kernels > images)
    throw InputError(name_of(job.session), ": ", images, " training images cannot determine ",
                     options.kernels, " kernels per pixel; add images or give --max-kernels ", images,
                     " or less");
}

void require_any_inside(const Mask& mask, const std::string& name) {
  if (std::ranges::none_of(mask, [](unsigned char inside) { return inside != 0; }))
    throw InputError(name,
                     ": the mask is dark everywhere, so no pixel would be estimated; paint the scene "
                     "brighter than one half, or leave the mask out");
}

EstimateJob open_job(const CaptureSession& session, const EstimateOptions& options, const RunContext& run) {
  options.check();
  EstimateJob job;
  job.session = session;
  if (!options.keep_drift) job.drift = remove_drift(job.session, run);
  job.references = job.session.frames_of(FrameRole::reference);
  job.frames = job.session.frames_of(FrameRole::train);
  for (const CaptureFrame& frame : job.session.frames_of(FrameRole::test)) job.held_out.push_back(frame.name);
  require_enough_frames(job, options);
  job.session.frames = job.frames;
  check_image_sizes(job.session);
  const LightDomain& light = job.session.light;
  if (light.parameterisation == Parameterisation::cube && light != cube_domain(light.width))
    throw InputError(job.frames.front().illumination, ": is ", light.width, "×", light.height,
                     ", which is not a cube map (six square faces stacked vertically, R×6R); give such maps "
                     "or the right --parameterisation");
  check_placements(job.session.monitors, job.session.light, "the capture");
  if (job.session.colour && std::isfinite(options.clip_level))
    throw InputError(name_of(job.session),
                     ": has a colour matrix, after which no level tells where the camera clipped; leave out "
                     "--clip, or remove [camera.colour] from ",
                     session_manifest_name);
  job.rows = options.rows.value_or(RowRange{0, job.session.height});
  if (job.rows.first < 0 || job.rows.first >= job.rows.last || job.rows.last > job.session.height)
    throw InputError("--rows ", job.rows.first, ":", job.rows.last, " are not rows of an image of ",
                     job.session.height, "; rows count from 0, and the last one named is not included");
  if (session.mask) {
    job.mask = read_mask(*session.mask, job.session.width, job.session.height);
    require_any_inside(job.mask, session.mask->string());
  }
  if (!options.refine.empty())
    job.refinement = std::make_shared<Refinement>(options.refine, job.session, job.frames, run);
  return job;
}

std::string job_key(const EstimateJob& job, const EstimateOptions& options) {
  Json key = options_of(options);
  std::uint64_t hash = 0xcbf29ce484222325ull;
  const auto files = journal_files(job.session);
  for (const fs::path& path : inputs_of(job)) {
    // The mask may be painted over.
    const auto file = path == job.session.mask
                          ? files.end()
                          : files.find(path.lexically_relative(job.session.folder).generic_string());
    if (file == files.end())
      add_file(hash, path);
    else
      add_bytes(hash, path.filename().string() + ' ' + std::to_string(fs::file_size(path)) + ' ' +
                          crc32_text(file->second.crc32) + '\n');
  }
  const std::string text = formatted("%016llx", static_cast<unsigned long long>(hash));
  if (const auto& colour = job.session.colour)
    key["rec709_from_camera"] =
        std::vector<double>(colour->rec709_from_camera.data(), colour->rec709_from_camera.data() + 9);
  if (!job.rig.is_identity()) key["rig"] = json_from_text(rig_text(job.rig));
  key["inputs"] = inputs_of(job).size();
  key["digest"] = text;
  return json_text(key);
}

std::string provenance_of(const EstimateJob& job, const EstimateOptions& options) {
  Json provenance = {{"made_by", "refield estimate"},
                     {"version", REFIELD_VERSION},
                     {"method", "Matusik, Loper and Pfister 2004"},
                     {"mode", name_of(options.mode)},
                     {"kernels", options.kernels},
                     {"spatial_passes", options.spatial_passes},
                     {"images", job.frames.size()}};
  if (std::isfinite(options.clip_level)) provenance["clip_level"] = options.clip_level;
  if (job.refinement) provenance["refined_from_images"] = job.refinement->known_images();
  if (!job.session.folder.empty()) provenance["session"] = job.session.folder.filename().string();
  // Numbers of arrays name no photographs that a field could be compared with.
  for (const CaptureFrame& frame : job.frames)
    if (!frame.views) provenance["frames"].push_back(frame.name);
  for (const CaptureFrame& frame : job.frames)
    if (const auto found = job.light_patterns.find(frame.name); found != job.light_patterns.end())
      provenance["lights"].push_back(found->second);
  for (const std::string& name : job.held_out) provenance["held_out"].push_back(name);
  if (job.drift.significant)
    provenance["drift_removed"] = {{"reference_frames", job.references.size()},
                                   {"largest_change", job.drift.largest}};
  for (const std::string& name : job.left_out) provenance["left_out"].push_back(name);
  if (!job.rig.is_identity()) provenance["rig"] = json_from_text(rig_text(job.rig));
  return json_text(provenance);
}

}  // namespace refield
