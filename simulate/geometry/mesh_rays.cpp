// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_rays.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <limits>

#include "core/base/errors.h"
#include "core/base/floating_point.h"
#include "simulate/geometry/place_mesh.h"

namespace refield::prt {

namespace {

void on_embree_error(void*, RTCError code, const char* text) {
  throw InputError("ray tracing library: error ", code, ": ", text ? text : "");
}

RTCDevice new_device() {
  const RTCDevice device = rtcNewDevice(nullptr);
  if (!device) throw InputError("ray tracing library: cannot start (error ", rtcGetDeviceError(nullptr), ")");
  rtcSetDeviceErrorFunction(device, on_embree_error, nullptr);
  return device;
}

/// The program's only one: scenes of one device can hold one another.
RTCDevice embree_device() {
  struct ReleaseDevice {
    void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
  };
  static const std::unique_ptr<RTCDeviceTy, ReleaseDevice> device(new_device());
  return device.get();
}

std::uint32_t attach(RTCScene scene, RTCGeometry geometry) {
  rtcCommitGeometry(geometry);
  const std::uint32_t number = rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  return number;
}

}  // namespace

void RayScene::Release::operator()(RTCSceneTy* scene) const {
  rtcReleaseScene(scene);
}

RayScene::RayScene(Use use) : scene_(rtcNewScene(embree_device())) {
  rtcSetSceneFlags(scene_.get(), use == Use::moving ? RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC
                                                    : RTC_SCENE_FLAG_ROBUST);
}

std::uint32_t RayScene::add_mesh(const Mesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(embree_device(), RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* positions = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                              std::max<std::size_t>(mesh.positions.size(), 1)));
  for (const auto& position : mesh.positions) positions = std::copy_n(position.data(), 3, positions);
  auto* corners = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t),
                              std::max<std::size_t>(mesh.triangles.size(), 1)));
  for (const auto& triangle : mesh.triangles) corners = std::copy_n(triangle.data(), 3, corners);
  return attach(scene_.get(), geometry);
}

std::uint32_t RayScene::add_sphere(const Eigen::Vector3f& centre, float radius) {
  RTCGeometry geometry = rtcNewGeometry(embree_device(), RTC_GEOMETRY_TYPE_SPHERE_POINT);
  auto* sphere = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 4 * sizeof(float), 1));
  std::copy_n(centre.data(), 3, sphere);
  sphere[3] = radius;
  return attach(scene_.get(), geometry);
}

std::uint32_t RayScene::add_instance(const RayScene& scene) {
  RTCGeometry instance = rtcNewGeometry(embree_device(), RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(instance, scene.scene_.get());
  return attach(scene_.get(), instance);
}

void RayScene::set_pose(std::uint32_t instance, const Eigen::Isometry3f& pose) {
  RTCGeometry geometry = rtcGetGeometry(scene_.get(), instance);
  const Eigen::Matrix<float, 3, 4> columns = pose.affine();
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
  rtcCommitGeometry(geometry);
}

void RayScene::commit() {
  with_default_floating_point([&] { rtcCommitScene(scene_.get()); });
}

namespace {

/// Fills all but the lengths of up to 16 rays, and returns how many there are.
std::size_t fill_packet(std::span<const Eigen::Vector3f> origins, std::span<const Eigen::Vector3f> directions,
                        RTCRay16& rays, std::span<int, ray_packet> valid) {
  const std::size_t count = std::min(origins.size(), ray_packet);
  for (std::size_t i = 0; i < ray_packet; ++i) {
    // Idle lanes hold the first ray: what is in them is looked at where packets go through instances.
    const std::size_t ray = i < count ? i : 0;
    valid[i] = i < count ? -1 : 0;
    rays.org_x[i] = origins[ray].x();
    rays.org_y[i] = origins[ray].y();
    rays.org_z[i] = origins[ray].z();
    rays.dir_x[i] = directions[ray].x();
    rays.dir_y[i] = directions[ray].y();
    rays.dir_z[i] = directions[ray].z();
    rays.tnear[i] = rays.time[i] = 0.0f;
    rays.id[i] = static_cast<unsigned>(i);
    rays.mask[i] = ~0u;
    rays.flags[i] = 0;
  }
  return count;
}

}  // namespace

std::uint32_t RayScene::unoccluded(std::span<const Eigen::Vector3f> points,
                                   std::span<const Eigen::Vector3f> directions,
                                   std::span<const float> distance, bool coherent) const {
  if (points.empty()) return 0;
  alignas(64) RTCRay16 rays;
  alignas(64) std::array<int, ray_packet> valid;
  const std::size_t count = fill_packet(points, directions, rays, valid);
  for (std::size_t i = 0; i < ray_packet; ++i) rays.tfar[i] = distance[i < count ? i : 0];
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcOccluded16(valid.data(), scene_.get(), &context, &rays);
  std::uint32_t free = 0;
  for (std::size_t i = 0; i < count; ++i) free |= static_cast<std::uint32_t>(rays.tfar[i] >= 0.0f) << i;
  return free;
}

bool RayScene::is_occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                           float length) const {
  RTCRay ray{origin.x(), origin.y(), origin.z(), 0.0f, direction.x(), direction.y(), direction.z(), 0.0f,
             length,     ~0u,        0,          0};
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene_.get(), &context, &ray);
  return ray.tfar < 0.0f;  // −∞ where something was hit
}

std::optional<FirstHit> RayScene::first_hit(const Eigen::Vector3f& origin,
                                            const Eigen::Vector3f& direction) const {
  RTCRayHit query{};
  query.ray = {.org_x = origin.x(),
               .org_y = origin.y(),
               .org_z = origin.z(),
               .tnear = 0.0f,
               .dir_x = direction.x(),
               .dir_y = direction.y(),
               .dir_z = direction.z(),
               .time = 0.0f,
               .tfar = std::numeric_limits<float>::infinity(),
               .mask = ~0u,
               .id = 0,
               .flags = 0};
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene_.get(), &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return FirstHit{query.hit.geomID,
                  query.hit.instID[0],
                  query.hit.primID,
                  query.hit.u,
                  query.hit.v,
                  query.ray.tfar,
                  {query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z}};
}

void RayScene::first_hits(std::span<const Eigen::Vector3f> origins,
                          std::span<const Eigen::Vector3f> directions,
                          std::span<std::optional<FirstHit>> hits) const {
  if (origins.empty()) return;
  RTCRayHit16 query;
  alignas(64) std::array<int, ray_packet> valid;
  const std::size_t count = fill_packet(origins, directions, query.ray, valid);
  for (std::size_t i = 0; i < ray_packet; ++i) {
    query.ray.tfar[i] = std::numeric_limits<float>::infinity();
    query.hit.geomID[i] = query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect16(valid.data(), scene_.get(), &context, &query);
  const RTCHit16& hit = query.hit;
  for (std::size_t i = 0; i < count; ++i) {
    hits[i].reset();
    if (hit.geomID[i] != RTC_INVALID_GEOMETRY_ID)
      hits[i] = FirstHit{hit.geomID[i],
                         hit.instID[0][i],
                         hit.primID[i],
                         hit.u[i],
                         hit.v[i],
                         query.ray.tfar[i],
                         {hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]}};
  }
}

namespace {

/// Rays start off their surface by so much of the scene's diagonal.
constexpr float offset_share = 2e-5f;
/// Embree's products of three edges of smaller meshes leave the range of float: at 1e-12 half of the light is
/// missed.
constexpr float least_size = 1e-9f;

}  // namespace

MeshRays::MeshRays(const Mesh& mesh) : mesh_(&mesh) {
  const Eigen::AlignedBox3f bounds = bounds_of(mesh);
  const float size = bounds.isEmpty() ? 0.0f : bounds.diagonal().norm();
  if (size > 0.0f && size < least_size)
    throw InputError("the mesh is ", size / least_size,
                     "e-9 units across, too small for rays in single precision; give it in larger units, or "
                     "a `size` in a scene's description");
  offset_ = offset_share * size;
  scene_.add_mesh(mesh);
  scene_.commit();
}

std::uint32_t MeshRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                   const Eigen::Vector3f& direction) const {
  std::array<Eigen::Vector3f, packet> directions;
  std::array<float, packet> distance;
  directions.fill(direction);
  distance.fill(std::numeric_limits<float>::infinity());
  return scene_.unoccluded(points, directions, distance, true);
}

std::uint32_t MeshRays::unoccluded(std::span<const Eigen::Vector3f> points,
                                   std::span<const Eigen::Vector3f> directions,
                                   std::span<const float> distance) const {
  return scene_.unoccluded(points, directions, distance, false);
}

std::optional<MeshHit> MeshRays::intersect(const Eigen::Vector3f& origin,
                                           const Eigen::Vector3f& direction) const {
  const auto hit = scene_.first_hit(origin, direction);
  if (!hit) return std::nullopt;
  return mesh_hit(*mesh_, *hit, direction);
}

MeshHit mesh_hit(const Mesh& mesh, const FirstHit& hit, const Eigen::Vector3f& direction) {
  const auto& triangle = mesh.triangles[hit.triangle];
  const Eigen::Vector3f a = mesh.positions[triangle[1]] - mesh.positions[triangle[0]];
  const Eigen::Vector3f b = mesh.positions[triangle[2]] - mesh.positions[triangle[0]];
  return {hit.triangle, {1.0f - hit.u - hit.v, hit.u, hit.v}, hit.distance, a.cross(b).dot(direction) < 0.0f};
}

}  // namespace refield::prt
