// SPDX-License-Identifier: Apache-2.0
#include "trace/accel.h"

#include <cstdlib>

#include "base/check.h"
#include "trace/accel_impl.h"
#include "trace/alpha_filter.h"
#include "trace/back_faces.h"

namespace gobo {
inline namespace trace {

namespace {

// Meshes shared by several instances become Embree instances when the copies would hold more triangles than this; below it
// copies trace faster (one level of hierarchy, no ray transform) and cost little memory.
constexpr size_t kMaxCopiedTriangles = 200'000;

RTCDevice device() {
  static const RTCDevice d = [] {
    const Result<std::string> kernels = Accel::kernels();
    GOBO_CHECK(kernels.ok());
    RTCDevice made = rtcNewDevice(("start_threads=0,set_affinity=0" + std::string(*kernels == "avx2" ? ",isa=avx2" : "")).c_str());
    GOBO_CHECK(made != nullptr);
    rtcSetDeviceErrorFunction(
        made,
        [](void*, RTCError code, const char* text) {
          if (code == RTC_ERROR_CANCELLED) return;  // a build that its stop token ended
          std::cerr << "Embree error " << int(code) << ": " << text << std::endl;
          std::abort();  // out of memory or a misuse: nothing sensible can follow
        },
        nullptr);
    return made;
  }();
  return d;
}

using AccelMesh = MeshView<kAccelFacets>;

RTCGeometry triangleGeometry(const AccelMesh& mesh, const std::vector<Vec3>& padded, AlphaGeometry* alpha) {
  RTCGeometry g = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, padded.data(), 0, sizeof(Vec3), mesh.positions.size());
  rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.indices.data(), 0, 12, mesh.triangles());
  rtcSetGeometryBuildQuality(g, RTC_BUILD_QUALITY_MEDIUM);
  if (alpha) {
    rtcSetGeometryUserData(g, alpha);
    rtcSetGeometryIntersectFilterFunction(g, alphaFilter);
    rtcSetGeometryOccludedFilterFunction(g, alphaFilter);
  }
  rtcCommitGeometry(g);
  return g;
}

RTCScene newScene() {
  RTCScene s = rtcNewScene(device());
  // Watertight: no ray slips between triangles that share an edge. Calls may bring a filter of their own (trace/back_faces.h).
  rtcSetSceneFlags(s, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | embree::kSceneFlagCallFilter));
  rtcSetSceneBuildQuality(s, RTC_BUILD_QUALITY_MEDIUM);
  return s;
}

/// Builds; false when `stop` fired, which Embree asks between its pieces of work.
bool commit(RTCScene scene, const StopToken& stop) {
  rtcSetSceneProgressMonitorFunction(
      scene, [](void* token, double) { return !static_cast<const StopToken*>(token)->stopRequested(); }, const_cast<StopToken*>(&stop));
  rtcCommitScene(scene);
  rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  return !stop.stopRequested();
}

float coordinateUnit(float largest) {
  if (!(largest > 0.0f) || !std::isfinite(largest)) return 1.0f;
  return std::ldexp(1.0f, std::ilogb(largest) + 1);
}

}  // namespace

Result<std::string> Accel::kernels() {
  static const Result<std::string> found = []() -> Result<std::string> {
    const char* asked = std::getenv("GOBO_EMBREE_ISA");
    const std::string isa = asked ? asked : "";
    if (isa == "avx2") return isa;
    if (!isa.empty())
      return invalidArgument("environment variable GOBO_EMBREE_ISA='" + isa + "': must be avx2, or empty for what the processor has", "GOBO_EMBREE_ISA");
    // All five parts of what Embree calls its ISA "avx512".
    const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd") &&
                      __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
    return std::string(wide ? "avx512" : "avx2");
  }();
  return found;
}

Accel::Accel() : impl_(std::make_unique<Impl>()) {}
Accel::~Accel() = default;
size_t Accel::bytes() const { return impl_->bytes; }
float Accel::unit() const { return impl_->unit; }
Vec3 Accel::reach() const { return impl_->reach; }
Vec3 Accel::reach(uint32_t instance) const { return impl_->instanceReach[instance]; }

Accel::Impl::~Impl() {
  if (scene) rtcReleaseScene(scene);
  for (RTCScene s : meshScenes)
    if (s) rtcReleaseScene(s);
}

std::shared_ptr<const Accel> Accel::build(const SceneView& view, const TaskArena& arena, const StopToken& stop) {
  auto accel = std::shared_ptr<Accel>(new Accel());
  Impl& impl = *accel->impl_;
  impl.meshes = view.keepMeshes();
  std::vector<AccelMesh> meshes;
  for (size_t m = 0; m < view.meshCount(); ++m) meshes.push_back(view.mesh<kAccelFacets>(int(m)));
  const std::vector<Instance>& instances = view.instances();

  std::vector<size_t> uses(meshes.size(), 0);
  for (const Instance& i : instances) ++uses[i.mesh];
  std::vector<AlphaGeometry*> alphaOf(meshes.size(), nullptr);
  for (size_t m = 0; m < meshes.size(); ++m) {
    if (uses[m] == 0) continue;
    const Coverage& c = view.coverage(meshes[m].material);
    if (c.mode == AlphaMode::Opaque) continue;
    auto a = std::make_unique<AlphaGeometry>();
    a->indices = meshes[m].indices.data();
    a->uv = &(*meshes[m].alphaUv)[size_t(c.texture.texcoord)];
    a->colours = meshes[m].alphaColours;
    a->ref = c.texture;
    a->mode = c.mode;
    a->cutoff = c.cutoff;
    a->factor = c.factor;
    if (c.texture.valid()) a->texture = view.textures()[c.texture.texture];
    alphaOf[m] = a.get();
    impl.alphas.push_back(std::move(a));
    impl.hasAlpha = true;
  }

  // World-space copies, in parallel over instances: disjoint writes. One element of padding: Embree reads 16 bytes a vertex.
  impl.instances.resize(instances.size());
  impl.worldPositions.resize(instances.size());
  std::vector<std::vector<Vec3>> objectPositions(meshes.size());
  const auto instanced = [&](size_t mesh) { return uses[mesh] > 1 && meshes[mesh].triangles() * (uses[mesh] - 1) > kMaxCopiedTriangles; };
  std::vector<float> largest(instances.size(), 0.0f);
  std::vector<Vec3>& reach = impl.instanceReach;
  reach.assign(instances.size(), Vec3(0.0f));
  const bool copied = arena.parallelFor(
      instances.size(), 1,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          const AccelMesh& mesh = meshes[size_t(instances[i].mesh)];
          InstanceGeometry& g = impl.instances[i];
          g.toWorld = instances[i].toWorld;
          const Mat3 linear(g.toWorld);
          const float det = glm::determinant(linear);
          g.mirrored = det < 0.0f;
          g.normalToWorld =
              Mat3(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]), glm::cross(linear[0], linear[1])) * (g.mirrored ? -1.0f : 1.0f);
          g.indices = mesh.indices.data();
          g.world = !instanced(instances[i].mesh);
          std::vector<Vec3>& out = impl.worldPositions[i];
          if (g.world) { out.reserve(mesh.positions.size() + 1); }
          const bool identity = g.toWorld == Mat4(1.0f);
          Vec3 world(0.0f), local(0.0f);
          for (const Vec3& p : mesh.positions) {
            const Vec3 q = identity ? p : Vec3(g.toWorld * Vec4(p, 1.0f));
            world = glm::max(world, glm::abs(q));
            local = glm::max(local, glm::abs(p));
            if (g.world) out.push_back(q);
          }
          largest[i] = std::fmax(world.x, std::fmax(world.y, world.z));
          reach[i] = g.world ? world : instanceReach(g.toWorld, local, world);
          if (g.world) {
            out.push_back(Vec3(0.0f));
            g.positions = out.data();
          }
        }
      },
      stop);
  if (!copied) return nullptr;
  float most = 0.0f;
  for (float l : largest) most = std::fmax(most, l);
  impl.unit = coordinateUnit(most);
  impl.reach = Vec3(0.0f);
  for (const Vec3& r : reach) impl.reach = glm::max(impl.reach, r);
  const auto usable = [](Vec3& r) {
    const float widest = std::fmax(r.x, std::fmax(r.y, r.z));
    if (!(widest > 0.0f) || !std::isfinite(widest)) r = Vec3(1.0f);  // nothing there, or nothing that could be asked for a step
  };
  usable(impl.reach);
  for (Vec3& r : reach) usable(r);

  impl.meshScenes.assign(meshes.size(), nullptr);
  bool complete = true;
  arena.execute([&] {
    for (size_t m = 0; m < meshes.size(); ++m) {
      if (!instanced(m)) continue;
      std::vector<Vec3>& padded = objectPositions[m];
      padded.assign(meshes[m].positions.begin(), meshes[m].positions.end());
      padded.push_back(Vec3(0.0f));
      impl.meshScenes[m] = newScene();
      RTCGeometry g = triangleGeometry(meshes[m], padded, alphaOf[m]);
      rtcAttachGeometryByID(impl.meshScenes[m], g, 0);
      rtcReleaseGeometry(g);
      if (!commit(impl.meshScenes[m], stop)) {
        complete = false;
        return;
      }
      impl.bytes += meshes[m].triangles() * 64 + padded.size() * sizeof(Vec3);
    }
    impl.scene = newScene();
    for (size_t i = 0; i < instances.size(); ++i) {
      const size_t m = size_t(instances[i].mesh);
      RTCGeometry g;
      if (instanced(m)) {
        impl.instances[i].positions = objectPositions[m].data();
        g = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(g, impl.meshScenes[m]);
        rtcSetGeometryTransform(g, 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, &instances[i].toWorld[0][0]);
        rtcCommitGeometry(g);
      } else {
        if (meshes[m].triangles() == 0) continue;
        g = triangleGeometry(meshes[m], impl.worldPositions[i], alphaOf[m]);
        impl.bytes += meshes[m].triangles() * 64 + impl.worldPositions[i].size() * sizeof(Vec3);
      }
      rtcAttachGeometryByID(impl.scene, g, unsigned(i));  // geometry id == index into Scene::instances
      rtcReleaseGeometry(g);
    }
    complete = commit(impl.scene, stop);
  });
  impl.objectPositions = std::move(objectPositions);  // a structure that was not finished is released with what it points to
  if (!complete) return nullptr;
  return accel;
}

bool Accel::intersect(const Ray& ray, Hit& hit, const BackFaces* passed) const {
  if (passed && !passed->any()) passed = nullptr;
  RTCRayHit r;
  r.ray.org_x = ray.origin.x;
  r.ray.org_y = ray.origin.y;
  r.ray.org_z = ray.origin.z;
  r.ray.dir_x = ray.direction.x;
  r.ray.dir_y = ray.direction.y;
  r.ray.dir_z = ray.direction.z;
  r.ray.tnear = ray.tmin;
  r.ray.tfar = ray.tmax;
  r.ray.time = 0;
  r.ray.mask = ~0u;
  r.ray.id = passed ? BackFaces::kPasses : 0;
  r.ray.flags = 0;
  r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  BackFaces::Context context;
  if (passed) passed->init(context);
  else embree::initContext(context.context);
  embree::intersect1(impl_->scene, context.context, r, false, passed ? BackFaces::filter : nullptr);
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
    hit.instance = kNoHit;
    return false;
  }
  hit.t = r.ray.tfar;
  hit.instance = r.hit.instID[0] == RTC_INVALID_GEOMETRY_ID ? r.hit.geomID : r.hit.instID[0];
  hit.primitive = r.hit.primID;
  hit.u = r.hit.u;
  hit.v = r.hit.v;
  hit.Ng = impl_->worldNormal(hit.instance, Vec3(r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z));
  return true;
}

void Accel::intersect16(const Ray* rays, int count, Hit* hits, const BackFaces* passed) const {
  RayPacket packet;
  HitPacket hit;
  for (int i = 0; i < RayPacket::kLanes; ++i) packet.set(i, rays[i < count ? i : 0]);
  intersect16(packet, count, hit, passed);
  for (int i = 0; i < count; ++i) hits[i] = hit.lane(i);
}

bool Accel::occluded(const Ray& ray) const {
  RTCRay r;
  r.org_x = ray.origin.x;
  r.org_y = ray.origin.y;
  r.org_z = ray.origin.z;
  r.dir_x = ray.direction.x;
  r.dir_y = ray.direction.y;
  r.dir_z = ray.direction.z;
  r.tnear = ray.tmin;
  r.tfar = ray.tmax;
  r.time = 0;
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
  embree::Context context;
  embree::initContext(context);
  embree::occluded1(impl_->scene, context, r);
  return r.tfar < 0.0f;
}

uint32_t Accel::occluded16(const Ray* rays, int count) const {
  alignas(64) RTCRay16 r;
  alignas(64) int valid[16];
  for (int i = 0; i < 16; ++i) {
    const Ray& ray = rays[i < count ? i : 0];
    valid[i] = i < count ? -1 : 0;
    r.org_x[i] = ray.origin.x;
    r.org_y[i] = ray.origin.y;
    r.org_z[i] = ray.origin.z;
    r.dir_x[i] = ray.direction.x;
    r.dir_y[i] = ray.direction.y;
    r.dir_z[i] = ray.direction.z;
    r.tnear[i] = ray.tmin;
    r.tfar[i] = ray.tmax;
    r.time[i] = 0;
    r.mask[i] = ~0u;
    r.id[i] = unsigned(i);
    r.flags[i] = 0;
  }
  embree::Context context;
  embree::initContext(context);
  embree::occluded16(valid, impl_->scene, context, r);
  uint32_t blocked = 0;
  for (int i = 0; i < count; ++i) blocked |= uint32_t(r.tfar[i] < 0.0f) << i;
  return blocked;
}

}  // namespace trace
}  // namespace gobo
