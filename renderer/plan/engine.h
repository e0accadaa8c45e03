// SPDX-License-Identifier: Apache-2.0
// Engine: scenes, store and planner behind one door. Takes requests, gives pictures with their plan. No network, no
// threads of its own (work runs on the caller's thread and the arena). Methods may be called from several threads.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/memory_ledger.h"
#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/render.pb.h"
#include "gobo/v1/service.pb.h"
#include "plan/scene_access.h"
#include "scene/loader.h"
#include "terms/dropped_samples.h"
#include "terms/term.h"

namespace gobo {
inline namespace base {
class ColorProcessor;  // base/color_config.h
}
}  // namespace gobo

namespace gobo {
inline namespace scene {
struct Scene;  // scene/scene.h
}
}  // namespace gobo

namespace gobo {
inline namespace plan {

class DisplayTransforms;  // plan/display_transforms.h
class RenderCheckpoints;  // plan/checkpoints.h
class TermStore;          // plan/store.h

struct EngineOptions {
  int threads = 0;                   ///< 0: all
  uint64_t storeBytes = 4ull << 30;  ///< RAM tier bound
  std::string cacheFolder;           ///< disk tier; empty: none
  uint64_t diskBytes = 16ull << 30;
  std::vector<std::string> roots;           ///< folders under which scene and environment files may be opened
  bool anyPath = false;                     ///< true for --local: the caller's own files
  uint32_t keepRenders = 1024;              ///< render ids remembered for Relight
  uint64_t keepRendersBytes = 64ull << 20;  ///< of the requests behind them
  uint64_t sceneBytes = UINT64_MAX;         ///< loaded scenes
  uint64_t environmentBytes = 2ull << 30;
  uint64_t accelBytes = 4ull << 30;
  uint64_t memoryBytes = UINT64_MAX;                 ///< of all that and what the owner adds to memory(), together
  std::function<void(const std::string& line)> say;  ///< told what of the cache folder was set aside; may be empty
  std::shared_ptr<SceneLoader> loader;  ///< reads scene and environment files (import/load.h, server/ingest_loader.h); null: there are built-in scenes alone
  std::shared_ptr<DisplayTransforms> displays;  ///< of request.encoding.display and view; null: there are none
};

/// One finished picture, linear and not tone mapped: a view of its term. image() copies it out once, on first use (a copy of
/// 11 MB costs more than the composite that made it); raw encodings read pixels() in place. One reader thread at a time.
class RenderedImage {
 public:
  RenderedImage(std::string outputName, TermPtr term, std::string plane, std::vector<std::string> channels);
  std::string output;
  int width() const;
  int height() const;
  int channels() const;
  const std::vector<std::string>& names() const { return names_; }
  std::span<const float> pixels() const;  ///< row-major, channels interleaved
  const Image& image() const;
  DroppedTotal dropped() const;  ///< samples that it lacks because a part of them was not finite

 private:
  TermPtr term_;
  std::string plane_;
  std::vector<std::string> names_;
  mutable std::shared_ptr<const Image> image_;
};

struct RenderResult {
  v1::RenderReply reply;                      ///< images[] left empty: encoding is the caller's (server/encode.h)
  std::vector<RenderedImage> images;          ///< in the order of the request's outputs
  std::map<std::string, std::string> tables;  ///< names behind ids that were asked for: "gobo:object_id" -> {"0":"floor",...}
  /// By output: what the EXR that holds it says of it beside these ("cryptomatte/f834d0a/manifest", ...).
  std::map<std::string, std::map<std::string, std::string>> attributes;
  std::map<std::string, Mat4> matrices;        ///< worldToCamera, worldToNDC (scene/camera.h)
  std::shared_ptr<const ColorProcessor> view;  ///< what reply.resolved.encoding names, for PNG and JPEG of radiance; null: its curve and transfer function
};

/// What earlier runs of a request that was preempted have spent and finished: request.halt.time_s is of all of them.
struct RunSoFar {
  double ms = 0;
  uint32_t spp = 0;  ///< of the last picture that was finished, which the store has
};

struct RenderControl {
  StopToken stop;
  std::function<void(const v1::Progress&)> progress;  ///< may be empty
  std::function<void(const RenderResult&)> snapshot;  ///< may be empty; progressive requests
  bool ladder = false;                                ///< snapshots begin with those of plan/ladder.h, if the request wants them (scheduling.ladder)
  double afterwardsMs = 0;                            ///< of request.halt.time_s, that whoever asked takes for what he does with the picture
  std::function<size_t()> waiting;                    ///< how many others wait for a first picture of theirs; may be empty: none
  std::shared_ptr<const Scene> scene;                 ///< rendered instead of what request.scene names now, if set
  RenderCheckpoints* checkpoints = nullptr;           ///< states to go on from and to be kept; may be null
  std::string owner;                                  ///< of the reply's render id: see relightRequest
  SceneAccess access;                                 ///< of whoever asks, to request.scene
  RunSoFar* soFar = nullptr;                          ///< read, and added to; null: there was no run before
};

/// Where a request's environment map comes from. Neither: request.environment.path.
struct EnvironmentSource {
  EnvironmentSource() = default;
  EnvironmentSource(std::string f) : file(std::move(f)) {}
  EnvironmentSource(EnvironmentPtr m) : map(std::move(m)) {}
  std::string file;    ///< behind request.environment.digest: a file with that SHA-256
  EnvironmentPtr map;  ///< loaded already, from what the request names
};

/// A request that may be run (Engine::prepare). Holds no scene and no memory but its own: it may wait in a queue.
struct PreparedRender {
  v1::RenderRequest request;           ///< as it came
  v1::RenderRequest resolved;          ///< every default filled in, for the scene of resolved.scene_hash
  uint64_t pinnedBytes = 0;            ///< upper bound of bytes of results held at once while it runs
  double expectedMs = 0;               ///< on an idle machine, with what the store has now; without its certificate; 0 where only time or error ends it
  bool small = false;                  ///< so little that it may run beside another render: it then has threads of its own (docs/operations.md)
  EnvironmentSource environment = {};  ///< must stay while this lives
};

class Engine {
 public:
  static Result<std::unique_ptr<Engine>> create(const EngineOptions& options);
  ~Engine();

  /// `stop` ends a load between its phases (Cancelled); nothing of it stays.
  Result<v1::SceneInfo> openScene(const std::string& source, const std::string& id, const StopToken& stop = {}, const SceneAccess& access = {},
                                  const std::vector<std::string>& share = {});
  /// A file that the caller received (upload), opened whatever the roots say; `source` is what inspect shows. `holds` stays while it is loaded.
  Result<v1::SceneInfo> openUploaded(const std::string& path, const std::string& source, const std::string& id, const StopToken& stop = {},
                                     const SceneAccess& access = {}, const std::vector<std::string>& share = {}, std::shared_ptr<const void> holds = nullptr);
  std::vector<v1::SceneInfo> listScenes(const SceneAccess& access = {}) const;
  Result<v1::SceneInfo> inspectScene(const std::string& id, const SceneAccess& access = {}) const;
  Result<v1::SceneInfo> patchScene(const v1::PatchSceneRequest& patch, const StopToken& stop = {}, const SceneAccess& access = {});
  Status unloadScene(const std::string& id, const SceneAccess& access = {});
  /// The scene that the id stands for now: for RenderControl.scene. Errors: NotFound.
  Result<std::shared_ptr<const Scene>> scene(const std::string& id) const;
  /// Loads a built-in or a file (under the roots, or `trusted`: wherever it is) without giving it an id.
  Result<std::shared_ptr<const Scene>> loadScene(const std::string& source, bool trusted) const;
  /// The file that a request's path stands for. Errors: PermissionDenied outside the roots, NotFound.
  Result<std::string> allowedPath(const std::string& path, const std::string& field) const;
  /// The map that the settings name, or null. Errors: what loading says; Cancelled.
  Result<EnvironmentPtr> mapOf(const v1::EnvironmentSettings& settings, const EnvironmentSource& source, const StopToken& stop) const;
  /// From now on files are opened under these folders only; loaded scenes stay.
  void setRoots(std::vector<std::string> roots);

  /// Validates and fills in every default without rendering. Errors name the field ("request.integrator.max_bounces").
  /// Fields that this build does not know are dropped.
  Result<v1::RenderRequest> resolve(const v1::RenderRequest& request, const SceneAccess& access = {}) const;
  /// Everything that can be found out about a request before it is admitted: whether it is one, and what it will hold. Runs no node, so traces
  /// no ray; it may load an environment and pose the scene, which `stop` ends (Cancelled). `scene`: prepared instead of what request.scene names.
  /// `environment`: see PreparedRender.
  Result<PreparedRender> prepare(const v1::RenderRequest& request, std::shared_ptr<const Scene> scene = nullptr, const StopToken& stop = {},
                                 const SceneAccess& access = {}, const EnvironmentSource& environment = {});
  /// What a render of it would do, without doing it: rows of nodes with expected time and rays, which results are there already, bytes. Where a
  /// node's result decides what follows (shadows.auto, lights for a map) the largest plan that it may choose.
  Result<v1::PlanReply> plan(const v1::RenderRequest& request, const StopToken& stop = {}, const SceneAccess& access = {},
                             const EnvironmentSource& environment = {});
  /// As render() of the request that it was prepared from.
  Result<RenderResult> run(const PreparedRender& prepared, const RenderControl& control = {});
  /// Runs to the halt condition. With control.snapshot set, emits snapshots at 1, 2, 4, ... blocks.
  /// Stopped: Cancelled, DeadlineExceeded, or Aborted when preempted (call again to go on where it stopped).
  Result<RenderResult> render(const v1::RenderRequest& request, const RenderControl& control = {});
  /// The request that `relight` means: that of the reply `render_id` (resolved, realised samples) with the masked fields replaced.
  /// `caller`: the owner that it was rendered for (RenderControl.owner); empty: whoever's. Errors: NotFound, also for another owner's.
  Result<v1::RenderRequest> relightRequest(const v1::RelightRequest& relight, const std::string& caller = {}) const;

  void dropCaches(bool disk, bool pinned = false);  ///< pinned terms stay unless `pinned`
  TermStore& terms();                               ///< what is kept; for lists, eviction by name, pins
  /// What holds memory; others may add to it before the first call. Caches give way when a render begins or ends and when a scene comes.
  MemoryLedger& memory();
  void fillStatus(v1::StatusReply& status) const;
  int threads() const;

 private:
  Engine();
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Display transform: exposure, curve, clamped to 0..1, still linear-light (PNG/JPEG encoders apply sRGB).
Image toneMapped(const Image& linear, const v1::ToneMap& settings);

/// "0.1.0+<git describe>".
std::string buildVersion();

}  // namespace plan
}  // namespace gobo
