// SPDX-License-Identifier: Apache-2.0

#include <sys/mman.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <map>
#include <set>

#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/mesh_formats.h"

namespace refield::prt {

namespace {

/// Bytes that readers of files read.
class MemoryFile {
 public:
  explicit MemoryFile(const std::string& bytes) : descriptor_(::memfd_create("texture", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw DeviceError("texture", errno, "cannot be held in memory");
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t count = ::write(descriptor_, bytes.data() + done, bytes.size() - done);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) {
        const int error = errno;
        ::close(descriptor_);
        throw DeviceError("texture", error, "cannot be held in memory");
      }
      done += static_cast<std::size_t>(count);
    }
  }
  ~MemoryFile() { ::close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  fs::path path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

/// The image of a texture, linear; nothing where it cannot be read.
std::optional<Image> read_texture(const ImportedTexture& texture, const fs::path& path,
                                  const RunContext& run) {
  const std::string name =
      texture.file.empty() ? std::string("inside") : fs::path(texture.file).filename().string();
  try {
    if (texture.file.empty()) {
      const MemoryFile inside(texture.content);
      return read_image(inside.path(), ImageUse::texture);
    }
    // The process that reads meshes is not trusted.
    if (may_be_read_for(path, texture.file)) return read_image(texture.file, ImageUse::texture);
  } catch (const Interrupted&) {
    throw;
  } catch (const Error&) {  // its message names a file that no user knows
  }
  run.note(path, ": the texture ", name,
           " is no readable image; its parts are shown without it. Convert it to PNG");
  return std::nullopt;
}

/// Textures of a mesh that are used, each read once.
class Textures {
 public:
  Textures(const ImportedMesh& mesh, const fs::path& path, const RunContext& run)
      : mesh_(&mesh), path_(&path), run_(&run), images_(mesh.textures.size()), tried_(images_.size()) {}

  /// Nothing where there is none, or none that can be read.
  const Image* find(std::int32_t index) {
    if (index < 0 || mesh_->texture_places.empty()) return nullptr;
    const auto i = static_cast<std::size_t>(index);
    if (!tried_[i]) images_[i] = read_texture(mesh_->textures[i], *path_, *run_);
    tried_[i] = true;
    return images_[i] ? &*images_[i] : nullptr;
  }

 private:
  const ImportedMesh* mesh_;
  const fs::path* path_;
  const RunContext* run_;
  std::vector<std::optional<Image>> images_;
  std::vector<bool> tried_;
};

/// How far the footprint of a vertex goes on the texture: left, right, up and down.
using Reach = Eigen::Array4f;

/// Half of the mean edge at each vertex; at a border of the texture's use, no further than the edges go.
std::vector<Reach> reaches_of(const ImportedMesh& mesh) {
  std::vector<Reach> sums(mesh.positions.size(), Reach::Zero());
  std::vector<float> edges(mesh.positions.size(), 0.0f);
  for (const auto& triangle : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      for (const std::size_t other : {(i + 1) % 3, (i + 2) % 3}) {
        const Eigen::Vector2f edge = mesh.texture_places[triangle[other]] - mesh.texture_places[triangle[i]];
        sums[triangle[i]] += Reach(-edge.x(), edge.x(), edge.y(), -edge.y()).max(0.0f);
        edges[triangle[i]] += 1.0f;
      }
  for (std::size_t v = 0; v < sums.size(); ++v) {
    sums[v] /= std::max(edges[v], 1.0f);
    const float across = 0.5f * (sums[v][0] + sums[v][1]), along = 0.5f * (sums[v][2] + sums[v][3]);
    sums[v] = sums[v].min(Reach(across, across, along, along));
  }
  return sums;
}

/// Texels of one axis and what each counts: the overlaps with [middle − before, middle + after], at least one
/// texel wide, in texels.
struct Overlaps {
  Overlaps(double middle, double before, double after) {
    const double width = before + after;
    if (width < 1.0) before = width > 0.0 ? before / width : 0.5, after = 1.0 - before;
    first = static_cast<long>(std::floor(middle - before));
    const auto last = static_cast<long>(std::ceil(middle + after));
    // Some texels speak for all of many.
    step = std::max(1L, (last - first) / 64);
    for (long texel = first; texel < last; texel += step) {
      const auto low = static_cast<double>(texel), high = static_cast<double>(texel + step);
      shares.push_back(
          static_cast<float>(std::max(std::min(high, middle + after) - std::max(low, middle - before), 0.0)));
    }
  }
  long first, step;
  std::vector<float> shares;
};

long wrapped(long texel, long size) {
  return (texel % size + size) % size;
}

/// Texels are decoded as sRGB; `encoded` takes them as the file has them.
Eigen::Array3f mean_around(const Image& texture, const Eigen::Vector2f& place, const Reach& reach,
                           bool encoded) {
  if (!place.allFinite() || !reach.allFinite()) return Eigen::Array3f::Ones();
  // Textures repeat: whole turns change nothing, and are all the same beyond a turn.
  const double u = place.x() - std::floor(place.x()), v = place.y() - std::floor(place.y());
  const auto size = Eigen::Array2d(texture.width, texture.height);
  const Eigen::Array2d shrunk = size / Eigen::Array2d(reach[0] + reach[1], reach[2] + reach[3]).max(1.0);
  const Eigen::Array4d far =
      reach.cast<double>() * Eigen::Array4d(shrunk[0], shrunk[0], shrunk[1], shrunk[1]);
  const Overlaps columns(u * texture.width, far[0], far[1]);
  const Overlaps rows((1.0 - v) * texture.height, far[2], far[3]);
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  float weight = 0.0f;
  for (std::size_t j = 0; j < rows.shares.size(); ++j)
    for (std::size_t i = 0; i < columns.shares.size(); ++i) {
      const auto x =
          static_cast<int>(wrapped(columns.first + static_cast<long>(i) * columns.step, texture.width));
      const auto y = static_cast<int>(wrapped(rows.first + static_cast<long>(j) * rows.step, texture.height));
      const float share = rows.shares[j] * columns.shares[i];
      for (int c = 0; c < 3; ++c) {
        const float value = texture.at(x, y, c);
        sum[c] += share * (encoded ? srgb_from_linear(value) : value);
      }
      weight += share;
    }
  return sum / weight;
}

/// Whether a triangle has an edge without another one on its other side.
bool is_open(const ImportedMesh& mesh) {
  std::map<std::array<float, 3>, std::size_t> points;
  std::set<std::array<std::size_t, 2>> edges;
  for (const auto& triangle : mesh.triangles) {
    std::array<std::size_t, 3> corner{};
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector3f& p = mesh.positions[triangle[i]];
      corner[i] = points.try_emplace({p.x(), p.y(), p.z()}, points.size()).first->second;
    }
    for (std::size_t i = 0; i < 3; ++i) edges.insert({corner[i], corner[(i + 1) % 3]});
  }
  return std::ranges::any_of(edges, [&](const auto& edge) { return !edges.contains({edge[1], edge[0]}); });
}

void note_ignored(const ImportedMesh& mesh, const std::vector<bool>& used, const fs::path& path,
                  const RunContext& run) {
  std::uint32_t ignored = 0;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i]) ignored |= mesh.materials[i].ignored;
    if (used[i] && mesh.materials[i].texture >= 0 && mesh.texture_places.empty()) ignored |= ignored_texture;
  }
  if (ignored & ignored_texture)
    run.note(path,
             ": a texture of its materials is not in its folder, or not placed by the first texture "
             "coordinates; its parts are shown without it");
  if (ignored & ignored_excess)
    run.note(path, ": its materials have factors outside [0, 1], which are clamped");
  if (ignored & ignored_black)
    run.note(path,
             ": its textures are shown as they are, though their materials multiply them by black (Kd, "
             "baseColorFactor); remove the textures if the surfaces are black");
  if (ignored & ignored_back && is_open(mesh))
    run.note(path,
             ": its double-sided surfaces are lit on one side, that of their normals; give those that are "
             "seen from behind a thickness");
  std::string parts;
  for (const auto& [part, name] :
       {std::pair{ignored_layers, "clear coat, sheen, textures and further factors of highlights"},
        {ignored_relief, "normal and bump maps"},
        {ignored_emission, "emission"},
        {ignored_transparency, "transparency"}})
    if (ignored & part) parts += (parts.empty() ? "" : ", ") + std::string(name);
  if (!parts.empty())
    run.note(path, ": of its materials, ", parts,
             " are ignored; name a [[material]] in a scene file (docs/reference/scene-files.md) for another "
             "surface");
}

float unit(float factor) {
  return std::isfinite(factor) ? std::clamp(factor, 0.0f, 1.0f) : 0.0f;
}

/// A lobe has one width in each material: the mean of its roughness texture over its surface.
void average_roughness(const ImportedMesh& mesh, std::vector<VertexMaterial>& vertices) {
  const std::vector<float> areas = vertex_areas(mesh.positions, mesh.triangles);
  struct Mean {
    double sum = 0.0, area = 0.0;
    bool shines = false;
  };
  std::vector<Mean> means(mesh.materials.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    Mean& mean = means[mesh.material[v]];
    mean.sum += static_cast<double>(areas[v]) * vertices[v].roughness;
    mean.area += areas[v];
    mean.shines = mean.shines || vertices[v].metallic > 0.0f || (vertices[v].specular > 0.0f).any();
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const Mean& mean = means[mesh.material[v]];
    if (mean.area > 0.0) vertices[v].roughness = static_cast<float>(mean.sum / mean.area);
    if (!mean.shines) vertices[v].roughness = 1.0f;
  }
}

}  // namespace

std::vector<VertexMaterial> vertex_materials(const ImportedMesh& mesh, const fs::path& path,
                                             const RunContext& run) {
  std::vector<bool> used(mesh.materials.size());
  for (const std::uint32_t material : mesh.material) used[material] = true;
  struct MaterialTextures {
    const Image *base_colour = nullptr, *metallic = nullptr, *roughness = nullptr;
  };
  std::vector<MaterialTextures> textures(mesh.materials.size());
  Textures images(mesh, path, run);
  bool any = false, textured = false;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    const ImportedMaterial& material = mesh.materials[i];
    any = any || material.is_of_the_file != 0;
    textures[i] = {images.find(material.texture), images.find(material.metallic_texture),
                   images.find(material.roughness_texture)};
    textured = textured || textures[i].base_colour || textures[i].metallic || textures[i].roughness;
  }
  if (!any) return {};
  note_ignored(mesh, used, path, run);

  const std::vector<Reach> reaches = textured ? reaches_of(mesh) : std::vector<Reach>();
  std::vector<VertexMaterial> vertices(mesh.positions.size());
  tbb::parallel_for(std::size_t{0}, vertices.size(), [&](std::size_t v) {
    const ImportedMaterial& material = mesh.materials[mesh.material[v]];
    const MaterialTextures& texture = textures[mesh.material[v]];
    const auto value = [&](const Image* image, bool encoded) -> Eigen::Array3f {
      if (!image) return Eigen::Array3f::Ones();
      return mean_around(*image, mesh.texture_places[v], reaches[v], encoded);
    };
    const Eigen::Array3f base_colour =
        Eigen::Map<const Eigen::Array3f>(material.base_colour.data()) * value(texture.base_colour, false);
    vertices[v] = {base_colour.unaryExpr(&unit),
                   Eigen::Map<const Eigen::Array3f>(material.specular.data()).unaryExpr(&unit),
                   unit(unit(material.metallic) * value(texture.metallic, true)[2]),
                   unit(unit(material.roughness) * value(texture.roughness, true)[1])};
  });
  average_roughness(mesh, vertices);
  return vertices;
}

}  // namespace refield::prt
