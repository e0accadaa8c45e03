// SPDX-License-Identifier: Apache-2.0
// A chunk: up to 16 samples of one pixel, or of a few neighbours, on their way together, a lane each, and the stages that carry them (path_stages.h runs
// them). Every stage is a member in a file of its own, path_stage_*.h, and inlined: a chunk takes 10 microseconds. They share this
// state and nothing else.
// A mask is a bit per lane.
#pragma once

#include "trace/path_lanes.h"
#include "trace/path_media.h"
#include "trace/path_sink.h"
#include "trace/straight.h"

namespace gobo {
inline namespace trace {

/// Who the lanes are.
struct ChunkLanes {
  uint32_t present = 0;      ///< lanes that there are
  int x[kLanes], y[kLanes];  ///< their pixels
  uint64_t film[kLanes];     ///< index of the sample over all blocks of its stream
};

template <PathSink Sink>
struct PathChunk {
  // What is traced, and where its light goes.
  const PathTracer::Impl& m;
  Sink& sink;
  const SampleSet& set;
  const ChunkLanes& who;
  uint64_t& rays;
  const bool lobes = Sink::kLobes || splitsLobes(m.settings.split);  // the first event's lobes are told apart
  const bool hasMedia = !m.surfaces.interiors().empty();
  // Light goes straight on through some surfaces. Shadow rays see through them, so the path's own rays keep the density that they
  // had at their last vertex: beyond the surface both strategies find the same light.
  const bool straight = m.surfaces.anyStraight();
  const bool freePasses = hasMedia || straight;
  const bool culls = m.passed.any();

  // From event to event.
  int events = 0;      // passes of the loop; a lane's scattering events: done()
  uint32_t alive = 0;  // lanes that have a ray
  uint32_t bad = 0;    // lanes that met something non-finite: their samples are dropped
  PathLanes paths;
  PathMedia media;
  RTCRayHit16 rh;  // the rays live here

  // Of one pass.
  uint32_t lambert = 0, general = 0;  // lanes at a surface, after meetLights(); they partition it
  uint32_t shadowed = 0, next = 0;    // lanes that have a shadow ray; that go on
  bool nee = false;                   // lights are asked
  bool rouletteOn = false;
  bool goesOn = false;                   // after the last event a ray can only find light
  alignas(64) float numbers[6][kLanes];  // by draw: light, direction, choice
  float* const ux = numbers[0];
  float* const uy = numbers[1];
  float* const px = numbers[2];
  float* const py = numbers[3];
  float* const choice = numbers[4];
  float* const lobe = numbers[5];
  alignas(64) float vx[kLanes], vy[kLanes], vz[kLanes], roulette[kLanes];
  RTCRay16 sr;  // at most one shadow ray a lane and event
  LaneSurface ls;
  lanes::LightLanes lamp;
  Lane3 lit, litSpecular;  // what a free shadow ray adds
  int litSlot[kLanes];
  int litEvent[kLanes];  // the scattering event that it is light of: the path's own ray may pass on meanwhile, which is none
  Lane3 litPlain;
  alignas(64) float shadowX[kLanes], shadowY[kLanes], shadowZ[kLanes], shadowReach[kLanes];
  alignas(64) int valid[kLanes];
  embree::Context context;
  BackFaces::Context cameraContext;

  PathChunk(const PathTracer::Impl& m, Sink& sink, const SampleSet& set, const ChunkLanes& who, uint64_t& rays)
      : m(m), sink(sink), set(set), who(who), rays(rays) {}

  // The stages. Reads and writes are said where they are defined.
  [[gnu::always_inline]] void startAtCamera();
  [[gnu::always_inline]] void intersect();
  [[gnu::always_inline]] void drawNumbers();
  [[gnu::always_inline]] void walkVolumes();
  [[gnu::always_inline]] void meetLights();
  [[gnu::always_inline]] void scatterAtSurfaces();
  [[gnu::always_inline]] void scatterAtLambert();
  [[gnu::always_inline]] void askAtLambert(uint32_t asking);
  [[gnu::always_inline]] void traceShadowRays();

  // What stages share.
  static PathClass classOf(int events, bool firstDelta) {
    return events == 0 ? PathClass::Emission : events == 1 && !firstDelta ? PathClass::Direct : PathClass::Indirect;
  }
  bool wanted(PathClass c) const { return has(m.settings.cover, c); }
  int done(int i) const { return events - paths.free[i]; }                                 // scattering events that lane i has behind it
  bool asks(int i) const { return done(i) == 0 ? m.wantDirect : m.wantIndirect; }          // for light at its next event
  PathClass classAt(int i) const { return classOf(done(i), paths.firstDelta >> i & 1u); }  // of light that its ray finds
  void found(int i, int k, const Vec3& direction, const Vec3& radiance, float t, uint32_t primitive);
  void collectAreaLights(int i, const Vec3& origin, const Vec3& direction, float tmax);

  /// Light that arrived after `events` scattering events; `specular` is the part by the first event's specular lobe. A non-finite part
  /// marks the lane, and nothing is handed over; each channel by itself, since the sum of three finite ones may overflow.
  void contribute(int lane, int slot, int events, PathClass c, const Vec3& value, Vec3 specular) {
    const bool splits = splitsLobes(m.settings.split) && c != PathClass::Emission;
    if (!isFinite(value) || (splits && !isFinite(specular))) {
      bad |= 1u << lane;
      return;
    }
    // Which samples are dropped is no matter of the sink.
    if constexpr (Sink::kLobes)
      if (!isFinite(specular)) specular = Vec3(0.0f);
    sink.contribute(lane, {slot, events, c, value, specular});
  }
  Vec3 specularOf(int i, const Vec3& value) const { return lobes ? value * paths.specularPart.get(i) : Vec3(0.0f); }

  // Vertices, for sinks that ask for them; otherwise these are empty.
  void vertex(int i, VertexKind kind, int event, const Vec3& position, const Vec3& normal) {
    if constexpr (Sink::kVertices) sink.vertex(i, {kind, event, position, normal});
  }
  void scatter(int i, const Vec3& direction, const Vec3& weight, const Vec3& specularPart, float pdf, bool delta, bool passed) {
    if constexpr (Sink::kVertices) sink.scatter(i, {direction, weight, specularPart, pdf, delta, passed});
  }
  /// The path ends where its ray met a triangle: at a light, an unlit surface, or with no event left.
  void endsAtHit(int i) {
    if constexpr (Sink::kVertices) {
      const Vec3 d = rayDirection(rh.ray, i);
      Vec3 n = m.accel->impl().worldNormal(hitInstance(rh.hit, i), Vec3(rh.hit.Ng_x[i], rh.hit.Ng_y[i], rh.hit.Ng_z[i]));
      n /= glm::length(n) * (glm::dot(n, d) > 0.0f ? -1.0f : 1.0f);
      vertex(i, VertexKind::Surface, done(i) + 1, rayOrigin(rh.ray, i) + d * rh.ray.tfar[i], n);
    }
  }
  void passesOn(int i, const Vec3& weight) {
    if constexpr (Sink::kVertices) scatter(i, rayDirection(rh.ray, i), weight, Vec3(0.0f), 0.0f, true, true);
  }
};

}  // namespace trace
}  // namespace gobo
