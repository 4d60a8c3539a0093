// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <bit>
#include <numeric>

#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/field/mesh.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

constexpr std::size_t max_metered = 8;
constexpr std::size_t max_kept_bytes = std::size_t{256} << 20;

bool is_mesh(const RelightJob& job) {
  return job.output.extension() == ".glb";
}

/// Whether an exposure applies.
bool is_exposed(const RelightJob& job) {
  return job.output.extension() == ".png" || is_mesh(job);
}

const Image& radiance_of(const SceneLight& light) {
  const auto* map = std::get_if<LightMap>(&light);
  return map ? map->radiance : std::get<SceneEnvironment>(light).environment->map().radiance;
}

double exposure_of(const Image& shown) {
  ExposureMeter meter;
  meter.add(shown);
  return meter.exposure();
}

void raise_to(std::atomic<double>& largest, double value) {
  double before = largest;
  while (value > before && !largest.compare_exchange_weak(before, value)) {
  }
}

/// A picture divided by its coverage [pixels], the radiance of the covered part; zero where there is none.
Image unpremultiplied(Image image, std::span<const float> coverage) {
  for (std::size_t p = 0; p < coverage.size(); ++p)
    for (std::size_t c = 0; c < 3; ++c)
      if (coverage[p] > 0.0f) image.values[3 * p + c] /= coverage[p];
  return image;
}

/// EXR prescribes premultiplied alpha, PNG alpha that is not.
void write_with_alpha(const fs::path& path, const Image& image, std::span<const float> coverage,
                      ColourSpace space) {
  Image rgba(image.width, image.height, 4);
  for (std::size_t p = 0; p < coverage.size(); ++p) {
    std::copy_n(&image.values[3 * p], 3, &rgba.values[4 * p]);
    rgba.values[4 * p + 3] = coverage[p];
  }
  write_exr(path, rgba, Precision::single, space);
}
void write_with_alpha(const fs::path& path, const Image& straight, const ToneMapping& mapping,
                      std::span<const float> coverage) {
  const auto levels = tone_mapped(straight, mapping);
  ScreenImage rgba{straight.width, straight.height, 4, std::vector<std::uint8_t>(4 * coverage.size())};
  for (std::size_t p = 0; p < coverage.size(); ++p) {
    std::copy_n(&levels[3 * p], 3, &rgba.levels[4 * p]);
    rgba.levels[4 * p + 3] = static_cast<std::uint8_t>(std::lround(255.0f * coverage[p]));
  }
  write_png(path, rgba);
}

static_assert(std::endian::native == std::endian::little, "glTF stores the lowest byte first");

constexpr int float_type = 5126, index_type = 5125;         // of accessors
constexpr int vertex_buffer = 34962, index_buffer = 34963;  // targets of buffer views

/// The buffer of a file and what lies in it.
struct Buffer {
  std::string bytes;
  Json views = Json::array(), accessors = Json::array();

  /// The number of the accessor.
  template <class Value>
  int add(const std::vector<Value>& values, std::size_t count, const char* type, int component, int target) {
    views.push_back({{"buffer", 0},
                     {"byteOffset", bytes.size()},
                     {"byteLength", values.size() * sizeof(Value)},
                     {"target", target}});
    accessors.push_back(
        {{"bufferView", views.size() - 1}, {"componentType", component}, {"count", count}, {"type", type}});
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value));
    return static_cast<int>(accessors.size()) - 1;
  }
};

std::vector<float> turned(const std::vector<Eigen::Vector3f>& vectors) {
  std::vector<float> values;
  for (const Eigen::Vector3f& vector : vectors)
    values.insert(values.end(), {vector.x(), vector.y(), -vector.z()});
  return values;
}

void append_word(std::string& bytes, std::size_t word) {
  const auto value = static_cast<std::uint32_t>(word);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void append_chunk(std::string& bytes, const char* kind, std::string content, char filling) {
  content.resize((content.size() + 3) / 4 * 4, filling);
  append_word(bytes, content.size());
  bytes.append(kind, 4);
  bytes += content;
}

/// Writes a mesh whose vertices shine as `colours` [vertices] say, linear RGB, clamped to [0, 1], as binary
/// glTF 2.0 (.glb), atomically: colours of vertices (COLOR_0, float) on an unlit material
/// (KHR_materials_unlit), normals for those who want them. glTF is right-handed: z is negated and triangles
/// are turned around. Throws DeviceError where the system refuses.
void write_baked_mesh(const fs::path& path, const Mesh& mesh, std::span<const Eigen::Array3f> colours) {
  const std::size_t vertices = mesh.positions.size();
  std::vector<float> colour_values;
  for (const Eigen::Array3f& colour : colours)
    for (const float value : colour) colour_values.push_back(std::min(std::max(value, 0.0f), 1.0f));
  std::vector<std::uint32_t> corners;
  for (const auto& [a, b, c] : mesh.triangles) corners.insert(corners.end(), {a, c, b});
  Eigen::AlignedBox3f bounds;
  for (const Eigen::Vector3f& position : mesh.positions)
    bounds.extend(Eigen::Vector3f(position.x(), position.y(), -position.z()));

  Buffer buffer;
  const int positions = buffer.add(turned(mesh.positions), vertices, "VEC3", float_type, vertex_buffer);
  for (const auto& [name, corner] : {std::pair{"min", bounds.min()}, {"max", bounds.max()}})
    buffer.accessors[positions][name] = {corner.x(), corner.y(), corner.z()};
  const int normals = buffer.add(turned(mesh.normals), vertices, "VEC3", float_type, vertex_buffer);
  const int colour = buffer.add(colour_values, vertices, "VEC3", float_type, vertex_buffer);
  const int indices = buffer.add(corners, corners.size(), "SCALAR", index_type, index_buffer);
  const auto list_of = [](Json value) { return Json::array({std::move(value)}); };
  const Json primitive{{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"COLOR_0", colour}}},
                       {"indices", indices},
                       {"material", 0}};
  const Json material{{"name", "baked"},
                      {"pbrMetallicRoughness", {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}}},
                      {"extensions", {{"KHR_materials_unlit", Json::object()}}}};
  const Json gltf{{"asset", {{"version", "2.0"}, {"generator", "refield"}}},
                  {"extensionsUsed", list_of("KHR_materials_unlit")},
                  {"scene", 0},
                  {"scenes", list_of({{"nodes", list_of(0)}})},
                  {"nodes", list_of({{"mesh", 0}})},
                  {"meshes", list_of({{"primitives", list_of(primitive)}})},
                  {"materials", list_of(material)},
                  {"accessors", buffer.accessors},
                  {"bufferViews", buffer.views},
                  {"buffers", list_of({{"byteLength", buffer.bytes.size()}})}};

  std::string chunks;
  append_chunk(chunks, "JSON", json_text(gltf), ' ');
  append_chunk(chunks, "BIN\0", buffer.bytes, '\0');
  std::string file = "glTF";
  append_word(file, 2);
  append_word(file, 12 + chunks.size());
  write_text_atomically(path, file + chunks);
}

}  // namespace

Image MeteredPicture::whole() && {
  for (std::size_t i = 0; i < background.values.size(); ++i) scene.values[i] += background.values[i];
  return std::move(scene);
}

MeteredPictures::MeteredPictures(const FieldPictures& field, std::vector<LightFunction> lights,
                                 std::string name, std::vector<char> are_meshes)
    : field_(field), lights_(std::move(lights)), name_(std::move(name)), are_meshes_(std::move(are_meshes)) {}

void MeteredPictures::require_finite(const Image& image, std::size_t i, const SceneLight& light) const {
  if (std::ranges::all_of(image.values, [](float value) { return std::isfinite(value); })) return;
  refield::require_finite(
      image, name_ + (lights_.size() == 1 ? std::string() : ", picture " + std::to_string(i + 1)), true,
      formatted(
          "the light is too bright for 32-bit floats (its brightest texel: %.3g); scale the light map down",
          *std::ranges::max_element(radiance_of(light).values)));
}

MeteredPicture MeteredPictures::make(std::size_t i, bool is_metered, const RunContext& run) const {
  run.throw_if_stopped();
  const SceneLight light = lights_[i]();
  if (const auto* map = std::get_if<LightMap>(&light)) {
    const LightShares shares = field_.light_shares(*map);
    raise_to(interpolated_, shares.interpolated);
    raise_to(unobserved_, shares.unobserved);
  }
  Image outputs = field_.outputs(light, run);
  MeteredPicture made;
  if (is_mesh(i)) {
    made.vertices = field_.vertices(outputs);
    require_finite(made.vertices, i, light);
    if (!is_metered) return made;
  }
  made.scene = field_.picture(std::move(outputs), i);
  require_finite(made.scene, i, light);
  made.background = field_.background(light, i);
  return made;
}

double MeteredPictures::sequence_exposure(const RunContext& run) {
  const std::size_t count = std::min(lights_.size(), max_metered);
  std::vector<MeteredPicture> pictures(count);
  const auto place = [&](std::size_t k) { return (2 * k + 1) * lights_.size() / (2 * count); };
  Progress progress(run, "choosing the exposure", count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    pictures[k] = make(place(k), true, run);
    progress.advance();
  });
  ExposureMeter meter;
  std::size_t bytes = 0;
  for (std::size_t k = 0; k < count; ++k) {
    meter.add(pictures[k].scene);
    bytes += (pictures[k].scene.values.size() + pictures[k].background.values.size()) * sizeof(float);
    if (bytes <= max_kept_bytes) kept_.emplace(place(k), std::move(pictures[k]));
  }
  return meter.exposure();
}

MeteredPicture MeteredPictures::take(std::size_t i, const RunContext& run) {
  const auto kept = kept_.find(i);  // no one else looks for picture i, and the map stays as it is
  return kept == kept_.end() ? make(i, false, run) : std::move(kept->second);
}

ExposureReport relight_to_files(const FieldPictures& field, const std::vector<RelightJob>& jobs,
                                const ExposureOptions& exposure, const RunContext& run) {
  const ThreadLimit limit(run);
  std::vector<LightFunction> lights;
  std::vector<char> are_meshes;
  for (const RelightJob& job : jobs) {
    if (job.output.extension() != ".exr" && !is_exposed(job))
      throw InputError(job.output,
                       ": images are written as .exr or .png, meshes as .glb; give an output with one of "
                       "these extensions");
    lights.push_back(job.light);
    are_meshes.push_back(is_mesh(job));
  }
  const auto exposed = static_cast<std::size_t>(std::ranges::count_if(jobs, is_exposed));
  const fs::path& first = jobs.front().output;
  MeteredPictures pictures(field, std::move(lights),
                           (jobs.size() == 1 ? first : first.parent_path()).string(), std::move(are_meshes));
  std::optional<double> shared = exposure.factor;
  if (!shared && exposure.is_sequence && exposed > 0) shared = pictures.sequence_exposure(run);
  std::vector<double> factors(jobs.size()), clipped(jobs.size());
  Progress progress(run, "relight", jobs.size());
  // One task an image: compressing and writing files takes longer than the product T L, and so it overlaps
  // too. Memory stays at one image a core.
  tbb::parallel_for(std::size_t{0}, jobs.size(), [&](std::size_t i) {
    run.throw_if_stopped();
    const auto factor_for = [&](const Image& shown) {
      factors[i] = shared ? *shared : exposure_of(shown);
      if (exposure.factor) clipped[i] = clipped_share(shown, factors[i]);
    };
    MeteredPicture picture = pictures.take(i, run);
    if (is_mesh(jobs[i])) {
      factor_for(picture.vertices);
      std::vector<Eigen::Array3f> colours;
      for (std::size_t v = 0; v < picture.vertices.values.size(); v += 3)
        colours.push_back(Eigen::Map<const Eigen::Array3f>(&picture.vertices.values[v]) *
                          static_cast<float>(factors[i]));
      write_baked_mesh(jobs[i].output, *field.mesh(), colours);
      progress.advance();
      return;
    }
    const bool fills = !picture.background.values.empty();
    const std::vector<float> coverage = field.coverage(i);
    if (is_exposed(jobs[i])) {
      // A background is added to the picture as it is; without one, the picture may be changed.
      const Image shown = unpremultiplied(fills ? picture.scene : std::move(picture.scene), coverage);
      factor_for(shown);
      if (fills)
        write_png(jobs[i].output, std::move(picture).whole(), {factors[i]});
      else if (coverage.empty())
        write_png(jobs[i].output, shown, {factors[i]});
      else
        write_with_alpha(jobs[i].output, shown, {factors[i]}, coverage);
    } else if (coverage.empty() || fills) {
      write_exr(jobs[i].output, std::move(picture).whole(), Precision::single, field.colour_space());
    } else {
      write_with_alpha(jobs[i].output, picture.scene, coverage, field.colour_space());
    }
    progress.advance();
  });
  ExposureReport report;
  report.light_shares = pictures.light_shares();
  if (exposed == 0) return report;
  report.factors = shared ? std::vector{*shared} : std::move(factors);
  report.clipped = std::accumulate(clipped.begin(), clipped.end(), 0.0) / static_cast<double>(exposed);
  return report;
}

}  // namespace refield
