// SPDX-License-Identifier: Apache-2.0
// The inside of PathTracer: flat tables made once. The kernel that reads them carries up to 16 samples of one pixel together, event
// by event (path_chunk.h): Embree gets packets, Lambert shading runs in vector registers (lambert_lanes.h), other
// materials lane by lane.
#pragma once

#include <optional>
#include <vector>

#include "trace/accel_impl.h"
#include "trace/area_light_bvh.h"
#include "trace/back_faces.h"
#include "trace/path_tracer.h"
#include "trace/plain_mesh_light.h"
#include "trace/sample_set.h"
#include "trace/surface.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace trace {

/// Rays as they were traced, for the bench. Not thread-safe: record on one thread.
struct RayRecorder {
  std::vector<Ray> primary, bounce, shadow;
};

struct PathMedia;

/// Weight of a sample of density a where another strategy has density b (Veach 1997, beta = 2).
inline float powerHeuristic(float a, float b) {
  if (!(b > 0.0f)) return 1.0f;
  const float r = b / a;  // a^2 / (a^2 + b^2) without squares that leave float's range
  return 1.0f / (1.0f + r * r);
}

struct PathTracer::Impl {
  PathTracerSettings settings;
  AccelPtr accel;
  RTCScene scene = nullptr;
  SurfaceTable surfaces;
  LightSelector selector;
  std::shared_ptr<const LightSampler> sampler;

  struct LightInfo {
    int light = 0;
    int slot = 0;
    LightKind kind = LightKind::Point;
    Vec3 nominal{0.0f};
    bool seenByCamera = true;
  };
  std::vector<LightInfo> lights;  // by k
  std::vector<int> meshLight;     // by instance: k, -1 for none
  std::vector<int> environments;  // k of what a ray finds that leaves the scene: maps, suns of some size
  std::vector<int> areaLights;    // k of Rect, Disk, Sphere
  std::vector<LightShape> areaShapes;
  std::vector<float> areaX, areaY, areaZ, areaRadius2;  // bounding spheres of areaLights
  AreaLightBvh areaBvh;                                 // the same lights, by k
  mutable size_t areaBvhFrom = 9;                       // asked from so many lights on; fewer are faster one by one. The picture does not depend on it
  PlainMeshLight plainLight;                            // the only light, if it is an untextured opaque mesh
  bool hasPlainLight = false;
  int plainLightIndex = -1;
  bool hittable = false;  // some light can be reached by a ray
  bool wantEmission = true, wantDirect = true, wantIndirect = true;
  int slotCount = 1, perGroup = 1;
  int maxEvents = 9;                      // scattering events a path may have
  bool onlyUnlit = false;                 // no light, but unlit surfaces to show
  MediumStack cameraMedia{};              // volumes around the camera
  BackFaces passed;                       // by rays of the camera that went straight on
  mutable std::vector<char> mediaLights;  // by interior: scattering events ask for lights. The mean does not depend on it where a ray can hit them
  // Camera rays as affine functions of the film position.
  Vec3 cameraOrigin{0.0f}, cameraOriginX{0.0f}, cameraOriginY{0.0f}, cameraDirection{0.0f}, cameraDirectionX{0.0f}, cameraDirectionY{0.0f};
  std::optional<FilmRays> panorama;  // whose rays are no affine functions
  std::optional<ThinLens> lens;      // the camera has one
  bool clips = false;                // the camera has clipping planes
  std::vector<Vec2> viewSamples;
  mutable RayRecorder* recorder = nullptr;

  void prepareCamera();
  /// The camera's ray through a film position and, with a lens, a point of its unit disk; unit direction. With clipping planes it begins at the near one;
  /// `reach`: from there to the far one.
  void startAtFilm(float fx, float fy, const Vec2& onLens, Vec3& origin, Vec3& direction, float& reach) const {
    reach = CameraOptics::kNoEnd;
    float slant = 1.0f;  // way along the ray per metre along the axis
    if (panorama) {
      const Ray ray = panorama->at(fx, fy);
      origin = ray.origin;
      direction = ray.direction;
    } else {
      origin = cameraOrigin + cameraOriginX * fx + cameraOriginY * fy;
      direction = cameraDirection + cameraDirectionX * fx + cameraDirectionY * fy;
      if (lens) lens->bend(onLens, origin, direction);
      const float square = glm::dot(direction, direction);
      if (clips) slant = std::sqrt(square);
      direction *= 1.0f / std::sqrt(square);
    }
    if (!clips) return;
    const CameraOptics& o = settings.camera.optics;
    origin += direction * (o.clipNear * slant);
    if (o.clipFar < CameraOptics::kNoEnd) reach = (o.clipFar - o.clipNear) * slant;
  }
  /// Of sample `film` of a pixel of the whole picture that is traced at view samples.
  Vec2 lensOfViewSample(int x, int y, uint64_t film) const {
    const size_t S = viewSamples.size();
    return viewSampleLens(int(film % S), int(S), uint64_t(y) * uint64_t(settings.width) + uint64_t(x));
  }
  bool prepareLights(const SceneView& view, const StopToken& stop);  // false: stopped
  void prepareMedia(const SceneView& view, const StopToken& stop);
  /// Light of one light that lane i's scattering event at p turns into its path; d: direction of arrival. Weighted against the phase
  /// function's own sampling where a ray can hit that light.
  Vec3 scatteredLight(const PathMedia& media, int i, const Vec3& p, const Vec3& d, const Vec3& beta, uint64_t draw, int& slot, uint64_t& rays) const;
  /// Shadow rays in scenes where light goes straight on through surfaces (trace/straight.h): what is left of it by lane, tfar -1
  /// where that is nothing. around: volumes at their starts by lane, or null.
  void throughPanes(uint32_t lanes, RTCRay16& r, const MediumStack* around, Vec3* left, uint64_t& rays) const;
};

}  // namespace trace
}  // namespace gobo
