// SPDX-License-Identifier: Apache-2.0
// Caustics of punctual lights by progressive photon mapping: the light paths that trace/path_tracer.h cannot join.
//   L S+ (D|G) [any]* E     L: point, spot, directional. S: scattering by a delta lobe (mirror, smooth glass, straight through
//                           index 1), or a volume's boundary that changes nothing. (D|G): by any other lobe.
// Photons follow S events only and land on every surface with a non-delta lobe that they meet after the first S; camera paths
// (as the path tracer makes them, delta events, volumes and all) gather at every surface vertex with such a lobe. The path tracer
// has the rest: its last vertex before a delta light is lit by a shadow ray, which every surface stops, so no path is in both.
// Left out: photons that end inside a scattering volume (L S+ V). Paths have at most maxBounces + 1 events, both ends together.
//   estimate   radiance = sum f flux |n.w| / |Ng.w| / (pi r^2) over the photons within r whose surface has nearly the same
//              normal; mean over independent passes of radius r_i, r_{i+1}^2 = r_i^2 (i + alpha) / (i + 1), alpha = 2/3
//              (Knaus & Zwicker 2011, equation 20; Hachisuka & Jensen 2009): consistent; bias and noise fall by passes^(-1/3) both.
//   photons    flux weights: a refracted one is the radiance weight times eta^2 (bsdfFluxScale), shading normals by Veach 1997,
//              equation 5.19: |wi.n| |wo.Ng| / (|wi.Ng| |wo.n|). Where an interpolated normal faces away from one side only, it is
//              replaced there (trace/surface.h) and the pair is not adjoint.
//   dispersion one channel of three, three times as strong, from the first dispersive event, as the path tracer does; a
//              photon and a camera path may each have chosen.
// A pass depends only on (settings, pass), a sample only on (settings, pixel, its number, pass). Thread-safe.
#pragma once

#include <memory>

#include "base/task_arena.h"
#include "trace/path_tracer.h"
#include "trace/photon_map.h"

namespace gobo {
inline namespace trace {

struct CausticSettings {
  PathTracerSettings path;  ///< camera, size, bounces, block size, seed, groups; lights that are not delta lights are ignored
  uint32_t photons = 0;     ///< emitted per light and pass
  float radius = 0;         ///< of the first pass, metres
  bool byLobe = false;      ///< two slots a group: diffuse and specular lobe of the camera path's first event
  int slots() const { return path.groups * (byLobe ? 2 : 1); }
  void hash(Hasher& hasher) const;
};

/// Radius of pass 0, 1, ... O(pass).
float causticRadius(float first, uint32_t pass);

class CausticTracer {
 public:
  /// Null if `stop` fired first.
  static std::shared_ptr<const CausticTracer> create(const SceneView& view, AccelPtr accel, const CausticSettings& settings, const StopToken& stop = {});
  ~CausticTracer();
  /// Photons of one pass; null if `stop` fired. Adds the rays to `rays`.
  std::shared_ptr<const PhotonMap> emitPass(uint32_t pass, const TaskArena& arena, uint64_t& rays, const StopToken& stop = {}) const;
  /// Adds the SUM over camera samples of pixel (x, y) to out[slot*3 + channel], of any number of them; `map` is that of their pass of photons. Never adds
  /// a non-finite value: such samples count as zero and in `dropped`. `turn`: of how many more samples of the pixel the view samples have had their turns.
  void traceSamples(int x, int y, const SampleRun& run, const PhotonMap& map, double* out, uint64_t& rays, uint64_t& dropped, uint32_t turn = 0) const;
  struct Impl;

 private:
  CausticTracer();
  std::unique_ptr<Impl> impl_;
};

}  // namespace trace
}  // namespace gobo
