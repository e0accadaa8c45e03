// SPDX-License-Identifier: Apache-2.0
#include "request/mesh_edits.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <sstream>
#include <tuple>

#include "base/closest.h"
#include "request/request.h"
#include "scene/edit.h"
#include "scene/mesh_filters/mesh_filters.h"

namespace gobo {
inline namespace request {

namespace {

constexpr const char* kEveryObject = "*";
constexpr double kHidden = 1e-6;  // m
constexpr size_t kObjectPoll = 1024;
// Scenes are made before requests are admitted, so what an edit may cost is bounded here.
/// Passes of smoothing times triangles of a request, some minutes of a busy core.
constexpr uint64_t kMostTrianglePasses = 1'000'000'000;
/// What an edit takes beside them (weld, clusters, normals: 6 us a triangle and more), in passes (0.16 us).
constexpr uint64_t kPassesOfOthers = 40;
/// Of the arrays of new meshes.
constexpr uint64_t kMostEditedBytes = 1ull << 30;

std::string editPlace(const std::string& name) { return "request.meshes." + name; }

Status unknownObject(const Scene& scene, const std::string& name) {
  std::vector<std::string> known;
  for (const Instance& i : scene.instances) known.push_back(i.name);
  return notFound("no object '" + name + "' in the scene" + didYouMean(name, known) + " (has: " + someOf(known) + ")", editPlace(name));
}

Result<MeshFilter> filterOf(const v1::MeshEdit& e, const std::string& place) {
  MeshFilter f;
  f.cluster = e.cluster();
  f.smooth = e.smooth();
  f.smoothing = e.smoothing() == v1::MeshEdit::LAPLACIAN ? MeshSmoothing::Laplacian : MeshSmoothing::Taubin;
  if (e.has_smooth_step()) f.step = e.smooth_step();
  f.inflate = e.inflate();
  if (f.smooth > 0 && f.smoothing == MeshSmoothing::Taubin && f.step > kLargestTaubinStep) {
    std::ostringstream text;
    text << place << ".smooth_step = " << f.step << ": must be at most " << kLargestTaubinStep << " for TAUBIN, which makes short waves grow with longer steps";
    return invalidArgument(text.str(), place + ".smooth_step");
  }
  return f;
}

/// Size of an object in metres along its own axes.
DVec3 extentOf(const Mesh& mesh, const glm::dmat3& stretch) {
  if (mesh.positions.empty()) return DVec3(0.0);
  DVec3 lo(INFINITY), hi(-INFINITY);
  for (const Vec3& p : mesh.positions) {
    const DVec3 q = stretch * DVec3(p);
    lo = glm::min(lo, q);
    hi = glm::max(hi, q);
  }
  return hi - lo;
}

Status emptied(const FilteredMesh& got, const MeshFilter& f, const std::string& place, const std::string& object, const DVec3& size) {
  std::ostringstream text;
  const bool clustered = got.end == FilteredMesh::End::Clustered;
  if (got.end == FilteredMesh::End::Beyond)
    text << place << ".inflate = " << f.inflate << ": moves a vertex of '" << object << "' more than 1e9 m from its origin";
  else if (clustered) text << place << ".cluster = " << f.cluster << ": leaves no triangle of '" << object << "'";
  else text << place << ".smooth = " << f.smooth << ": shrinks '" << object << "' to nothing";
  if (got.end != FilteredMesh::End::Beyond) text << ", which is " << size.x << " x " << size.y << " x " << size.z << " m large";
  return invalidArgument(text.str(), place + (got.end == FilteredMesh::End::Beyond ? ".inflate" : clustered ? ".cluster" : ".smooth"));
}

/// An edit of a mesh, which the objects of that mesh and scale share.
struct WantedEdit {
  const std::string* name;  ///< of the request's edit
  MeshFilter filter;
  size_t object;  ///< the first one
};
struct EditedMesh {
  MeshPtr to;
  bool unsimplified;
};

/// Equal ones have one result.
using EditKey = std::tuple<const Mesh*, bool, double, uint32_t, MeshSmoothing, double, double, std::array<double, 9>>;
EditKey editKey(const Mesh* mesh, bool everyObject, const MeshFilter& f) {
  std::array<double, 9> stretch;
  for (int k = 0; k < 9; ++k) stretch[size_t(k)] = f.stretch[k / 3][k % 3];
  return {mesh, everyObject, f.cluster, f.smooth, f.smoothing, f.step, f.inflate, stretch};
}

uint64_t passesOfSmoothing(const MeshFilter& f) { return f.step > 0.0 ? f.smooth : 0; }

/// The field that costs the most.
std::string dearestField(const MeshFilter& f) {
  const uint64_t passes = passesOfSmoothing(f);
  if (passes > kPassesOfOthers || (f.cluster == 0.0 && f.inflate == 0.0)) return "smooth";
  return f.cluster > 0.0 ? "cluster" : "inflate";
}
/// ".inflate = 0.1"
std::string dearestSetting(const MeshFilter& f) {
  const std::string field = dearestField(f);
  std::ostringstream text;
  text << "." << field << " = ";
  if (field == "smooth") text << f.smooth;
  else text << (field == "cluster" ? f.cluster : f.inflate);
  return text.str();
}

/// Of arrays that the edited mesh does not share with the given one: a clustered one has none of those, and at most as much.
uint64_t editedBytes(const Mesh& m, const MeshFilter& f) {
  uint64_t bytes = sizeof(Mesh) + m.positions.size() * sizeof(Vec3) + m.normals.size() * sizeof(Vec3) + m.tangents.size() * sizeof(Vec4);
  if (f.cluster == 0.0) return bytes;
  bytes += m.indices.size() * sizeof(uint32_t) + m.colours.size() * sizeof(Vec4);
  for (const Array<Vec2>& set : m.uv) bytes += set.size() * sizeof(Vec2);
  return bytes;
}

/// The longest that an object of this extent along the mesh's axes may be in metres.
double mostLength(const DVec3& extent, const glm::dmat3& stretch) {
  DVec3 most(0.0);
  for (int axis = 0; axis < 3; ++axis) most += glm::abs(stretch[axis]) * extent[axis];
  return glm::length(most);
}

/// What all edits of a request cost, before any is made.
class EditCosts {
 public:
  Status add(const Mesh& mesh, const std::string& name, const MeshFilter& f) {
    ++meshes_;
    passes_ += (passesOfSmoothing(f) + kPassesOfOthers) * mesh.triangles();
    bytes_ += editedBytes(mesh, f);
    if (passes_ <= kMostTrianglePasses && bytes_ <= kMostEditedBytes) return {};
    const std::string setting = editPlace(name) + dearestSetting(f), location = editPlace(name) + "." + dearestField(f);
    std::ostringstream text;
    text << setting << ": with it " << meshes_ << (meshes_ == 1 ? " mesh" : " meshes") << " (objects of other scales have others) would be made of ";
    if (passes_ > kMostTrianglePasses) {
      text << passes_ << " triangles, each counted once a pass of `smooth` and " << kPassesOfOthers << " times for the rest; at most " << kMostTrianglePasses;
      return invalidArgument(text.str(), location);
    }
    text << (bytes_ >> 20) << " MiB; at most " << (kMostEditedBytes >> 20) << " MiB";
    return {Code::ResourceExhausted, text.str(), location};
  }

 private:
  uint64_t meshes_ = 0, passes_ = 0, bytes_ = 0;
};

Result<EditedMesh> editedMesh(const Instance& object, const MeshPtr& mesh, const WantedEdit& wanted, const StopToken& stop) {
  const MeshFilter& filter = wanted.filter;
  EditedMesh out{mesh, false};
  const DVec3 size = extentOf(*mesh, filter.stretch);
  if (!(glm::length(size) >= kHidden)) return out;
  MeshFilter f = filter;
  GOBO_ASSIGN(FilteredMesh got, filterMesh(mesh, f, stop));
  if (got.end == FilteredMesh::End::Clustered && *wanted.name == kEveryObject) {
    f.cluster = 0.0;
    out.unsimplified = true;
    GOBO_ASSIGN(got, filterMesh(mesh, f, stop));
  }
  if (got.end != FilteredMesh::End::Made) return emptied(got, f, editPlace(*wanted.name), object.name, size);
  out.to = got.mesh;
  return out;
}

}  // namespace

Hash128 meshEditsHash(const v1::RenderRequest& request) {
  v1::RenderRequest edits;
  *edits.mutable_meshes() = request.meshes();
  return messageHash(edits);
}

Result<ScenePtr> withMeshEdits(const ScenePtr& scene, const v1::RenderRequest& request, const StopToken& stop) {
  if (request.meshes().empty()) return scene;
  std::vector<std::string> names;  // in order: the first error is always the same one
  for (const auto& [name, edit] : request.meshes()) names.push_back(name);
  std::sort(names.begin(), names.end());
  std::map<std::string, MeshFilter, std::less<>> filters;
  for (const std::string& name : names) {
    if (name != kEveryObject && scene->findInstance(name) < 0) return unknownObject(*scene, name);
    GOBO_ASSIGN(filters[name], filterOf(request.meshes().at(name), editPlace(name)));
  }

  // First what is to be done, then what it costs: a refusal costs nothing.
  const size_t objects = scene->instances.size();
  constexpr size_t kNone = ~size_t(0);
  std::vector<size_t> editOf(objects, kNone);  // in `wanted`
  std::vector<WantedEdit> wanted;
  std::map<EditKey, size_t> known;
  std::vector<std::optional<DVec3>> extents(scene->meshes.size());
  EditCosts costs;
  for (size_t i = 0; i < objects; ++i) {
    if (i % kObjectPoll == 0 && stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    const Instance& object = scene->instances[i];
    auto at = filters.find(object.name);
    if (at == filters.end()) at = filters.find(kEveryObject);
    if (at == filters.end() || at->second.identity()) continue;
    const MeshPtr& mesh = scene->meshes[size_t(object.mesh)];
    MeshFilter filter = at->second;
    filter.stretch = stretchOf(object.toWorld);
    std::optional<DVec3>& extent = extents[size_t(object.mesh)];
    if (!extent) extent = extentOf(*mesh, glm::dmat3(1.0));
    if (!(mostLength(*extent, filter.stretch) >= kHidden)) continue;
    const auto [edit, fresh] = known.try_emplace(editKey(mesh.get(), at->first == kEveryObject, filter), wanted.size());
    if (fresh) {
      GOBO_TRY(costs.add(*mesh, at->first, filter));
      wanted.push_back({&at->first, filter, i});
    }
    editOf[i] = edit->second;
  }
  std::vector<EditedMesh> made;
  for (const WantedEdit& w : wanted) {
    const Instance& object = scene->instances[w.object];
    GOBO_ASSIGN(EditedMesh one, editedMesh(object, scene->meshes[size_t(object.mesh)], w, stop));
    made.push_back(std::move(one));
  }

  std::vector<MeshPtr> meshOf(objects);
  std::string unsimplified;
  bool changed = false;
  for (size_t i = 0; i < objects; ++i) {
    const MeshPtr& mesh = scene->meshes[size_t(scene->instances[i].mesh)];
    meshOf[i] = mesh;
    if (editOf[i] == kNone) continue;
    const EditedMesh& edit = made[editOf[i]];
    changed = changed || edit.to != mesh;
    meshOf[i] = edit.to;
    if (edit.unsimplified) unsimplified += (unsimplified.empty() ? "" : ", ") + scene->instances[i].name;
  }
  if (!changed && unsimplified.empty()) return scene;

  auto edited = editScene(*scene, [&](Scene& s) -> Status {
    // A mesh that all of its objects change together changes in its place; who parts from the others gets one at the end.
    std::vector<MeshPtr> common(s.meshes.size());
    std::vector<char> apart(s.meshes.size(), 0);
    for (size_t i = 0; i < objects; ++i) {
      MeshPtr& mesh = common[size_t(s.instances[i].mesh)];
      if (!mesh) mesh = meshOf[i];
      if (mesh != meshOf[i]) apart[size_t(s.instances[i].mesh)] = 1;
    }
    std::map<const Mesh*, int> atEnd;
    for (size_t i = 0; i < objects; ++i) {
      int& mesh = s.instances[i].mesh;
      if (meshOf[i] == scene->meshes[size_t(mesh)]) continue;
      if (!apart[size_t(mesh)]) {
        s.meshes[size_t(mesh)] = meshOf[i];
        continue;
      }
      const auto [there, fresh] = atEnd.try_emplace(meshOf[i].get(), int(s.meshes.size()));
      if (fresh) s.meshes.push_back(meshOf[i]);
      mesh = there->second;
    }
    if (!unsimplified.empty()) {
      std::ostringstream text;
      text << "request.meshes.*.cluster = " << filters[kEveryObject].cluster << ": would leave nothing of " << unsimplified.substr(0, 300)
           << (unsimplified.size() > 300 ? "..." : "") << ", which stay as fine as they are";
      s.warnings.push_back(text.str());
    }
    return {};
  });
  if (edited.ok()) return edited;
  return Status(edited.status().code(), edited.status().message(), "request.meshes");  // of places that the transform takes beyond 1e9 m
}

}  // namespace request
}  // namespace gobo
