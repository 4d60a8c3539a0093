// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/simulate.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/base/units.h"
#include "core/field_io/reflectance_field_file.h"
#include "simulate/rig/light_maps.h"
#include "simulate/tabletop/scene.h"

namespace refield {

namespace {
constexpr int pixels_of_a_band = 4096;  // enough to keep all cores busy, few enough for a quick stop
constexpr int pixels_of_a_task = 32;
}  // namespace

LightSums::LightSums(const LightHierarchy& hierarchy, std::size_t lights)
    : hierarchy_(hierarchy), lights_(lights), sums_(std::size_t{hierarchy.size()} * 3 * lights) {}

void LightSums::set(std::size_t place, const LightMap& light) {
  const LightDomain& domain = hierarchy_.domain();
  if (light.domain() != domain)
    throw InputError("light sums: the light map does not have the monitor's size");
  // First all sums of this light side by side, then one pass that spreads them out among the other lights'.
  std::vector<float> sums(std::size_t{hierarchy_.size()} * 3);
  std::ranges::copy(light.radiance.values, sums.begin());  // level 0 comes first, row by row
  // Each square is the sum of its four quarters: pairwise summation, so float is exact enough.
  for (int level = 1; level <= hierarchy_.coarsest_level(); ++level)
    for (int row = 0; row < hierarchy_.rows(level); ++row)
      for (int column = 0; column < hierarchy_.columns(level); ++column) {
        float* sum = sums.data() + std::size_t{3} * hierarchy_.node(level, column, row);
        for (int j = 2 * row; j < std::min(2 * row + 2, hierarchy_.rows(level - 1)); ++j)
          for (int i = 2 * column; i < std::min(2 * column + 2, hierarchy_.columns(level - 1)); ++i)
            for (int c = 0; c < 3; ++c) sum[c] += sums[std::size_t{3} * hierarchy_.node(level - 1, i, j) + c];
      }
  for (std::size_t k = 0; k < sums.size(); ++k) sums_[k * lights_ + place] = sums[k];
}

void apply_row(const std::vector<TransportEntry>& entries, const LightSums& sums, float* out) {
  const std::size_t lights = sums.lights();
  std::fill_n(out, 3 * lights, 0.0f);
  for (const TransportEntry& entry : entries) {
    const float* light = sums.of(entry.node);
    for (int c = 0; c < 3; ++c) {
      const float weight = entry.weight[c];
      float* to = out + c * lights;
      for (std::size_t l = 0; l < lights; ++l) to[l] += weight * light[c * lights + l];
    }
  }
}

std::uint64_t trace_rows(const TabletopScene& scene, const LightHierarchy& hierarchy,
                         const TraceOptions& options,
                         const std::function<void(int, std::vector<PixelTransport>&)>& take,
                         const RunContext& run) {
  const int width = scene.description().camera.width, height = scene.description().camera.height;
  const int band = std::max(1, pixels_of_a_band / width);
  tbb::enumerable_thread_specific<TraceScratch> scratch([&] { return TraceScratch(hierarchy); });
  Progress progress(run, "tracing light", static_cast<std::uint64_t>(width) * height);
  for (int first = 0; first < height; first += band) {
    run.throw_if_stopped();
    const int count = std::min(band, height - first) * width;
    std::vector<PixelTransport> pixels(count);
    tbb::parallel_for(tbb::blocked_range<int>(0, count, pixels_of_a_task), [&](const auto& range) {
      if (run.is_stopped()) return;  // the band is thrown away
      TraceScratch& mine = scratch.local();
      for (int p = range.begin(); p != range.end(); ++p)
        pixels[p] = trace_pixel(scene, hierarchy, options, p % width, first + p / width, mine);
      progress.advance(range.size());
    });
    run.throw_if_stopped();
    take(first, pixels);
  }
  std::uint64_t rays = 0;
  for (const TraceScratch& mine : scratch) rays += mine.rays;
  return rays;
}

FieldBuilder::FieldBuilder(const LightHierarchy& hierarchy, int width, int height) : hierarchy_(hierarchy) {
  field_.width = width;
  field_.height = height;
  field_.basis.domain = hierarchy.domain();
}

void FieldBuilder::append(const std::vector<PixelTransport>& pixels) {
  for (const PixelTransport& pixel : pixels) {
    for (const TransportEntry& entry : pixel.entries) {
      field_.transfer.column.push_back(entry.node);
      field_.transfer.weight.insert(field_.transfer.weight.end(), entry.weight, entry.weight + 3);
    }
    field_.transfer.row_start.push_back(field_.transfer.column.size());
  }
}

ReflectanceField FieldBuilder::finish() {
  constexpr std::uint32_t unused = 0xffffffffu;
  std::vector<std::uint32_t> place(hierarchy_.size(), unused);
  for (std::uint32_t node : field_.transfer.column) place[node] = 0;
  for (std::uint32_t node = 0; node < hierarchy_.size(); ++node)
    if (place[node] != unused) {
      place[node] = static_cast<std::uint32_t>(field_.basis.boxes.size());
      field_.basis.boxes.push_back(hierarchy_.box(node));
    }
  for (std::uint32_t& column : field_.transfer.column) column = place[column];
  return std::move(field_);
}

namespace {

// Measured on datasets_synthetic/tabletop at 160×120 under 128×96 texels; it grows slowly with the map.
constexpr std::uint64_t typical_entries_of_a_pixel = 600;
constexpr std::uint64_t bytes_of_an_entry = sizeof(std::uint32_t) + 3 * sizeof(float);

// Relative Gaussian noise. Cut at zero, as a photograph of no light is not negative.
void add_noise(Image& photograph, double sigma, std::uint64_t seed, std::size_t place) {
  Rng rng(seed, 0x6e6f69u, place);
  for (float& v : photograph.values) v = std::max(0.0f, v * static_cast<float>(1.0 + sigma * rng.normal()));
}

}  // namespace

void SimulateOptions::check() const {
  if (quality < 1 || quality > 3) throw InputError("quality ", quality, ": give 1, 2 or 3");
  if (!(noise >= 0.0 && noise <= 1.0))
    throw InputError("noise ", noise, ": give a relative standard deviation from 0 to 1");
}

SimulatePlan plan_simulate(const Recipe& recipe, const SimulateOptions& options) {
  const LightHierarchy hierarchy(recipe.scene.monitor.texels);
  const std::uint64_t lights = list_lights(recipe.lights).size();
  const std::uint64_t pixels = std::uint64_t{1} * recipe.scene.camera.width * recipe.scene.camera.height;
  const std::uint64_t texels = std::uint64_t{1} * hierarchy.domain().width * hierarchy.domain().height;
  const std::uint64_t bytes_of_a_sample = options.precision == Precision::half ? 2 : 4;
  SimulatePlan plan;
  plan.transport_bytes = pixels * typical_entries_of_a_pixel * bytes_of_an_entry;
  plan.memory_bytes = LightSums::bytes(hierarchy, lights) + pixels * lights * 3 * sizeof(float) +
                      (options.keep_transport ? 2 * plan.transport_bytes : 0);
  plan.disk_bytes = lights * (pixels + texels) * 3 * bytes_of_a_sample +
                    (options.keep_transport ? plan.transport_bytes : 0);
  return plan;
}

namespace {

CaptureSession session_of(const Recipe& recipe, const std::vector<LightSpec>& lights,
                          const fs::path& folder) {
  CaptureSession session;
  session.folder = folder;
  session.light = recipe.scene.monitor.texels;
  session.monitors = monitor_placements(recipe.scene);
  session.width = recipe.scene.camera.width;
  session.height = recipe.scene.camera.height;
  for (const LightSpec& light : lights)
    session.frames.push_back({light.name, light.role, light.kind,
                              folder / "illumination" / (light.name + ".exr"),
                              folder / "observed" / (light.name + ".exr")});
  return session;
}

/// What all lights add up to. Writes them.
LightSums write_lights(const Recipe& recipe, const std::vector<LightSpec>& lights,
                       const CaptureSession& session, const LightHierarchy& hierarchy, Precision precision,
                       const RunContext& run) {
  LightSums sums(hierarchy, lights.size());
  make_lights(
      lights, hierarchy.domain(), recipe.seed,
      [&](std::size_t place, LightMap&& light) {
        write_exr(session.frames[place].illumination, light.radiance, precision);
        if (precision == Precision::half)  // photographs are of the light that was written
          light = read_light_map(session.frames[place].illumination, light.parameterisation, run);
        sums.set(place, light);
      },
      run);
  return sums;
}

/// What a camera takes of a traced scene, row by row.
struct Photographs {
  Photographs(const LightSums& all, int width, int height)
      : sums(all), ambient(width, height, 3), images(all.lights(), ambient) {}

  void take(int first_row, const std::vector<PixelTransport>& pixels) {
    const std::size_t first = static_cast<std::size_t>(first_row) * ambient.width, lights = sums.lights();
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pixels.size(), 64), [&](const auto& range) {
      std::vector<float> row(3 * lights);
      for (std::size_t p = range.begin(); p != range.end(); ++p) {
        apply_row(pixels[p].entries, sums, row.data());
        for (std::size_t l = 0; l < lights; ++l)
          for (int c = 0; c < 3; ++c) images[l].values[3 * (first + p) + c] = row[c * lights + l];
      }
    });
    for (std::size_t p = 0; p < pixels.size(); ++p) {
      entries += pixels[p].entries.size();
      for (int c = 0; c < 3; ++c) ambient.values[3 * (first + p) + c] = pixels[p].ambient[c];
    }
  }

  const LightSums& sums;
  Image ambient;
  std::vector<Image> images;  ///< [lights]
  std::uint64_t entries = 0;  ///< of the transport
};

/// With noise, each freed once it is written.
void write_photographs(const Recipe& recipe, const SimulateOptions& options, const CaptureSession& session,
                       std::vector<Image>& photographs, const RunContext& run) {
  Progress progress(run, "writing photographs", photographs.size());
  tbb::parallel_for(std::size_t{0}, photographs.size(), [&](std::size_t l) {
    run.throw_if_stopped();
    photographs[l] = recipe.rig.sensor.mixed(std::move(photographs[l]));
    if (options.noise > 0.0) add_noise(photographs[l], options.noise, recipe.seed, l);
    write_exr(session.frames[l].observed, photographs[l], options.precision);
    photographs[l] = Image();
    progress.advance();
  });
}

}  // namespace

SimulateSummary simulate_session(const Recipe& recipe, const SimulateOptions& options, const fs::path& folder,
                                 const RunContext& run) {
  const ThreadLimit limit(run);
  options.check();
  const LightHierarchy hierarchy(recipe.scene.monitor.texels);
  const std::vector<LightSpec> lights = list_lights(recipe.lights);
  const TabletopScene scene(recipe.scene);
  create_folders(folder / "illumination");
  create_folders(folder / "observed");
  const CaptureSession session = session_of(recipe, lights, folder);
  SimulateSummary summary{
      .width = session.width, .height = session.height, .lights = static_cast<int>(lights.size())};

  const auto start_of_lights = std::chrono::steady_clock::now();
  const LightSums sums = write_lights(recipe, lights, session, hierarchy, options.precision, run);
  summary.light_seconds = seconds_since(start_of_lights);

  const auto start_of_tracing = std::chrono::steady_clock::now();
  FieldBuilder builder(hierarchy, session.width, session.height);
  Photographs photographs(sums, session.width, session.height);
  summary.rays = trace_rows(
      scene, hierarchy, TraceOptions::of_quality(options.quality, recipe.seed),
      [&](int first_row, std::vector<PixelTransport>& pixels) {
        photographs.take(first_row, pixels);
        if (options.keep_transport) builder.append(pixels);
      },
      run);
  summary.entries_per_pixel =
      static_cast<double>(photographs.entries) / static_cast<double>(photographs.ambient.pixel_count());
  summary.trace_seconds = seconds_since(start_of_tracing);

  const auto start_of_writing = std::chrono::steady_clock::now();
  if (options.keep_transport) {
    ReflectanceField field = builder.finish();
    field.provenance = options.provenance;
    field.monitors = session.monitors;
    field.output_from_primaries = recipe.rig.sensor.mixing_matrix();
    write_reflectance_field(folder / transport_file_name, field);
    summary.transport_bytes = fs::file_size(folder / transport_file_name);
  }
  write_exr(folder / ambient_file_name, photographs.ambient);
  write_photographs(recipe, options, session, photographs.images, run);
  write_session_manifest(session);  // last: a folder with a manifest is complete
  summary.write_seconds = seconds_since(start_of_writing);
  return summary;
}

TracedScene trace_scene(const SceneDescription& description, const TraceOptions& options,
                        const RunContext& run) {
  const ThreadLimit limit(run);
  const TabletopScene scene(description);
  const LightHierarchy hierarchy(description.monitor.texels);
  const SceneCamera& camera = description.camera;
  FieldBuilder builder(hierarchy, camera.width, camera.height);
  TracedScene traced;
  traced.ambient = Image(camera.width, camera.height, 3);
  trace_rows(
      scene, hierarchy, options,
      [&](int first_row, std::vector<PixelTransport>& pixels) {
        builder.append(pixels);
        float* out = traced.ambient.row(first_row).data();
        for (const PixelTransport& pixel : pixels) out = std::copy_n(pixel.ambient.data(), 3, out);
      },
      run);
  traced.transport = builder.finish();
  traced.transport.monitors = monitor_placements(description);
  return traced;
}

}  // namespace refield
