// SPDX-License-Identifier: Apache-2.0
#include "plan/scene_library.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <limits>
#include <set>
#include <utility>

#include "base/closest.h"
#include "base/file_stamp.h"
#include "base/mapped_file.h"
#include "request/effective_scene.h"
#include "scene/edit.h"
#include "scene/load.h"

namespace gobo {
inline namespace plan {

namespace {

namespace fs = std::filesystem;

double msSince(std::chrono::steady_clock::time_point t) { return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t).count(); }

bool isBuiltin(const std::string& name) {
  const auto& names = builtinSceneNames();
  return std::find(names.begin(), names.end(), name) != names.end();
}

std::string idFrom(const std::string& source) {
  std::string id = fs::path(source).stem().string();
  return id.empty() ? "scene" : id;
}

void put(v1::Vector3* out, const Vec3& v) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

const char* kindName(LightKind k) {
  switch (k) {
    case LightKind::Point: return "point";
    case LightKind::Spot: return "spot";
    case LightKind::Directional: return "directional";
    case LightKind::Rect: return "rect";
    case LightKind::Disk: return "disk";
    case LightKind::Sphere: return "sphere";
    case LightKind::Mesh: return "mesh";
    case LightKind::Environment: return "environment";
  }
  return "?";
}

Result<ScenePtr> patched(const Scene& base, const v1::PatchSceneRequest& p) {
  return editScene(base, [&](Scene& s) -> Status {
    const auto finite = [](const v1::Vector3& v) { return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z()); };
    const auto unit = [](double v) { return v >= 0 && v <= 1; };
    for (const auto& [name, m] : p.materials()) {
      const std::string path = "materials." + name;
      const int i = s.findMaterial(name);
      if (i < 0) return notFound("no material '" + name + "'", path);
      Material& material = s.materials[i];
      if (m.has_base_color()) {
        const Vec3 c(m.base_color().x(), m.base_color().y(), m.base_color().z());
        if (!unit(c.x) || !unit(c.y) || !unit(c.z)) return invalidArgument(path + ".base_color: each channel must be in 0..1", path + ".base_color");
        material.albedo.factor = c;
      }
      if (m.has_metallic()) {
        if (!unit(m.metallic())) return invalidArgument(path + ".metallic = " + std::to_string(m.metallic()) + ": must be in 0..1", path + ".metallic");
        material.bsdf.metallic = float(m.metallic());
      }
      if (m.has_roughness()) {
        if (!unit(m.roughness())) return invalidArgument(path + ".roughness = " + std::to_string(m.roughness()) + ": must be in 0..1", path + ".roughness");
        material.bsdf.roughness = float(m.roughness());
      }
      if (m.has_emission()) {
        const Vec3 c(m.emission().x(), m.emission().y(), m.emission().z());
        if (!finite(m.emission()) || c.x < 0 || c.y < 0 || c.z < 0)
          return invalidArgument(path + ".emission: must be finite and not negative", path + ".emission");
        material.emission.radiance = c;
        // The mesh lights of this material follow; seal() makes those that are new.
        s.lights.erase(
            std::remove_if(s.lights.begin(), s.lights.end(),
                           [&](const Light& l) { return l.shape.kind == LightKind::Mesh && s.meshes[s.instances[l.shape.instance].mesh]->material == i; }),
            s.lights.end());
      }
    }
    for (const auto& [name, instance] : p.instances()) {
      const std::string path = "instances." + name;
      const int i = s.findInstance(name);
      if (i < 0) return notFound("no instance '" + name + "'", path);
      Mat4 m = s.instances[i].toWorld;
      if (instance.matrix_size() > 0 || !instance.has_moved_by()) {
        if (instance.matrix_size() != 16)
          return invalidArgument(path + ".matrix: has " + std::to_string(instance.matrix_size()) + " numbers, needs 16", path + ".matrix");
        for (int k = 0; k < 16; ++k) {
          if (!std::isfinite(instance.matrix(k))) return invalidArgument(path + ".matrix[" + std::to_string(k) + "]: must be finite", path + ".matrix");
          m[k / 4][k % 4] = instance.matrix(k);
        }
        if (m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1) return invalidArgument(path + ".matrix: last row must be 0 0 0 1", path + ".matrix");
      }
      if (instance.has_moved_by()) {
        if (!finite(instance.moved_by())) return invalidArgument(path + ".moved_by: must be finite", path + ".moved_by");
        const DVec3 to = DVec3(m[3]) + DVec3(instance.moved_by().x(), instance.moved_by().y(), instance.moved_by().z());
        if (glm::any(glm::greaterThan(glm::abs(to), DVec3(std::numeric_limits<float>::max()))))
          return invalidArgument(path + ".moved_by: " + name + " would be farther away than single precision reaches", path + ".moved_by");
        m[3] = Vec4(Vec3(to), 1.0f);
      }
      s.instances[i].toWorld = m;
    }
    for (const auto& [name, edit] : p.lights()) {
      const std::string path = "lights." + name;
      v1::LightEdit e = edit;
      const int i = s.findLight(name);
      if (i < 0) return notFound("no light '" + name + "'", path);
      GOBO_TRY(applyLightShape(e, s, size_t(i), path));
      if (e.has_color() || e.has_intensity()) {
        const LightParts old = partsOf(s.lights[i]);
        const Vec3 color = e.has_color() ? Vec3(e.color().x(), e.color().y(), e.color().z()) : old.color;
        const double intensity = e.has_intensity() ? e.intensity() : double(old.intensity);
        if (!isFinite(color) || color.x < 0 || color.y < 0 || color.z < 0 || !std::isfinite(intensity) || intensity < 0)
          return invalidArgument(path + ": color and intensity must be finite and not negative", path);
        setPower(s.lights[i], {color, float(intensity)});
      }
    }
    return {};
  });
}

}  // namespace

Result<std::string> SceneLibrary::allowedPath(const std::string& path, const std::string& field) const {
  std::vector<std::string> roots;
  {
    std::lock_guard lock(mutex_);
    roots = roots_;
  }
  std::error_code error;
  const fs::path real = fs::canonical(path, error);
  if (error) {
    // Without a root nobody learns which files exist outside the roots.
    if (anyPath_) return notFound("cannot open '" + path + "': " + error.message(), field);
    for (const std::string& root : roots) {
      const fs::path lexical = fs::absolute(path).lexically_normal(), base = fs::weakly_canonical(root, error);
      if (std::mismatch(base.begin(), base.end(), lexical.begin(), lexical.end()).first == base.end()) return notFound("no file '" + path + "'", field);
    }
    return Status(Code::PermissionDenied, "'" + path + "' is not under an allowed root", field);
  }
  if (anyPath_) return real.string();
  for (const std::string& root : roots) {
    const fs::path base = fs::canonical(root, error);
    if (!error && std::mismatch(base.begin(), base.end(), real.begin(), real.end()).first == base.end()) return real.string();
  }
  return Status(Code::PermissionDenied, "'" + path + "' is not under an allowed root", field);
}

v1::SceneInfo SceneLibrary::info(const std::string& id, const Entry& e) const {
  v1::SceneInfo out;
  const Scene& s = *e.scene;
  out.set_id(id);
  out.set_source(e.source);
  out.set_hash(s.hash().hex());
  for (uint32_t bit = 1; bit <= uint32_t(Facet::Cameras); bit <<= 1) {
    std::vector<int> all(s.lights.size());
    for (size_t i = 0; i < all.size(); ++i) all[i] = int(i);
    auto* f = out.add_facets();
    f->set_facet(facetName(Facet(bit)));
    f->set_hash(s.facetHash(Facet(bit), all).hex());
  }
  out.set_triangles(s.triangleCount());
  out.set_instances(uint32_t(s.instances.size()));
  out.set_materials(uint32_t(s.materials.size()));
  out.set_textures(uint32_t(s.textures.size()));
  out.set_bytes(s.bytes());
  for (const Light& l : s.lights) {
    auto* light = out.add_lights();
    light->set_name(l.name);
    light->set_kind(kindName(l.shape.kind));
    put(light->mutable_power(), l.power);
    put(light->mutable_position(), l.shape.position);
    put(light->mutable_direction(), l.shape.axis);
  }
  for (const Camera& c : s.cameras) out.add_cameras(c.name);
  for (const Material& m : s.materials) out.add_material_names(m.name);
  for (size_t i = 0; i < s.instances.size() && i < 10000; ++i) out.add_instance_names(s.instances[i].name);
  Vec3 lo, hi;
  s.bounds(lo, hi);
  if (lo.x <= hi.x) {
    put(out.mutable_bounds_min(), lo);
    put(out.mutable_bounds_max(), hi);
  }
  if (s.origin != DVec3(0.0)) {
    out.mutable_origin()->set_x(s.origin.x);
    out.mutable_origin()->set_y(s.origin.y);
    out.mutable_origin()->set_z(s.origin.z);
  }
  for (const std::string& w : s.warnings) out.add_warnings(w);
  out.set_load_ms(e.loadMs);
  if (s.rig)
    for (const RigAnimation& a : s.rig->animations) {
      auto* animation = out.add_animations();
      animation->set_name(a.name);
      animation->set_duration_s(a.end);
    }
  for (const std::string& v : s.variants.names) out.add_variants(v);
  out.set_parse_ms(e.report.parseMs);
  out.set_texture_ms(e.report.textureMs);
  out.set_map_ms(e.report.mapMs);
  out.set_ingest_ms(e.report.ingestMs);
  out.set_blob_bytes(e.report.blobBytes);
  out.set_blob_cached(e.report.cached);
  out.set_owner(e.owner);
  for (const std::string& name : e.share) out.add_share(name);
  return out;
}

uint64_t SceneLibrary::sceneBytesHeld() const {
  uint64_t total = 0;
  for (const auto& [id, entry] : scenes_) total += entry.bytes;
  return total;
}

void SceneLibrary::noteGone(const std::string& id, const Entry& entry, const char* why) {
  gone_.push_back({id, why, entry.owner, {entry.share.begin(), entry.share.end()}, isBuiltin(id) && (entry.patched || entry.source != id)});
  if (gone_.size() <= 1000) return;
  // Of changed built-ins there is one a name at most, and who asks for it must not get the unchanged one.
  gone_.erase(std::find_if(gone_.begin(), gone_.end(), [](const Gone& g) { return !g.changedBuiltin; }));
}

bool SceneLibrary::isGoneForGood(const std::string& id) const {
  return std::any_of(gone_.begin(), gone_.end(), [&](const Gone& g) { return g.changedBuiltin && g.id == id; });
}

void SceneLibrary::forgetGone(const std::string& id) {
  std::erase_if(gone_, [&](const Gone& g) { return g.id == id; });
}

// The owner that has most gives first: whoever loads much makes room for himself.
bool SceneLibrary::evict(const std::string& keep, const char* why, Freed& freed) {
  std::map<std::string, uint64_t> ofOwner;
  for (const auto& [id, entry] : scenes_) ofOwner[entry.owner] += entry.bytes;
  Entries::iterator victim = scenes_.end();
  for (auto at = scenes_.begin(); at != scenes_.end(); ++at) {
    if (at->first == keep || at->second.scene.use_count() > 1) continue;  // somebody renders it, or works on it
    const auto order = [&](Entries::iterator e) { return std::pair(~ofOwner[e->second.owner], e->second.used); };
    if (victim == scenes_.end() || order(at) < order(victim)) victim = at;
  }
  if (victim == scenes_.end()) return false;
  noteGone(victim->first, victim->second, why);
  freed.push_back(std::move(victim->second.scene));
  freed.push_back(std::move(victim->second.holds));
  scenes_.erase(victim);
  return true;
}

Status SceneLibrary::makeRoom(uint64_t bytes, const std::string& keep, Freed& freed) {
  for (uint64_t held = sceneBytesHeld(); held > limits_.sceneBytes || bytes > limits_.sceneBytes - held; held = sceneBytesHeld())
    if (!evict(keep, "to make room (engine.scene_bytes)", freed))
      return {Code::ResourceExhausted,
              "no room for a scene of " + std::to_string(bytes) + " bytes: loaded ones that are in use have " + std::to_string(held) + ", at most " +
                  std::to_string(limits_.sceneBytes) + " (engine.scene_bytes)",
              "scene"};
  return {};
}

Status SceneLibrary::room(uint64_t bytes, const char* what) { return ledger_ ? ledger_->makeRoom(bytes, what).at("scene") : Status(); }

void SceneLibrary::shrinkScenes(uint64_t most) {
  Freed freed;
  std::lock_guard lock(mutex_);
  while (sceneBytesHeld() > most && evict("", "to make room (engine.memory_bytes)", freed)) {}
}

Result<v1::SceneInfo> SceneLibrary::insert(std::string id, const std::string& source, Result<LoadedScene> scene, double ms, const StopToken& stop,
                                           const SceneAccess& access, const std::vector<std::string>& share, std::shared_ptr<const void> holds) {
  if (!scene.ok()) return scene.status();
  if (stop.stopRequested()) return Status(Code::Cancelled, "the load was cancelled", source);
  const uint64_t bytes = scene->scene->bytes();
  GOBO_TRY(room(bytes, "a scene"));
  Freed freed;
  std::lock_guard lock(mutex_);
  const auto taken = [&](const std::string& name) {  // by somebody else, or as a built-in
    const auto at = scenes_.find(name);
    return at != scenes_.end() ? !access.changes(at->second.owner) : !access.all && isBuiltin(name);
  };
  if (id.empty()) {  // named after the file; another file of that name gets a number
    const std::string stem = idFrom(source);
    id = stem;
    for (int k = 2; taken(id) || (scenes_.count(id) && scenes_[id].source != source); ++k) id = stem + "-" + std::to_string(k);
  } else if (taken(id)) {
    return Status(Code::PermissionDenied, "scene '" + id + "' is another's: choose another name", "name");
  }
  const auto old = scenes_.find(id);
  const uint64_t replaced = old == scenes_.end() ? 0 : old->second.bytes;
  if (old != scenes_.end()) freed.push_back(old->second.scene);
  GOBO_TRY(makeRoom(bytes > replaced ? bytes - replaced : 0, id, freed));
  forgetGone(id);
  Entry& e = scenes_[id];
  std::swap(e.holds, holds);  // those of a scene that it replaces go after the lock
  e = {scene->scene, source, ms, scene->report, access.caller, share, ++clock_, bytes, e.holds};
  return info(id, e);
}

Result<v1::SceneInfo> SceneLibrary::open(const std::string& source, std::string id, const StopToken& stop, const SceneAccess& access,
                                         const std::vector<std::string>& share) {
  if (source.empty()) return invalidArgument("must not be empty", "source");
  const auto start = std::chrono::steady_clock::now();
  if (isBuiltin(source)) {
    // Under its own name a built-in is everybody's.
    if (!access.all && (id.empty() || id == source)) {
      GOBO_TRY(find(source, stop, access, true).status().at("scene"));
      return inspect(source, access);
    }
    GOBO_ASSIGN(ScenePtr scene, makeBuiltinScene(source, stop));
    return insert(id.empty() ? source : id, source, LoadedScene{std::move(scene), {}}, msSince(start), stop,
                  id.empty() || id == source ? SceneAccess{} : access, share);
  }
  if (source.find('/') == std::string::npos && source.find('.') == std::string::npos) return makeBuiltinScene(source).status();
  GOBO_ASSIGN(const std::string path, allowedPath(source, "source"));
  return openFile(path, source, std::move(id), stop, access, share);
}

Result<v1::SceneInfo> SceneLibrary::openFile(const std::string& path, const std::string& source, std::string id, const StopToken& stop,
                                             const SceneAccess& access, const std::vector<std::string>& share, std::shared_ptr<const void> holds) {
  const auto start = std::chrono::steady_clock::now();
  Result<LoadedScene> scene = loader_->scene(path, stop);
  return insert(std::move(id), source, std::move(scene), msSince(start), stop, access, share, std::move(holds));
}

Result<ScenePtr> SceneLibrary::load(const std::string& source, bool trusted) const {
  if (isBuiltin(source)) return makeBuiltinScene(source);
  std::string path = source;
  if (!trusted) { GOBO_ASSIGN(path, allowedPath(source, "source")); }
  GOBO_ASSIGN(LoadedScene loaded, loader_->scene(path, {}));  // trusted as a path; its bytes are not
  return std::move(loaded.scene);
}

Status SceneLibrary::unknown(const std::string& id, const SceneAccess& access) const {
  std::set<std::string> known(builtinSceneNames().begin(), builtinSceneNames().end());
  for (const auto& [name, entry] : scenes_)
    if (access.uses(entry.owner, entry.share)) known.insert(name);
  if (isGoneForGood(id)) known.erase(id);
  const std::vector<std::string> names(known.begin(), known.end());
  const std::string meant = didYouMean(id, names);
  const auto went = std::find_if(gone_.rbegin(), gone_.rend(), [&](const Gone& g) { return g.id == id && access.uses(g.owner, g.share); });
  return notFound(
      "no scene '" + id + "'" + (went != gone_.rend() ? ", which was unloaded " + went->why + ": open it again" : meant) + " (has: " + someOf(names) + ")",
      "request.scene");
}

Result<ScenePtr> SceneLibrary::find(const std::string& id, const StopToken& stop, const SceneAccess& access, bool again) {
  if (id.empty()) return invalidArgument("must not be empty", "request.scene");
  {
    std::lock_guard lock(mutex_);
    const auto it = scenes_.find(id);
    if (it != scenes_.end()) {
      if (!access.uses(it->second.owner, it->second.share)) return unknown(id, access);
      it->second.used = ++clock_;
      return it->second.scene;
    }
    if (!isBuiltin(id) || (!again && isGoneForGood(id))) return unknown(id, access);
  }
  const auto start = std::chrono::steady_clock::now();
  GOBO_ASSIGN(const ScenePtr scene, makeBuiltinScene(id, stop));
  const uint64_t bytes = scene->bytes();
  GOBO_TRY(room(bytes, "a scene"));
  Freed freed;
  std::lock_guard lock(mutex_);  // one that another caller has opened (and may have patched) meanwhile stays
  if (const auto it = scenes_.find(id); it != scenes_.end()) return it->second.scene;
  if (!again && isGoneForGood(id)) return unknown(id, access);  // or it went since
  GOBO_TRY(makeRoom(bytes, id, freed));
  forgetGone(id);
  return scenes_.try_emplace(id, Entry{.scene = scene, .source = id, .loadMs = msSince(start), .used = ++clock_, .bytes = bytes}).first->second.scene;
}

Result<v1::SceneInfo> SceneLibrary::inspect(const std::string& id, const SceneAccess& access) {
  const Result<ScenePtr> found = find(id, {}, access);
  GOBO_TRY(found.status().at("scene"));
  std::lock_guard lock(mutex_);
  const auto it = scenes_.find(id);
  if (it == scenes_.end() || !access.uses(it->second.owner, it->second.share)) return notFound("scene '" + id + "' was unloaded", "scene");
  return info(id, it->second);
}

std::vector<v1::SceneInfo> SceneLibrary::list(const SceneAccess& access) const {
  std::lock_guard lock(mutex_);
  std::vector<v1::SceneInfo> out;
  for (const auto& [id, entry] : scenes_)
    if (access.uses(entry.owner, entry.share)) out.push_back(info(id, entry));
  return out;
}

Result<v1::SceneInfo> SceneLibrary::patch(const v1::PatchSceneRequest& p, const StopToken& stop, const SceneAccess& access) {
  GOBO_ASSIGN(ScenePtr base, find(p.scene(), stop, access));
  const auto mine = [&](const Entry& e) -> Status {
    if (access.changes(e.owner)) return {};
    return {Code::PermissionDenied,
            "scene '" + p.scene() + "' is " + (e.owner.empty() ? "everybody's" : "another's") + ": open it under a name of your own and patch that", "scene"};
  };
  {
    std::lock_guard lock(mutex_);
    if (const auto at = scenes_.find(p.scene()); at != scenes_.end()) GOBO_TRY(mine(at->second));
  }
  for (;;) {
    GOBO_ASSIGN(const ScenePtr next, patched(*base, p));
    if (stop.stopRequested()) return Status(Code::Cancelled, "the patch was cancelled", p.scene());
    const uint64_t bytes = next->bytes();
    std::lock_guard lock(mutex_);
    const auto at = scenes_.find(p.scene());
    if (at == scenes_.end()) return notFound("scene '" + p.scene() + "' was unloaded while it was patched", "scene");
    GOBO_TRY(mine(at->second));
    if (at->second.scene != base) {  // another patch or a reload came first: this one goes on top of it
      base = at->second.scene;
      continue;
    }
    at->second.scene = next;
    at->second.used = ++clock_;
    at->second.bytes = bytes;
    at->second.patched = true;
    return info(p.scene(), at->second);
  }
}

Status SceneLibrary::unload(const std::string& id, const SceneAccess& access) {
  Freed freed;
  std::lock_guard lock(mutex_);
  const auto at = scenes_.find(id);
  if (at == scenes_.end() || !access.uses(at->second.owner, at->second.share)) return notFound("no loaded scene '" + id + "'", "scene");
  if (!access.changes(at->second.owner))
    return {Code::PermissionDenied, "scene '" + id + "' is " + (at->second.owner.empty() ? "everybody's" : "another's"), "scene"};
  freed.push_back(std::move(at->second.holds));
  scenes_.erase(at);
  return {};
}

void SceneLibrary::dropBroken(std::vector<std::shared_ptr<const MappedFile>> broken) {
  const auto isBroken = [&](const std::shared_ptr<const MappedFile>& file) {
    if (!file || file->intact()) return false;
    broken.push_back(file);
    return true;
  };
  {
    std::lock_guard lock(mutex_);
    for (auto at = scenes_.begin(); at != scenes_.end();) {
      if (!isBroken(at->second.scene->file)) {
        ++at;
        continue;
      }
      noteGone(at->first, at->second, "because its mapped file was cut short or cannot be read");
      at = scenes_.erase(at);
    }
    std::erase_if(environments_, [&](const auto& e) { return isBroken(e.second.map->file); });
  }
  for (const auto& file : broken) loader_->discard(*file);
}

Result<EnvironmentPtr> SceneLibrary::environment(const std::string& path, const StopToken& stop) {
  GOBO_ASSIGN(const std::string real, allowedPath(path, "request.environment.path"));
  const FileStamp stamp = FileStamp::of(real);
  const std::string key = real + "@" + stamp.text();
  if (EnvironmentPtr kept = keptEnvironment(key)) return kept;
  GOBO_ASSIGN(EnvironmentPtr loaded, loader_->environment(real, stop));
  // A file that changed just now may change again under the same stamp: it is not kept.
  if (!stamp.settled() || FileStamp::of(real) != stamp) return loaded;
  GOBO_TRY(keepEnvironment(key, loaded).at(path));
  return loaded;
}

Result<EnvironmentPtr> SceneLibrary::environmentOf(const std::string& sha256, const std::string& file, const StopToken& stop) {
  const std::string key = "sha256:" + sha256;
  if (EnvironmentPtr kept = keptEnvironment(key)) return kept;
  Result<EnvironmentPtr> loaded = loader_->environment(file, stop);
  if (!loaded.ok()) {  // where it is kept is nobody's business
    const auto placeless = [&](std::string text) {
      for (size_t at; (at = text.find(file)) != std::string::npos;) text.replace(at, file.size(), "request.environment.digest");
      return text;
    };
    return Status(loaded.status().code(), placeless(loaded.status().message()), placeless(loaded.status().location()));
  }
  GOBO_TRY(keepEnvironment(key, *loaded).at("request.environment.digest"));
  return loaded;
}

EnvironmentPtr SceneLibrary::keptEnvironment(const std::string& key) {
  std::lock_guard lock(mutex_);
  const auto it = environments_.find(key);
  if (it == environments_.end()) return nullptr;
  it->second.used = ++clock_;
  return it->second.map;
}

Status SceneLibrary::keepEnvironment(const std::string& key, const EnvironmentPtr& loaded) {
  const uint64_t bytes = Map{loaded, 0}.bytes();
  if (bytes > limits_.environmentBytes) return {};
  if (ledger_) GOBO_TRY(ledger_->makeRoom(bytes, "an environment map"));
  std::vector<EnvironmentPtr> gone;
  std::lock_guard lock(mutex_);
  environments_[key] = {loaded, ++clock_};
  trimEnvironments(limits_.environmentBytes, gone);
  return {};
}

void SceneLibrary::trimEnvironments(uint64_t most, std::vector<EnvironmentPtr>& gone) {
  for (;;) {
    uint64_t total = 0;
    auto oldest = environments_.begin();
    for (auto e = environments_.begin(); e != environments_.end(); ++e) {
      total += e->second.bytes();
      if (e->second.used < oldest->second.used) oldest = e;
    }
    if (total <= most) return;
    gone.push_back(std::move(oldest->second.map));
    environments_.erase(oldest);
  }
}

void SceneLibrary::shrinkEnvironments(uint64_t most) {
  std::vector<EnvironmentPtr> gone;
  std::lock_guard lock(mutex_);
  trimEnvironments(most, gone);
}

void SceneLibrary::setRoots(std::vector<std::string> roots) {
  std::lock_guard lock(mutex_);
  roots_ = std::move(roots);
}

uint64_t SceneLibrary::sceneBytes() const {
  std::lock_guard lock(mutex_);
  return sceneBytesHeld();
}

BytesOfCallers SceneLibrary::sceneBytesOfOwners() const {
  std::lock_guard lock(mutex_);
  BytesOfCallers out;
  for (const auto& [id, entry] : scenes_) out[entry.owner] += entry.bytes;
  return out;
}

uint64_t SceneLibrary::environmentBytes() const {
  std::lock_guard lock(mutex_);
  uint64_t total = 0;
  for (const auto& [key, e] : environments_) total += e.bytes();
  return total;
}

size_t SceneLibrary::count() const {
  std::lock_guard lock(mutex_);
  return scenes_.size();
}

}  // namespace plan
}  // namespace gobo
