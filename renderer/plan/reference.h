// SPDX-License-Identifier: Apache-2.0
// The truth that a certificate measures a picture against: single pixels of the effective scene, path traced with everything
// that the scene's light does, whatever the request leaves out of its picture: up to 64 events after the first with Russian
// roulette, indirect light, every light, and photons for the caustics of punctual lights (trace/photon_tracer.h) wherever the
// scene can have such light. Box pixel filter. What no estimator here reaches is named by classesNotCovered (plan/planner.h).
#pragma once

#include <array>
#include <atomic>
#include <optional>

#include "gobo/v1/render.pb.h"
#include "measure/parts.h"
#include "request/effective_scene.h"
#include "trace/accel.h"
#include "trace/path_tracer.h"

namespace gobo {
inline namespace plan {

/// What a reference consists of. Two traces of one recipe are independent where seed or stream differ.
struct ReferenceRecipe {
  uint64_t seed = 0;                                 ///< never that of the render
  std::array<uint32_t, kParts> streams{0, 1, 2, 3};  ///< of the parts (trace/path_tracer.h, kBlocksPerStream)
  int maxBounces = 64;
  uint32_t photons = 0;  ///< per punctual light and pass of 16 samples; 0: the scene has no caustics of such lights
  float radius = 0;      ///< of the first pass, metres
};

/// The recipe of a request's certificate: depends on the scene, certificate.seed and the size of the caustics' photons alone,
/// on nothing else that the request leaves out of its picture.
ReferenceRecipe referenceRecipe(const EffectiveScene& effective, const v1::RenderRequest& request);

class ReferenceTracer {
 public:
  /// `effective`, `accels` and `arena` must outlive it. Where `stop` fired first, trace() says Cancelled.
  ReferenceTracer(const EffectiveScene& effective, int width, int height, const ReferenceRecipe& recipe, AccelCache& accels, const TaskArena& arena,
                  const StopToken& stop = {});
  ReferenceTracer(const ReferenceTracer&) = delete;
  ReferenceTracer& operator=(const ReferenceTracer&) = delete;
  static constexpr int kBlockSize = 16;
  /// Mean radiance of the pixels (y * width + x) over `blocks` blocks of 16 samples of one stream. Adds the rays to `rays`.
  /// Errors: Cancelled.
  Result<std::vector<Vec3>> trace(const std::vector<uint32_t>& pixels, uint32_t stream, uint32_t blocks, std::atomic<uint64_t>& rays,
                                  const StopToken& stop = {}) const;

 private:
  void addBlock(int x, int y, uint32_t block, DVec3& sum, uint64_t& rays, uint64_t& dropped) const;

  PathTracerSettings settings_;
  ReferenceRecipe recipe_;
  std::vector<int> lights_;
  SceneView view_;
  AccelCache& accels_;
  const TaskArena& arena_;
  std::shared_ptr<const PathTracer> tracer_;  // null: stopped
  // Another background than the environment (request/background.h): by the same samples, what the camera sees of the environment, and what it sees instead.
  std::vector<int> hiddenLights_, shownLights_;
  std::optional<SceneView> hiddenView_, shownView_;
  std::shared_ptr<const PathTracer> hidden_, shown_;
};

}  // namespace plan
}  // namespace gobo
