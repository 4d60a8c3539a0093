// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_file.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "core/image/tone_map.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::prt {

namespace {

constexpr auto no_vertex = std::numeric_limits<std::uint32_t>::max();

/// (p1 − p0) × (p2 − p0): twice the area along the normal. In double, since small triangles far from the
/// origin would lose theirs.
Eigen::Vector3d area_vector(const Mesh& mesh, const std::array<std::uint32_t, 3>& triangle) {
  const Eigen::Vector3d a = mesh.positions[triangle[0]].cast<double>();
  return (mesh.positions[triangle[1]].cast<double>() - a)
      .cross(mesh.positions[triangle[2]].cast<double>() - a);
}

/// Position, normal, colour and material of a vertex. Normals are compared coarsely: exporters round them.
using Identity = std::array<float, 10>;

/// What makes two vertices of a file one: as points that have a colour, or as points of a smooth surface.
enum class Alike { coloured, smooth };

Identity identity_of(const ImportedMesh& file, std::uint32_t vertex, Alike alike) {
  Identity identity{};
  std::copy_n(file.positions[vertex].data(), 3, identity.begin());
  if (alike == Alike::coloured) {
    if (!file.colours.empty()) std::copy_n(file.colours[vertex].data(), 3, identity.begin() + 3);
    identity[9] = static_cast<float>(file.material[vertex]);
  }
  if (!file.normals.empty() && file.normals[vertex].allFinite())
    for (int i = 0; i < 3; ++i)
      identity[6 + static_cast<std::size_t>(i)] = std::round(32.0f * file.normals[vertex][i]);
  for (float& value : identity)
    if (!std::isfinite(value)) value = 0.0f;  // colours; an order needs comparable values
  return identity;
}

/// [vertices of the file]: the first vertex that is the same.
std::vector<std::uint32_t> first_of(const ImportedMesh& file, Alike alike) {
  std::vector<Identity> identities(file.positions.size());
  std::vector<std::uint32_t> order(file.positions.size()), first(file.positions.size());
  std::iota(order.begin(), order.end(), 0u);
  for (const std::uint32_t vertex : order) identities[vertex] = identity_of(file, vertex, alike);
  std::ranges::sort(order, [&](std::uint32_t a, std::uint32_t b) {
    return identities[a] != identities[b] ? identities[a] < identities[b] : a < b;
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && identities[order[i]] == identities[order[i - 1]];
    first[order[i]] = same ? first[order[i - 1]] : order[i];
  }
  return first;
}

Eigen::Array3f linear_colour(const Eigen::Array3f& colour, ColourCoding coding) {
  Eigen::Array3f linear;
  for (int c = 0; c < 3; ++c) {
    const float value = std::isfinite(colour[c]) ? std::clamp(colour[c], 0.0f, 1.0f) : 0.0f;
    linear[c] = coding == ColourCoding::srgb ? linear_from_srgb(value) : value;
  }
  return linear;
}

bool shines(const VertexMaterial& material) {
  return material.roughness <= max_roughness &&
         (material.metallic > 0.0f || (material.specular > 0.0f).any());
}

/// Shares a vertex' colour out between it and the lobe.
void reflect(const VertexMaterial& material, Gloss gloss, Eigen::Array3f& colour, Eigen::Array4f& lobe) {
  const Eigen::Array3f base = material.base_colour * colour;
  const Eigen::Array3f specular = (1.0f - material.metallic) * material.specular + material.metallic * base;
  colour = (1.0f - material.metallic) * (1.0f - material.specular) * base;
  if (gloss == Gloss::diffuse || material.roughness > max_roughness)
    colour += specular;
  else
    lobe << specular, std::max(material.roughness, min_roughness);
}

/// The triangles that have an area, over the vertices that they use, these numbered anew. `materials`
/// [vertices of the file], or empty.
MeshFile in_light_axes(const ImportedMesh& file, const MeshFileOptions& options, ColourCoding coding,
                       const std::vector<VertexMaterial>& materials) {
  MeshFile result;
  result.has_materials = !materials.empty();
  Mesh& mesh = result.mesh;
  const std::vector<std::uint32_t> first = first_of(file, Alike::coloured);
  std::vector<std::uint32_t> number(file.positions.size(), no_vertex);
  Mesh all;
  all.positions = file.positions;
  std::vector<std::uint32_t> places;  // [vertices of the mesh], in the file
  for (const auto& triangle : file.triangles) {
    const std::array joined{first[triangle[0]], first[triangle[2]], first[triangle[1]]};
    if (!(area_vector(all, joined).squaredNorm() > 0.0)) continue;
    std::array<std::uint32_t, 3> renumbered{};
    for (std::size_t i = 0; i < 3; ++i) {
      std::uint32_t& vertex = number[joined[i]];
      if (vertex == no_vertex) {
        vertex = static_cast<std::uint32_t>(mesh.positions.size());
        const Eigen::Vector3f& position = file.positions[joined[i]];
        mesh.positions.emplace_back(position.x(), position.y(), -position.z());
        mesh.colours.push_back(file.colours.empty() ? Eigen::Array3f(Eigen::Array3f::Ones())
                                                    : linear_colour(file.colours[joined[i]], coding));
        if (!materials.empty())
          reflect(materials[joined[i]], options.gloss, mesh.colours.back(),
                  result.lobes.emplace_back(0.0f, 0.0f, 0.0f, 1.0f));
        places.push_back(joined[i]);
      }
      renumbered[i] = vertex;
    }
    mesh.triangles.push_back(renumbered);
  }
  // Colours and materials end where they like, without an edge.
  const std::vector<std::uint32_t> smooth = first_of(file, Alike::smooth);
  Mesh surface;
  surface.positions = file.positions;
  for (Eigen::Vector3f& position : surface.positions) position.z() = -position.z();
  for (const auto& triangle : mesh.triangles) {
    std::array<std::uint32_t, 3> corners{};
    std::ranges::transform(triangle, corners.begin(), [&](std::uint32_t v) { return smooth[places[v]]; });
    surface.triangles.push_back(corners);
  }
  compute_normals(surface);
  for (const std::uint32_t place : places) mesh.normals.push_back(surface.normals[smooth[place]]);
  if (std::ranges::all_of(result.lobes, [](const auto& lobe) { return lobe[3] > max_roughness; }))
    result.lobes.clear();
  return result;
}

/// Coordinates of maps and surveys exceed what floats resolve.
void require_near_origin(const Mesh& mesh, const fs::path& path) {
  constexpr float max_rounding = 1e-4f;  // of the diagonal
  const Eigen::AlignedBox3f box = bounds_of(mesh);
  const float farthest = std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff());
  if (farthest * std::numeric_limits<float>::epsilon() > max_rounding * box.diagonal().norm())
    throw FormatError(path, "lies ", std::lround(farthest / box.diagonal().norm()),
                      " times its size away from the origin, where single precision deforms it; move "
                      "it to the origin");
}

}  // namespace

void compute_normals(Mesh& mesh) {
  std::vector<Eigen::Vector3d> sums(mesh.positions.size(), Eigen::Vector3d::Zero());
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle) sums[vertex] += area_vector(mesh, triangle);
  // Opposite triangles cancel out but for rounding.
  std::vector<double> areas(mesh.positions.size(), 0.0);
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle) areas[vertex] += area_vector(mesh, triangle).norm();
  mesh.normals.assign(mesh.positions.size(), Eigen::Vector3f::Zero());
  for (std::size_t v = 0; v < sums.size(); ++v)
    if (sums[v].norm() > 1e-6 * areas[v]) mesh.normals[v] = sums[v].normalized().cast<float>();
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle)
      if (mesh.normals[vertex].isZero())
        mesh.normals[vertex] = area_vector(mesh, triangle).normalized().cast<float>();
}

std::vector<float> vertex_areas(std::span<const Eigen::Vector3f> positions,
                                std::span<const std::array<std::uint32_t, 3>> triangles) {
  std::vector<float> areas(positions.size());
  for (const auto& [a, b, c] : triangles) {
    const Eigen::Vector3f &p = positions[a], &q = positions[b], &r = positions[c];
    const float third = (q - p).cross(r - p).norm() / 6.0f;
    for (const std::uint32_t corner : {a, b, c}) areas[corner] += third;
  }
  return areas;
}

MeshFile read_mesh_file(const fs::path& path, const MeshFileOptions& options, const RunContext& run) {
  const ImportedMesh file = import_mesh(path, run);
  const std::vector<VertexMaterial> materials =
      options.materials ? vertex_materials(file, path, run) : std::vector<VertexMaterial>();
  if (options.gloss == Gloss::diffuse && std::ranges::any_of(materials, shines))
    run.note(path,
             ": vertices of light clusters have no view, so highlights and metallic reflection of its "
             "materials are reflected diffusely, with the same reflectance; precompute an image or spherical "
             "harmonics to see them");
  MeshFile result =
      in_light_axes(file, options, options.coding.value_or(usual_colour_coding(path)), materials);
  const Mesh& mesh = result.mesh;
  if (mesh.triangles.empty())
    throw FormatError(path, file.triangles.empty()
                                ? "contains no triangles; convert a point cloud to a surface first"
                                : "holds " + std::to_string(file.triangles.size()) +
                                      " triangles, none with an area; repair the mesh");
  require_near_origin(mesh, path);
  const std::size_t left_out = file.triangles.size() - mesh.triangles.size();
  if (left_out > 0)
    run.note(path, ": ", left_out, " of ", file.triangles.size(), " triangles have no area and are ignored");
  return result;
}

}  // namespace refield::prt
