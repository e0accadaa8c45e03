// SPDX-License-Identifier: Apache-2.0
// Plans one light's shadow technique into a graph and runs it node by node, each node timed on its own: what a first frame costs, split
// by pass. Depth maps and depth bounds are kept between measurements (with their times), because many techniques share them.
#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <string>

#include "filters/shadow_map/techniques.h"
#include "trace/accel.h"

namespace gobo::shadowbench {

/// Milliseconds by pass. depth: light_depth_map; encode: shadow_encode; filter: what else is in light space (mip chains, tables, depth bounds);
/// lookup: the rest, rays included; view: further view samples beyond the first (rays that supersample the camera).
struct Passes {
  double depth = 0, encode = 0, filter = 0, lookup = 0, view = 0;
  double map() const { return depth + encode + filter; }
  double total() const { return map() + lookup + view; }
};

struct Measured {
  Passes ms;
  size_t bytes = 0;      ///< of all terms in light space
  size_t mapBytes = 0;   ///< of the one that the lookup reads: the filtered map with its levels
  double rays = 0;       ///< per pixel, shadow and depth rays
  TermPtr term;          ///< plane V, perhaps flags
  std::vector<float> V;  ///< one a pixel
};

double median(std::vector<double> v);

class Runner {
 public:
  enum class Clock { Wall, Cpu };
  Runner(ScenePtr scene, int light, const Camera& camera, int width, int height, int repeat, Clock clock);

  const ScenePtr& scene() const { return scene_; }
  int light() const { return light_; }
  int width() const { return width_; }
  int height() const { return height_; }
  size_t pixels() const { return size_t(width_) * size_t(height_); }
  const Camera& camera() const { return camera_; }
  const TaskArena& arena() const { return arena_; }
  AccelCache& accels() { return accels_; }
  void setRepeat(int n) { repeat_ = n; }
  void setCameraFit(bool on) { cameraFit_ = on; }  ///< of every technique with a map
  int repeat() const { return repeat_; }
  double now() const;  ///< ms of the clock that measurements use

  /// G-buffer of a camera; `ms` gets its time.
  TermPtr gbuffer(const Camera& camera, int viewSamples = 1, double* ms = nullptr);
  /// The camera shifted by (dx, dy) pixels.
  Camera shifted(double dx, double dy) const;

  bool supported(const v1::ShadowTechnique& t) const;
  /// Errors: those of planning and running.
  Result<Measured> measure(const v1::ShadowTechnique& t, uint64_t seed = 1);
  using Plan = std::function<Result<NodeId>(Graph&, const ShadowInput&)>;
  Result<Measured> measure(const Plan& plan, uint64_t seed);  ///< of what is not in the schema
  /// Ray-traced visibility with `samples` view samples of one ray each, averaged over the pixel where the light can shine.
  Result<Measured> supersampled(int samples);
  /// Term "depth_bounds" (level 0: the depth map) of the technique's map settings, and how it was planned.
  Result<TermPtr> depthBounds(const v1::ShadowTechnique& t, int rim, PlannedShadowMap& planned);
  const TermPtr& gbuffer() const { return gbuffer_; }
  /// V under cameras shifted to `count` places inside the pixel; what does not depend on the camera runs once. visit(k, V).
  Status jittered(const v1::ShadowTechnique& t, int count, const std::function<void(int, const std::vector<float>&)>& visit);
  static Vec2 jitter(int k);  ///< place k, in pixels from the centre

 private:
  struct Kept {
    TermPtr term;
    double ms = 0;
  };
  using Keep = std::map<Hash128, Kept>;
  v1::ShadowTechnique fitted(v1::ShadowTechnique t) const;
  Result<TermPtr> evaluate(const Graph& graph, NodeId wanted, int repeat, Keep* keep, Measured* m);
  Result<Measured> run(const v1::ShadowTechnique& t, const TermPtr& gbuffer, const Camera& camera, int viewSamples, uint64_t seed, int repeat, Keep* keep);
  Result<Measured> run(const Plan& plan, const TermPtr& gbuffer, const Camera& camera, int viewSamples, uint64_t seed, int repeat, Keep* keep);

  ScenePtr scene_;
  int light_, width_, height_, repeat_;
  bool cameraFit_ = false;
  Clock clock_;
  Camera camera_;
  TaskArena arena_{0};
  AccelCache accels_;
  TermPtr gbuffer_;
  std::vector<TermPtr> jittered_;               // G-buffers of the places in the pixel: every technique walks them
  std::list<std::pair<Hash128, Kept>> shared_;  // depth maps and bounds, most recent first
  size_t sharedBytes_ = 0;
};

}  // namespace gobo::shadowbench
