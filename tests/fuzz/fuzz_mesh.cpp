// SPDX-License-Identifier: Apache-2.0
// Any bytes as a mesh: one that keeps its promises, or an Error. The first byte chooses the format.
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "core/base/errors.h"
#include "simulate/geometry/mesh_file.h"
#include "tests/fuzz/memory_file.h"
#include "tests/support/isolating_run.h"
#include "tests/support/temporary_folder.h"

namespace fs = std::filesystem;

namespace {

void require_whole(const refield::Mesh& mesh) {
  const std::size_t vertices = mesh.positions.size();
  bool whole = !mesh.triangles.empty() && mesh.normals.size() == vertices && mesh.colours.size() == vertices;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle) whole = whole && vertex < vertices;
  for (const auto& normal : mesh.normals) whole = whole && std::abs(normal.norm() - 1.0f) < 1e-3f;
  for (const auto& colour : mesh.colours) whole = whole && (colour >= 0.0f).all() && (colour <= 1.0f).all();
  if (!whole) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const refield::test::TemporaryFolder folder;
  static constexpr const char* names[] = {"mesh.off", "mesh.obj", "mesh.ply", "mesh.gltf", "mesh.glb"};
  if (size < 2) return 0;
  const refield::fuzz::MemoryFile file(data + 1, size - 1);
  const fs::path mesh = folder / names[data[0] % std::size(names)];
  fs::remove(mesh);
  fs::create_symlink(file.path(), mesh);
  try {
    require_whole(refield::prt::read_mesh_file(mesh, {}, refield::test::isolating_run()).mesh);
  } catch (const refield::Error&) {
  }
  return 0;
}
