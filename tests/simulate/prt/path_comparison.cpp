// SPDX-License-Identifier: Apache-2.0
#include "tests/simulate/prt/path_comparison.h"

#include <cmath>

namespace refield::prt::test {

void RelativeError::add(const Eigen::Array3f& seen, const Eigen::Array3f& expected) {
  wrong_ += (seen - expected).square().sum();
  all_ += expected.square().sum();
}

double RelativeError::value() const {
  return std::sqrt(wrong_ / all_);
}

namespace {

/// An object for each material, each with all vertices.
dynamic::DynamicScene dynamic_scene(const Scene& scene) {
  dynamic::DynamicScene result;
  for (const Material& material : scene.materials) {
    dynamic::MovingObject& object = result.objects.emplace_back();
    object.mesh = scene.mesh;
    object.mesh.triangles.clear();
    object.brdf.diffuse = material.diffuse;
    object.brdf.specular = material.specular;
    object.brdf.exponent = material.exponent;
    object.brdf.lobe = material.is_diffuse()       ? dynamic::Lobe::none
                       : material.roughness > 0.0f ? dynamic::Lobe::ggx
                                                   : dynamic::Lobe::phong;
    object.brdf.roughness = material.roughness * material.roughness;
    object.motion.path = {{0.0, Eigen::Vector3f::Zero()}};
  }
  for (const auto& triangle : scene.mesh.triangles)
    result.objects[scene.material_of_vertex[triangle[0]]].mesh.triangles.push_back(triangle);
  return result;
}

}  // namespace

TracedVertices trace_vertices(const Scene& scene, std::size_t step, const PathLight& light,
                              const dynamic::ReferenceOptions& options, float tilt) {
  TracedVertices traced;
  std::vector<dynamic::PathStart> starts;
  for (std::size_t v = step / 2; v < scene.mesh.positions.size(); v += step) {
    traced.vertices.push_back(v);
    const auto angle = static_cast<float>(v);
    const Eigen::Vector3f& normal = scene.mesh.normals[v];
    Eigen::Vector3f aside(std::sin(angle), std::cos(angle), std::sin(2.0f * angle));
    aside -= normal * normal.dot(aside);
    traced.to_viewer.push_back((normal + tilt * aside).normalized());
    starts.push_back({scene.material_of_vertex[v], static_cast<std::uint32_t>(v), traced.to_viewer.back()});
  }
  const dynamic::DynamicScene objects = dynamic_scene(scene);
  std::vector<MeshRays> of_objects;
  for (const dynamic::MovingObject& object : objects.objects) of_objects.emplace_back(object.mesh);
  const dynamic::SceneRays rays(of_objects);
  traced.radiance.assign(starts.size(), Eigen::Array3f::Zero());
  for (const auto& bounce :
       trace_bounces(objects, rays, objects.poses(0.0), {.environment = light}, starts, options))
    for (std::size_t k = 0; k < bounce.size(); ++k) traced.radiance[k] += bounce[k];
  return traced;
}

double error_of(const HarmonicTransfer& transfer, const Scene& scene, const HarmonicLight& light,
                const TracedVertices& traced) {
  RelativeError error;
  for (std::size_t k = 0; k < traced.vertices.size(); ++k)
    error.add(radiance(transfer, scene, light, traced.vertices[k], traced.to_viewer[k]), traced.radiance[k]);
  return error.value();
}

}  // namespace refield::prt::test
