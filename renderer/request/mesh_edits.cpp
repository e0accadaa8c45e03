// SPDX-License-Identifier: Apache-2.0
#include "request/mesh_edits.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/closest.h"
#include "request/request.h"
#include "scene/edit.h"
#include "scene/mesh_filters/mesh_filters.h"

namespace gobo {
inline namespace request {

namespace {

constexpr const char* kEveryObject = "*";
constexpr double kHidden = 1e-6;  // m
/// Passes times triangles of a request, some minutes of a busy core: scenes are made before requests are admitted.
constexpr uint64_t kMostTrianglePasses = 1'000'000'000;

std::string editPlace(const std::string& name) { return "request.meshes." + name; }

Status unknownObject(const Scene& scene, const std::string& name) {
  std::vector<std::string> known;
  std::string names;
  for (const Instance& i : scene.instances) {
    known.push_back(i.name);
    if (names.size() < 300) names += (names.empty() ? "" : ", ") + i.name;
    else if (!names.ends_with("...")) names += ", ...";
  }
  return notFound("no object '" + name + "' in the scene" + didYouMean(name, known) + " (has: " + (names.empty() ? "none" : names) + ")", editPlace(name));
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

/// Results of one request, so that instances of a mesh share them.
struct EditedMesh {
  MeshPtr from;
  MeshFilter filter;
  bool everyObject;
  MeshPtr to;
  bool unsimplified;
};

bool sameFilter(const MeshFilter& a, const MeshFilter& b) {
  return a.cluster == b.cluster && a.smooth == b.smooth && a.smoothing == b.smoothing && a.step == b.step && a.inflate == b.inflate && a.stretch == b.stretch;
}

Result<EditedMesh> editedMesh(const Instance& object, const MeshPtr& mesh, const MeshFilter& filter, const std::string& name, const StopToken& stop) {
  EditedMesh out{mesh, filter, name == kEveryObject, mesh, false};
  const DVec3 size = extentOf(*mesh, filter.stretch);
  if (!(glm::length(size) >= kHidden)) return out;
  MeshFilter f = filter;
  GOBO_ASSIGN(FilteredMesh got, filterMesh(mesh, f, stop));
  if (got.end == FilteredMesh::End::Clustered && out.everyObject) {
    f.cluster = 0.0;
    out.unsimplified = true;
    GOBO_ASSIGN(got, filterMesh(mesh, f, stop));
  }
  if (got.end != FilteredMesh::End::Made) return emptied(got, f, editPlace(name), object.name, size);
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

  const size_t objects = scene->instances.size();
  std::vector<EditedMesh> made;
  std::vector<MeshPtr> meshOf(objects);
  std::string unsimplified;
  bool changed = false;
  uint64_t work = 0;
  for (size_t i = 0; i < objects; ++i) {
    const Instance& object = scene->instances[i];
    const MeshPtr& mesh = meshOf[i] = scene->meshes[size_t(object.mesh)];
    auto at = filters.find(object.name);
    if (at == filters.end()) at = filters.find(kEveryObject);
    if (at == filters.end() || at->second.identity()) continue;
    MeshFilter filter = at->second;
    filter.stretch = stretchOf(object.toWorld);
    const bool every = at->first == kEveryObject;
    auto known =
        std::find_if(made.begin(), made.end(), [&](const EditedMesh& m) { return m.from == mesh && m.everyObject == every && sameFilter(m.filter, filter); });
    if (known == made.end()) {
      work += uint64_t(filter.smooth) * mesh->triangles();
      if (work > kMostTrianglePasses)
        return invalidArgument(editPlace(at->first) + ".smooth = " + std::to_string(filter.smooth) + ": with it " + std::to_string(work) +
                                   " triangles would be smoothed, counted once a pass; at most " + std::to_string(kMostTrianglePasses),
                               editPlace(at->first) + ".smooth");
      GOBO_ASSIGN(EditedMesh one, editedMesh(object, mesh, filter, at->first, stop));
      known = made.insert(made.end(), std::move(one));
    }
    meshOf[i] = known->to;
    changed = changed || known->to != scene->meshes[size_t(object.mesh)];
    if (known->unsimplified) unsimplified += (unsimplified.empty() ? "" : ", ") + object.name;
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
    for (size_t i = 0; i < objects; ++i) {
      int& mesh = s.instances[i].mesh;
      if (meshOf[i] == scene->meshes[size_t(mesh)]) continue;
      if (!apart[size_t(mesh)]) {
        s.meshes[size_t(mesh)] = meshOf[i];
        continue;
      }
      const auto begin = s.meshes.begin() + std::ptrdiff_t(common.size()), there = std::find(begin, s.meshes.end(), meshOf[i]);
      mesh = int(there - s.meshes.begin());
      if (there == s.meshes.end()) s.meshes.push_back(meshOf[i]);
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
