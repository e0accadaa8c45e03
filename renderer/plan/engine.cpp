// SPDX-License-Identifier: Apache-2.0
#include "plan/engine.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>

#include "base/right_of_way.h"
#include "filters/shadow_technique.h"
#include "plan/auto_exposure.h"
#include "plan/certify_picture.h"
#include "plan/cryptomatte.h"
#include "plan/describe_unrun.h"
#include "plan/disk_store.h"
#include "plan/display_transforms.h"
#include "plan/executor.h"
#include "plan/known_errors.h"
#include "plan/ladder.h"
#include "plan/mapped_guard.h"
#include "plan/outliers.h"
#include "plan/outputs.h"
#include "plan/picture_warnings.h"
#include "plan/planner.h"
#include "plan/remembered_renders.h"
#include "plan/scene_library.h"
#include "plan/store.h"
#include "plan/window.h"
#include "request/curves.h"
#include "request/expressions.h"
#include "request/request.h"
#include "request/shutter.h"
#include "request/styles.h"
#include "scene/studio.h"
#include "trace/accel.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

using Clock = std::chrono::steady_clock;
double msSince(Clock::time_point t) { return std::chrono::duration<double, std::milli>(Clock::now() - t).count(); }

/// A plan that takes at most so long on an idle machine is a small one. Beside another render it takes about twice as long.
constexpr double kSmallMs = 100;
/// The most samples a pixel gets when only time or error bounds the request.
constexpr uint32_t kMaxSpp = 65536;
/// More samples have stopped lowering the error: eight times as many took off less than a tenth, where noise would lose 65 %, so what is
/// left is bias (docs/certificate.md, "Stopping on error").
class ErrorFloor {
 public:
  /// One certificate after every doubling. True if the bound is out of reach.
  bool reached(const v1::Certificate& c, double bound) {
    rmse_.push_back(c.rmse());
    return rmse_.size() > 3 && c.rmse_low() > 1.05 * bound && c.rmse() > 0.9 * rmse_[rmse_.size() - 4];
  }

 private:
  std::vector<double> rmse_;
};

/// What two pictures of one render say about the noise of the later: with n samples a pixel and then k more, a mean square difference of
/// k / (n (n + k)) of a sample's variance is expected. Owen-scrambled sequences are even more alike, so it is a little too much.
class NoiseOfPicture {
 public:
  /// Root of the mean variance over pixels and channels of the beauty that has `samples` now; 0 where there is nothing to compare.
  double after(const std::vector<RenderedImage>& images, uint32_t samples) {
    const auto beauty = std::find_if(images.begin(), images.end(), [](const RenderedImage& i) { return i.output == "beauty"; });
    if (beauty == images.end()) return 0;
    double error = 0;
    if (last_ && samples > samples_) {
      const std::span<const float> now = beauty->pixels(), then = last_->pixels();
      double sum = 0;
      for (size_t i = 0; i < now.size(); ++i) sum += (double(now[i]) - double(then[i])) * (double(now[i]) - double(then[i]));
      const double n = samples_, k = samples - samples_;
      error = std::sqrt(sum / double(std::max<size_t>(now.size(), 1)) * n / k);
    }
    last_ = *beauty;
    samples_ = samples;
    return std::isfinite(error) ? error : 0;
  }

 private:
  std::optional<RenderedImage> last_;
  uint32_t samples_ = 0;
};

/// Requests beyond this many view samples are refused before any work (16384^2 at one view sample is below it).
constexpr uint64_t kMaxViewSamples = 1ull << 29;

}  // namespace

RenderedImage::RenderedImage(std::string outputName, TermPtr term, std::string plane, std::vector<std::string> channels)
    : output(std::move(outputName)), term_(std::move(term)), plane_(std::move(plane)), names_(std::move(channels)) {}
int RenderedImage::width() const { return term_->extent().width; }
int RenderedImage::height() const { return term_->extent().height; }
int RenderedImage::channels() const { return term_->channels(plane_); }
DroppedTotal RenderedImage::dropped() const { return droppedTotal(*term_); }
std::span<const float> RenderedImage::pixels() const { return term_->floats(plane_); }
const Image& RenderedImage::image() const {
  if (!image_) {
    auto copy = std::make_shared<Image>();
    copy->width = width();
    copy->height = height();
    copy->channels = channels();
    copy->names = names_;
    copy->data.assign(pixels().begin(), pixels().end());
    image_ = copy;
  }
  return *image_;
}

/// What a request would hold and take, before anything of it runs.
struct Expected {
  uint64_t pinnedBytes = 0;
  double ms = 0;         ///< on an idle machine, with what the store has; 0 where only time or error ends it
  bool expands = false;  ///< some of its plan depends on results
};

struct Engine::Impl {
  explicit Impl(const EngineOptions& o)
      : options(o),
        arena(o.threads, TaskArena::Threads::Shared, &way),
        besideArena(o.threads, TaskArena::Threads::Own, &way),
        scenes(o.roots, o.anyPath, o.loader, {o.sceneBytes, o.environmentBytes}),
        extensions(o.storeBytes / 2),
        accels(o.accelBytes),
        memory(o.memoryBytes) {
    if (!options.displays) options.displays = std::make_shared<DisplayTransforms>(DisplayTransforms::Options{});  // refuses what asks for one
  }

  EngineOptions options;
  RightOfWay way;
  TaskArena arena;
  TaskArena besideArena;  ///< of small renders (PreparedRender)
  SceneLibrary scenes;
  LastSky lastSky;
  PosedScenes posed;
  std::unique_ptr<TermStore> store;
  ExtensionIndex extensions;
  WorkInFlight inFlight;
  AccelCache accels;
  MemoryLedger memory;
  Clock::time_point started = Clock::now();
  std::atomic<uint64_t> renders{0};

  RungPace pace;
  KnownErrors knownErrors;
  KnownTimes knownTimes;
  RememberedRenders remembered{options.keepRenders, options.keepRendersBytes};
  std::vector<std::shared_ptr<const MemoryHolder>> accounts;

  const TaskArena& arenaOf(bool small) const { return small ? besideArena : arena; }
  ExecutorServices executorServices(const MappedGuard& guard, bool small, const std::string& scene) {
    ExecutorServices s{store.get(), &extensions, &accels, &arenaOf(small), nullptr, &inFlight, &guard, &knownTimes};
    s.scene = scene;
    return s;
  }
  Result<EnvironmentPtr> mapOf(const v1::EnvironmentSettings& e, const EnvironmentSource& source, const StopToken& stop) {
    if (source.map) return source.map;
    if (!e.has_digest()) return scenes.environment(e.path(), stop);
    if (!source.file.empty()) return scenes.environmentOf(e.digest(), source.file, stop);
    return notFound("request.environment.digest = '" + e.digest() + "': nobody keeps files by their digest here", "request.environment.digest");
  }
  PlannerServices plannerServices(const std::string& sceneId, const StopToken& stop, MappedGuard& guard, const EnvironmentSource& environment, bool small,
                                  std::map<NodeId, ExecutedNode>* expanded = nullptr) {
    PlannerServices s;
    s.loadEnvironment = [this, stop, &guard, environment](const v1::EnvironmentSettings& e) -> Result<EnvironmentPtr> {
      GOBO_ASSIGN(EnvironmentPtr map, mapOf(e, environment, stop));
      guard.add(*map, e.has_digest() ? e.digest() : e.path());
      return map;
    };
    s.stop = stop;
    s.lastSky = &lastSky;
    s.poseScene = [this](const ScenePtr& base, const v1::RenderRequest& request, const StopToken& until) { return posed.get(base, request, until); };
    s.expand = [this, sceneId, stop, expanded, small, &guard](const Graph& graph, NodeId node) -> Result<TermPtr> {
      Executor executor(graph, executorServices(guard, small, sceneId), stop);
      executor.asks(std::array{node});
      GOBO_ASSIGN(TermPtr term, executor.evaluate(node));
      for (NodeId id = 0; expanded && id <= node; ++id) {  // and what it took
        const ExecutedNode e = executor.report(id);
        if (id == node || e.state == ExecutedNode::State::Run) (*expanded)[id] = e;
      }
      return term;
    };
    return s;
  }

  /// What is dear to make again, or whose going is seen, gives last.
  void keepAccounts() {
    accounts.push_back(
        memory.add({"posed scenes", [this] { return posed.limit(); }, [this] { return posed.bytes(); }, [this](uint64_t most) { posed.shrink(most); }}));
    accounts.push_back(
        memory.add({"terms", [this] { return store->maxBytes(); }, [this] { return store->bytes(); }, [this](uint64_t most) { store->shrink(most); }}));
    accounts.push_back(memory.add({"ray tracing", [this] { return options.accelBytes; }, [this] { return uint64_t(accels.bytes()); },
                                   [this](uint64_t most) { accels.shrink(size_t(most)); }}));
    accounts.push_back(memory.add({"stopped renders", [this] { return extensions.parkedLimit(); }, [this] { return extensions.parkedBytes(); },
                                   [this](uint64_t most) { extensions.shrinkParked(most); }}));
    accounts.push_back(
        memory.add({"environments", [this] { return scenes.limits().environmentBytes; }, [this] { return scenes.environmentBytes() + lastSky.bytes(); },
                    [this](uint64_t most) {
                      lastSky.drop();
                      scenes.shrinkEnvironments(most);
                    }}));
    accounts.push_back(memory.add({"scenes", [this] { return scenes.limits().sceneBytes; }, [this] { return scenes.sceneBytes(); },
                                   [this](uint64_t most) { scenes.shrinkScenes(most); }, [this] { return scenes.sceneBytesOfOwners(); }}));
    accounts.push_back(memory.add({"remembered requests",
                                   [this] { return remembered.limit(); },
                                   [this] { return remembered.bytes(); },
                                   {},
                                   [this] { return remembered.bytesOfOwners(); }}));
    scenes.setLedger(&memory);
  }
  Result<v1::RenderRequest> resolve(const v1::RenderRequest& request, const ScenePtr& scene) const;
  Result<RenderResult> run(const PreparedRender& prepared, const RenderControl& control);
  Result<Expected> expect(const ScenePtr& scene, const v1::RenderRequest& resolved, const EnvironmentSource& environment, const StopToken& stop,
                          bool ahead = false);
  /// Of `spp` samples. Fewer than `most` are a rung, which has no certificate, unless nothing takes more: that is the picture of `most` at once.
  Result<RenderResult> renderOnce(const ScenePtr& scene, const PreparedRender& prepared, const v1::RenderRequest& request, uint32_t spp, uint32_t most,
                                  const RenderControl& control, Clock::time_point start, MappedGuard& guard, bool& extendable);
  /// What `result` is worth when files under it may have broken meanwhile: they and what looks into them are dropped then.
  Status checked(const MappedGuard& guard, const Status& result);
  static void describe(const Plan& plan, const v1::RenderRequest& request, RenderResult& result);
  void fillReports(const Plan& plan, Executor& executor, const std::map<NodeId, ExecutedNode>& expanded, v1::RenderReply& reply) const;
};

Engine::Engine() = default;
Engine::~Engine() = default;

Result<std::unique_ptr<Engine>> Engine::create(const EngineOptions& options) {
  GOBO_TRY(Accel::kernels().status());
  std::unique_ptr<Engine> engine(new Engine);
  engine->impl_ = std::make_unique<Impl>(options);
  std::unique_ptr<DiskStore> disk;
  if (!options.cacheFolder.empty()) {
    DiskStoreOptions onDisk;
    onDisk.maxBytes = options.diskBytes;
    onDisk.say = options.say;
    GOBO_ASSIGN(disk, DiskStore::open(options.cacheFolder, onDisk));
  }
  engine->impl_->store = std::make_unique<TermStore>(options.storeBytes, std::move(disk));
  engine->impl_->keepAccounts();
  return engine;
}

Result<v1::SceneInfo> Engine::openScene(const std::string& source, const std::string& id, const StopToken& stop, const SceneAccess& access,
                                        const std::vector<std::string>& share) {
  return impl_->scenes.open(source, id, stop, access, share);
}
Result<v1::SceneInfo> Engine::openUploaded(const std::string& path, const std::string& source, const std::string& id, const StopToken& stop,
                                           const SceneAccess& access, const std::vector<std::string>& share, std::shared_ptr<const void> holds) {
  return impl_->scenes.openFile(path, source, id, stop, access, share, std::move(holds));
}
std::vector<v1::SceneInfo> Engine::listScenes(const SceneAccess& access) const { return impl_->scenes.list(access); }
Result<v1::SceneInfo> Engine::inspectScene(const std::string& id, const SceneAccess& access) const {
  GOBO_ASSIGN(v1::SceneInfo info, impl_->scenes.inspect(id, access));
  if (const Result<ScenePtr> scene = impl_->scenes.find(id, {}, access); scene.ok()) {
    const std::vector<int> none;
    info.set_bvh_ms(impl_->accels.buildMs(SceneView(**scene, Facet::All, none)));
  }
  return info;
}
Result<v1::SceneInfo> Engine::patchScene(const v1::PatchSceneRequest& patch, const StopToken& stop, const SceneAccess& access) {
  return impl_->scenes.patch(patch, stop, access);
}
Status Engine::unloadScene(const std::string& id, const SceneAccess& access) { return impl_->scenes.unload(id, access); }
Result<ScenePtr> Engine::scene(const std::string& id) const { return impl_->scenes.find(id); }
Result<ScenePtr> Engine::loadScene(const std::string& source, bool trusted) const { return impl_->scenes.load(source, trusted); }
Result<std::string> Engine::allowedPath(const std::string& path, const std::string& field) const { return impl_->scenes.allowedPath(path, field); }
Result<EnvironmentPtr> Engine::mapOf(const v1::EnvironmentSettings& settings, const EnvironmentSource& source, const StopToken& stop) const {
  return impl_->mapOf(settings, source, stop);
}
void Engine::setRoots(std::vector<std::string> roots) { impl_->scenes.setRoots(std::move(roots)); }
int Engine::threads() const { return impl_->arena.threads(); }

Result<v1::RenderRequest> Engine::Impl::resolve(const v1::RenderRequest& request, const ScenePtr& scene) const {
  v1::RenderRequest r = request;
  r.DiscardUnknownFields();  // remembered with the request they would be memory that nothing bounds
  for (const auto& [path, curve] : r.curves())
    if (r.expressions().contains(path))
      return invalidArgument("request.expressions." + path + ": request.curves has the same field; leave out one of them", "request.expressions." + path);
  GOBO_TRY(applyCurves(r));
  GOBO_TRY(applyExpressions(r));
  r.mutable_integrator();
  r.mutable_tone_map();
  r.mutable_encoding();
  r.mutable_scheduling();
  if (!hasLamp(*scene)) r.mutable_environment();  // its `default` may light it
  GOBO_TRY(resolveStyles(r));
  if (!r.has_shadows() || r.shadows().technique_case() == v1::ShadowTechnique::TECHNIQUE_NOT_SET) r.mutable_shadows()->mutable_path_traced();
  if (r.has_denoise() && r.denoise().filter_case() == v1::Denoise::FILTER_NOT_SET && !r.denoise().has_outliers()) r.mutable_denoise()->mutable_auto_();
  if (r.denoise().has_outliers() && r.denoise().outliers().method_case() == v1::OutlierRejection::METHOD_NOT_SET)
    r.mutable_denoise()->mutable_outliers()->mutable_path_density();
  if (!r.has_halt() || (!r.halt().has_spp() && !r.halt().has_time_s() && !r.halt().has_error())) r.mutable_halt()->set_spp(64);
  if (r.outputs_size() == 0) r.add_outputs("beauty");
  if (r.has_certificate() && r.certificate().has_pixel_fraction() && r.certificate().pixel_fraction() == 0) r.clear_certificate();
  if (r.halt().has_error()) r.mutable_certificate();  // what the halt condition is measured by
  // The map's settings are shown resolved wherever a technique reads them.
  const auto showMap = [](v1::ShadowTechnique& t) {
    const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
    if (entry && (entry->usesMap || t.has_auto_())) t.mutable_map();
  };
  showMap(*r.mutable_shadows());
  for (auto& [name, light] : *r.mutable_lights())
    if (light.has_shadow()) showMap(*light.mutable_shadow());
  GOBO_TRY(resolveDefaults(r));
  GOBO_TRY(checkEncoding(r.encoding()));
  GOBO_TRY(options.displays->resolve(r, request));
  GOBO_ASSIGN(const PixelWindow window, windowOf(r));
  const uint64_t pixels = window.width ? uint64_t(window.width) * uint64_t(window.height) : uint64_t(r.width()) * r.height();
  if (pixels * r.view_samples() > kMaxViewSamples)
    return Status(Code::ResourceExhausted,
                  std::string(window.width ? "request.window.width" : "request.width") +
                      " x height x view_samples = " + std::to_string(pixels * r.view_samples()) + ": must be at most " + std::to_string(kMaxViewSamples),
                  window.width ? "request.window.width" : "request.width");
  GOBO_TRY(checkOutliers(r));
  if (window.width && r.has_certificate())
    return invalidArgument(std::string(r.halt().has_error() ? "request.halt.error" : "request.certificate") + ": is of a whole picture, not of request.window",
                           r.halt().has_error() ? "request.halt.error" : "request.certificate");
  const bool beauty = std::find(r.outputs().begin(), r.outputs().end(), "beauty") != r.outputs().end();
  if (r.has_certificate() && !beauty) return invalidArgument("request.certificate: needs output 'beauty'", "request.certificate");
  GOBO_TRY(resolveShutter(r, request, *scene));
  resolveMotion(r, request);
  const std::string hash = scene->hash().hex();
  if (!r.scene_hash().empty() && r.scene_hash() != hash)
    return Status(Code::FailedPrecondition, "scene '" + r.scene() + "' has hash " + hash + ", the request wants " + r.scene_hash(), "request.scene_hash");
  r.set_scene_hash(hash);
  return r;
}

Result<v1::RenderRequest> Engine::resolve(const v1::RenderRequest& request, const SceneAccess& access) const {
  GOBO_ASSIGN(const ScenePtr scene, impl_->scenes.find(request.scene(), {}, access));
  return impl_->resolve(request, scene);
}

/// With all its samples: what is there of fewer is not what was asked for. `ahead`: of the time only what comes before anything of the view.
Result<Expected> Engine::Impl::expect(const ScenePtr& scene, const v1::RenderRequest& resolved, const EnvironmentSource& environment, const StopToken& stop,
                                      bool ahead) {
  MappedGuard guard(*scene, resolved.scene());
  PlannerServices services = plannerServices(resolved.scene(), stop, guard, environment, false);
  services.expand = nullptr;
  const v1::Halt& halt = resolved.halt();
  const auto plan = makePlan(scene, resolved, halt.has_spp() ? passesFor(samplesOfSlice(halt.spp(), shutterSlices(resolved))) : 1, services);
  GOBO_TRY(checked(guard, plan.ok() ? Status() : plan.status()));
  Executor executor((*plan)->graph, executorServices(guard, false, resolved.scene()), stop);
  const double ms = halt.has_spp() ? (ahead ? aheadMs : expectedMs)(**plan, executor) : 0.0;
  return Expected{(*plan)->pinnedBytes, ms, !(*plan)->expanded.empty()};
}

Result<PreparedRender> Engine::prepare(const v1::RenderRequest& request, ScenePtr scene, const StopToken& stop, const SceneAccess& access,
                                       const EnvironmentSource& environment) {
  if (!scene) { GOBO_ASSIGN(scene, impl_->scenes.find(request.scene(), stop, access)); }
  PreparedRender prepared;
  prepared.request = request;
  prepared.environment = environment;
  GOBO_ASSIGN(prepared.resolved, impl_->resolve(request, scene));
  GOBO_ASSIGN(const Expected expected, impl_->expect(scene, prepared.resolved, environment, stop));
  prepared.pinnedBytes = expected.pinnedBytes;
  if (prepared.resolved.halt().has_spp()) {
    prepared.expectedMs = expected.ms;
    prepared.small = prepared.expectedMs <= kSmallMs && !prepared.resolved.has_certificate() && !expected.expands;
  }
  return prepared;
}

Result<v1::PlanReply> Engine::plan(const v1::RenderRequest& request, const StopToken& stop, const SceneAccess& access, const EnvironmentSource& environment) {
  GOBO_ASSIGN(const ScenePtr scene, impl_->scenes.find(request.scene(), stop, access));
  v1::PlanReply reply;
  GOBO_ASSIGN(*reply.mutable_resolved(), impl_->resolve(request, scene));
  const v1::Halt& halt = reply.resolved().halt();
  const uint32_t spp = halt.has_spp() ? halt.spp() : kBlockSamples;
  MappedGuard guard(*scene, request.scene());
  PlannerServices services = impl_->plannerServices(request.scene(), stop, guard, environment, false);
  services.expand = nullptr;
  const auto plan = makePlan(scene, reply.resolved(), passesFor(samplesOfSlice(spp, shutterSlices(reply.resolved()))), services);
  GOBO_TRY(impl_->checked(guard, plan.ok() ? Status() : plan.status()));
  Executor executor((*plan)->graph, impl_->executorServices(guard, false, request.scene()), stop);
  describeUnrun(**plan, executor, reply);
  for (auto& row : *reply.mutable_plan())
    if (row.samples()) row.set_samples(samplesOf(row.samples()));
  if (halt.has_time_s() || halt.has_error())
    reply.add_warnings("the sample count is found while it renders (request.halt." + std::string(halt.has_error() ? "error" : "time_s") + "): planned for " +
                       std::to_string(spp));
  const ExpectedError error = impl_->knownErrors.at(reply.resolved(), spp, samplesDecideAll(**plan));
  reply.set_standard_error(error.standardError);
  reply.set_rmse(error.rmse);
  reply.set_error_from(error.from);
  return reply;
}

void Engine::Impl::describe(const Plan& plan, const v1::RenderRequest& request, RenderResult& result) {
  const Scene& scene = *plan.effective.scene;
  for (const std::string& o : request.outputs()) {
    if (const OutputInfo* info = findOutput(o); info->kind == OutputKind::Matte) {
      const MatteOf of = o == "cryptomatte_object" ? MatteOf::Objects : MatteOf::Materials;
      result.attributes[o] = cryptomatteAttributes(info->channels, matteNames(scene, of));
      continue;
    }
    std::vector<std::string> names;
    if (o == "object_id")
      for (const Instance& i : scene.instances) names.push_back(i.name);
    else if (o == "material_id")
      for (const Material& m : scene.materials) names.push_back(m.name);
    else continue;
    result.tables["gobo:" + o] = nameTable(names);
  }
  result.matrices = {{"worldToCamera", worldToCamera(plan.effective.camera)}};
  if (!plan.effective.camera.optics.panorama) result.matrices["worldToNDC"] = worldToNdc(plan.effective.camera, int(request.width()), int(request.height()));
}

void Engine::Impl::fillReports(const Plan& plan, Executor& executor, const std::map<NodeId, ExecutedNode>& expanded, v1::RenderReply& reply) const {
  std::map<std::string, v1::NodeReport*> folded;  // transient nodes, one row a type and state
  for (NodeId id = 0; id < plan.graph.size(); ++id) {
    const GraphNode& n = plan.graph.at(id);
    ExecutedNode e = executor.report(id);
    const auto early = expanded.find(id);  // while planning: the executor of the picture never meets it
    if (early != expanded.end()) e = early->second;
    const auto state = e.state == ExecutedNode::State::Run      ? v1::NodeReport::RUN
                       : e.state == ExecutedNode::State::Reused ? v1::NodeReport::REUSED
                                                                : v1::NodeReport::NOT_NEEDED;
    v1::NodeReport* row = nullptr;
    if (n.transient) {
      v1::NodeReport*& slot = folded[n.node->type() + std::to_string(state)];
      if (!slot) {
        slot = reply.add_plan();
        slot->set_node(n.node->type() + " (folded)");
        slot->set_state(state);
        slot->set_device(n.node->device());
      }
      row = slot;
      row->set_ms(row->ms() + e.ms);
      row->set_rays(row->rays() + e.rays);
      row->set_bytes(std::max<uint64_t>(row->bytes(), e.bytes));
      row->set_count(row->count() + 1);
      continue;
    }
    row = reply.add_plan();
    row->set_node(n.label);
    row->set_state(state);
    std::string reason = state == v1::NodeReport::NOT_NEEDED ? "what it feeds was reused" : e.reason;
    if (!n.approximate.empty()) {
      reason += (reason.empty() ? "" : "; ") + n.approximate;
      row->set_approximate(true);
    }
    row->set_reason(reason);
    row->set_ms(e.ms);
    row->set_rays(e.rays);
    row->set_bytes(e.bytes);
    row->set_dropped_samples(e.dropped);
    row->set_device(n.node->device());
    if (!e.key.isZero()) row->set_key(e.key.hex());
    row->set_count(1);
    if (n.node->traits().extendable) row->set_samples(n.blocks);
  }
  addPrunedRows(plan.graph, *reply.mutable_plan());
  uint64_t rays = 0;
  for (const auto& row : reply.plan()) rays += row.rays();
  reply.set_rays(rays);
}

namespace {

/// Files say candela and lux, and are read as W/sr and W/m^2: one that means what it says is 683 times too bright, more than nine stops.
void warnOfPhotometricLights(const Plan& plan, RenderResult& result) {
  if (!plan.effective.asInFile) return;
  for (const RenderedImage& image : result.images) {
    if (image.output != "beauty") continue;
    if (const std::string warning = photometricWarning({image.pixels(), image.channels()}); !warning.empty()) result.reply.add_warnings(warning);
    return;
  }
}

}  // namespace

Result<RenderResult> Engine::Impl::renderOnce(const ScenePtr& scene, const PreparedRender& prepared, const v1::RenderRequest& request, uint32_t spp,
                                              uint32_t most, const RenderControl& control, Clock::time_point start, MappedGuard& guard, bool& extendable) {
  RenderResult result;
  GOBO_ASSIGN(result.view, options.displays->processor(request.encoding()));
  v1::RenderReply& reply = result.reply;
  std::map<NodeId, ExecutedNode> expanded;
  GOBO_ASSIGN(const std::unique_ptr<Plan> plan,
              makePlan(scene, request, passesFor(spp), plannerServices(request.scene(), control.stop, guard, prepared.environment, prepared.small, &expanded)));
  // Rays of mattes alone are no reason for a certificate of the same picture again.
  extendable = plan->extendable || (plan->mattesGrow && (request.halt().has_spp() || !request.has_certificate()));
  const bool rung = spp < most && extendable;
  const bool certified = request.has_certificate() && !rung;  // one of what is only looked at would cost more than it
  const uint32_t realised = samplesOf(passesFor(rung ? spp : most)) * shutterSlices(request);

  std::mutex progressMutex;
  std::function<void(const std::string&, double)> progress;
  if (control.progress)
    progress = [&](const std::string& stage, double fraction) {
      v1::Progress p;
      p.set_stage(stage);
      p.set_fraction(fraction);
      p.set_spp(realised);
      p.set_elapsed_ms(msSince(start));
      std::lock_guard lock(progressMutex);  // nodes report from any thread
      control.progress(p);
    };
  ExecutorServices services = executorServices(guard, prepared.small, request.scene());
  services.checkpoints = control.checkpoints;
  Executor executor(plan->graph, services, control.stop, progress);
  std::vector<NodeId> asked;
  for (const PlannedOutput& o : plan->outputs) asked.push_back(o.node);
  executor.asks(asked);
  for (const PlannedOutput& o : plan->outputs) {
    GOBO_ASSIGN(const TermPtr term, executor.evaluate(o.node));
    result.images.emplace_back(o.name, term, o.plane, o.channels);
  }
  describe(*plan, request, result);
  fillReports(*plan, executor, expanded, reply);
  for (auto& row : *reply.mutable_plan())
    if (row.samples()) row.set_samples(samplesOf(row.samples()));
  if (certified) {
    for (const RenderedImage& image : result.images) {
      if (image.output != "beauty") continue;
      GOBO_ASSIGN(*reply.mutable_certificate(), certifyPicture(image.image(), plan->effective, request, accels, arenaOf(prepared.small), control.stop));
    }
  }
  *reply.mutable_resolved() = request;
  // The realised sample count replaces whatever ended the render: sent again, it gives the same bits.
  reply.mutable_resolved()->clear_halt();
  reply.mutable_resolved()->mutable_halt()->set_spp(realised);
  if (!certified) reply.mutable_resolved()->clear_certificate();
  reply.set_request_hash(requestHash(reply.resolved()));
  reply.set_seed(request.seed());
  reply.set_build(buildVersion());
  for (const std::string& w : plan->warnings)
    if (certified || !w.starts_with("request.certificate")) reply.add_warnings(w);
  for (const RenderedImage& image : result.images) {
    if (const std::string warning = droppedWarning(image.output, image.dropped()); !warning.empty()) reply.add_warnings(warning);
  }
  warnOfPhotometricLights(*plan, result);
  for (const std::string& m : plan->missing) reply.add_path_classes_missing(m);
  reply.set_peak_bytes(executor.peakBytes());
  reply.set_total_ms(msSince(start));
  return result;
}

namespace {

/// Whether the client left the exposure of a picture for looking at to the server. A window would get another one than its neighbours.
bool leavesExposure(const v1::RenderRequest& asked, const v1::RenderRequest& resolved) {
  const auto format = resolved.encoding().format();
  return !asked.tone_map().has_exposure() && !asked.curves().count("tone_map.exposure") && !asked.expressions().count("tone_map.exposure") &&
         resolved.tone_map().auto_exposure() && !resolved.has_window() && (format == v1::Encoding::PNG || format == v1::Encoding::JPEG);
}

/// Into the reply's request, as if the client had given it.
void setExposure(RenderResult& result) {
  for (const RenderedImage& image : result.images) {
    if (findOutput(image.output)->kind != OutputKind::Radiance) continue;
    const std::optional<ChosenExposure> chosen = chooseExposure({image.pixels(), image.channels()});
    if (!chosen) return;
    v1::RenderRequest& resolved = *result.reply.mutable_resolved();
    resolved.mutable_tone_map()->set_exposure(chosen->stops);
    result.reply.set_request_hash(requestHash(resolved));
    char text[160];
    std::snprintf(text, sizeof text, "tone_map.exposure = %g was chosen: the log-average luminance of %s is %.3g; give an exposure to keep it", chosen->stops,
                  image.output.c_str(), chosen->luminance);
    result.reply.add_warnings(text);
    return;
  }
}

}  // namespace

Status Engine::Impl::checked(const MappedGuard& guard, const Status& result) {
  const Status lost = guard.check();
  if (lost.ok()) return result;
  scenes.dropBroken(guard.broken());
  return lost;
}

Result<RenderResult> Engine::render(const v1::RenderRequest& request, const RenderControl& control) {
  PreparedRender unprepared;
  unprepared.request = request;
  return run(unprepared, control);
}

Result<RenderResult> Engine::run(const PreparedRender& prepared, const RenderControl& control) {
  Result<RenderResult> result = impl_->run(prepared, control);
  if (!result.ok() && result.status().code() == Code::Cancelled) {  // whatever it was at, loading the scene too
    switch (control.stop.reason()) {
      case StopReason::Preempted: return Status(Code::Aborted, "preempted");
      case StopReason::Deadline: return Status(Code::DeadlineExceeded, "deadline passed while rendering");
      default: break;
    }
  }
  return result;
}

Result<RenderResult> Engine::Impl::run(const PreparedRender& prepared, const RenderControl& control) {
  const v1::RenderRequest& request = prepared.request;
  const RunSoFar was = control.soFar ? *control.soFar : RunSoFar{};
  const auto begunRun = Clock::now(), start = begunRun - std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double, std::milli>(was.ms));
  struct Spent {
    RunSoFar* soFar;
    Clock::time_point begun;
    ~Spent() {
      if (soFar) soFar->ms += msSince(begun);
    }
  } spent{control.soFar, begunRun};
  ScenePtr scene = control.scene;
  if (!scene) { GOBO_ASSIGN(scene, scenes.find(request.scene(), control.stop, control.access)); }
  // Before: what it will pin is in the ledger already, where somebody counts it. After: what it left behind.
  struct Settle {
    MemoryLedger& memory;
    explicit Settle(MemoryLedger& ledger) : memory(ledger) { memory.settle(); }
    ~Settle() { memory.settle(); }
  } settle(memory);
  v1::RenderRequest resolved = prepared.resolved;
  if (resolved.scene_hash() != scene->hash().hex()) { GOBO_ASSIGN(resolved, resolve(request, scene)); }  // not resolved yet, or for what it was then
  const v1::Halt& halt = resolved.halt();
  // Samples are counted for each slice of a shutter from here on: they all have as many.
  const uint32_t slices = shutterSlices(resolved);
  const uint32_t most = samplesOfSlice(halt.has_spp() ? halt.spp() : mostSamples(resolved, kMaxSpp), slices);
  const bool open = halt.has_time_s() || halt.has_error();  // the sample count is not known beforehand
  const bool watched = bool(control.snapshot);
  ErrorFloor floor;
  bool extendable = false;
  const auto once = [&](const v1::RenderRequest& asked, uint32_t samples, uint32_t of, const RenderControl& how) -> Result<RenderResult> {
    MappedGuard guard(*scene, request.scene());
    GOBO_TRY(checked(guard, {}));  // of no use to begin with
    Result<RenderResult> result = renderOnce(scene, prepared, asked, samples, of, how, start, guard, extendable);
    if (const Status status = checked(guard, result.ok() ? Status() : result.status()); !status.ok()) result = status;
    if (result.ok() && leavesExposure(request, resolved)) setExposure(*result);
    return result;
  };
  const auto show = [&](RenderResult& result) {
    result.reply.set_render_id(remembered.add(result.reply.resolved(), control.owner));
    control.snapshot(result);
  };
  const auto finished = [&](RenderResult& picture) -> Result<RenderResult> {
    ++renders;
    knownErrors.add(picture.reply);
    picture.reply.set_total_ms(msSince(start));
    picture.reply.set_render_id(remembered.add(picture.reply.resolved(), control.owner));
    return std::move(picture);
  };

  const bool ladder = watched && control.ladder && resolved.scheduling().ladder();
  if (ladder) {
    RenderControl how = control;
    how.checkpoints = nullptr;  // of the picture that was asked for
    const uint32_t shrink = pace.shrink(resolved.scene_hash(), uint64_t(resolved.width()) * resolved.height(), control.waiting ? control.waiting() : 0);
    if (std::optional<v1::RenderRequest> small = smallRung(resolved, shrink)) {
      if (const auto plain = plainRung(*small)) {
        GOBO_ASSIGN(const Expected expected, expect(scene, *small, prepared.environment, control.stop, /*ahead=*/true));
        if (expected.ms > kRungMs) small = plain;
      }
      const auto begun = Clock::now();
      GOBO_ASSIGN(RenderResult picture, once(*small, 1, 1, how));
      if (picture.reply.rays() > 0) pace.took(resolved.scene_hash(), uint64_t(small->width()) * small->height(), msSince(begun));  // else it was there
      show(picture);
    }
  }

  // Whoever looks on, or waits no longer than he says, gets the first samples first. Where each picture may be the last and wants a certificate, it is
  // worth a block of them.
  const bool certain = open && resolved.has_certificate();
  uint32_t spp = (ladder || halt.has_time_s()) && !certain ? 1 : open || watched ? std::min(most, kBlockSamples) : most;
  spp = std::max(spp, std::min(was.spp, most));
  RenderControl how = control;
  const double timeMs = halt.time_s() * 1e3 - std::min(control.afterwardsMs, 0.5 * halt.time_s() * 1e3);
  NoiseOfPicture noise;
  std::optional<RenderResult> before;
  uint32_t had = 0;
  while (true) {
    const auto begun = Clock::now();
    Result<RenderResult> made = once(resolved, spp, open ? spp : most, how);
    if (!made.ok() && before && how.stop.reason() == StopReason::TimeUp) return finished(*before);  // what it was at is dropped
    GOBO_TRY(made.status());
    if (control.soFar) control.soFar->spp = spp;
    RenderResult& picture = *made;
    picture.reply.set_standard_error(noise.after(picture.images, samplesOf(passesFor(spp))));
    const double elapsed = msSince(start);
    const double timeLeft = halt.has_time_s() ? std::max(0.0, timeMs - elapsed) : -1.0;
    const bool errorMet = halt.has_error() && picture.reply.certificate().rmse_high() <= halt.error();
    const bool hopeless = halt.has_error() && !halt.has_time_s() && !errorMet && floor.reached(picture.reply.certificate(), halt.error());
    // How long samples take is known where some were traced: those that were there already came at once.
    const RungTimes times{picture.reply.rays() > 0 ? msSince(begun) / double(spp - had) : 0.0, had == 0, timeLeft};
    const uint32_t next = nextRung(spp, most, times);
    if (halt.has_time_s() && had == 0 && was.spp == 0 && timeLeft == 0.0 && extendable)
      picture.reply.add_warnings("request.halt.time_s = " + std::to_string(halt.time_s()) + ": " +
                                 (spp * slices == 1 ? "one sample" : std::to_string(spp * slices) + " samples") + " a pixel took " +
                                 std::to_string(elapsed * 1e-3) + " s");
    if (!extendable || spp >= most || next == spp || (open && (timeLeft == 0.0 || errorMet || hopeless))) {
      if (halt.has_error() && !errorMet)
        picture.reply.add_warnings(std::string("stopped before the error bound was met") +
                                   (hopeless ? ": more samples no longer lower the error; what the request leaves out does not go away with them" : ""));
      return finished(picture);
    }
    if (watched) show(picture);
    had = spp;
    spp = next;
    if (halt.has_time_s()) {
      before = std::move(picture);
      how.stop = control.stop.until(start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double, std::milli>(timeMs)));
    }
  }
}

Result<v1::RenderRequest> Engine::relightRequest(const v1::RelightRequest& relight, const std::string& caller) const {
  std::optional<v1::RenderRequest> known = impl_->remembered.find(relight.render_id(), caller);
  if (!known)
    return notFound("no render '" + relight.render_id().substr(0, 80) + "' (the last " + std::to_string(impl_->remembered.keep()) + " are remembered)",
                    "render_id");
  v1::RenderRequest base = std::move(*known);
  base.clear_scene_hash();  // a relight is of the scene as it is now
  // A request with a shutter or output `motion` still has curves (request/shutter.h), and any one the expressions that vary from place to place: what is given
  // now is not what they say of it.
  const auto within = [](const std::string& path, const std::string& group) {
    return path.starts_with(group) && path.size() > group.size() && (path[group.size()] == '.' || path[group.size()] == '[');
  };
  const auto drop = [&](auto& varying, const std::string& path) {
    for (auto c = varying.begin(); c != varying.end();) {
      const bool replaced = c->first == path || within(c->first, path) || within(path, c->first);
      c = replaced ? varying.erase(c) : std::next(c);
    }
  };
  for (const std::string& path : relight.mask()) {
    if (path == "curves" || path.starts_with("curves.") || path == "expressions" || path.starts_with("expressions.")) continue;
    drop(*base.mutable_curves(), path);
    drop(*base.mutable_expressions(), path);
  }
  // A shutter over which nothing could move has one slice: what may move from now on has as many as a request that says nothing of them.
  const auto moves = [](const std::string& path) { return path.starts_with("curves") || path.starts_with("expressions"); };
  if (base.camera().shutter_slices() == 1 && base.curves().empty() && base.expressions().empty() &&
      std::any_of(relight.mask().begin(), relight.mask().end(), moves))
    base.mutable_camera()->clear_shutter_slices();
  GOBO_TRY(applyMask(base, relight.patch(), {relight.mask().begin(), relight.mask().end()}));
  replaceView(base, relight.mask());
  return base;
}

void Engine::dropCaches(bool disk, bool pinned) {
  TermStore& store = *impl_->store;
  if (pinned || (store.pinnedBytes() == 0 && store.pinnedDiskBytes() == 0)) store.clear(disk);
  else store.evict([](const StoredTerm&) { return true; }, disk, false);
  impl_->extensions.clear();
  impl_->lastSky.drop();
}

TermStore& Engine::terms() { return *impl_->store; }

void Engine::fillStatus(v1::StatusReply& s) const {
  s.set_build(buildVersion());
  s.set_uptime_s(msSince(impl_->started) * 1e-3);
  s.set_store_bytes(impl_->store->bytes());
  s.set_store_limit(impl_->store->maxBytes());
  s.set_store_terms(impl_->store->count());
  s.set_disk_bytes(impl_->store->diskBytes());
  s.set_renders(impl_->renders.load());
  s.set_scenes(impl_->scenes.count());
  s.set_threads(uint32_t(impl_->arena.threads()));
  for (const auto& h : impl_->memory.holders()) {
    v1::MemoryHolder& out = *s.add_memory();
    out.set_name(h->name);
    out.set_bytes(h->bytes());
    out.set_limit(h->limit());
    if (h->callers)
      for (const auto& [caller, bytes] : h->callers()) (*out.mutable_callers())[caller] = bytes;
  }
  s.set_memory_limit(impl_->memory.total());
}

MemoryLedger& Engine::memory() { return impl_->memory; }

}  // namespace plan
}  // namespace gobo
