// SPDX-License-Identifier: Apache-2.0
// loadGltf: the order of the passes. See document.h for how errors are placed.
#include "scene/gltf/document.h"

namespace gobo {

Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions& options) {
  const auto goOn = [&]() -> Status { return options.stop.stopRequested() ? Status(Code::Cancelled, "the load was cancelled", path) : Status(); };
  try {
    gltf::Document d;
    GOBO_TRY(gltf::openDocument(path, options, d));
    auto scene = std::make_shared<Scene>();
    const size_t from = path.find_last_of('/') + 1;  // npos + 1 = 0
    scene->name = path.substr(from);
    auto rig = std::make_shared<Rig>();
    gltf::Parts parts;
    std::vector<int> place;
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readMaterials(d, *scene));
    GOBO_TRY(gltf::readHierarchy(d, *rig, place));
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readSkins(d, *rig, place));
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readMeshes(d, *scene, *rig, parts));
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readNodes(d, *scene, *rig, parts, place));
    GOBO_TRY(gltf::readAnimations(d, *rig, place));
    GOBO_TRY(goOn());
    gltf::audit(d);
    if (!d.ok()) return d.status;
    if (Status sealed = sealRig(*rig, *scene); !sealed.ok()) return Status(sealed.code(), sealed.message(), path + "#" + sealed.location().substr(scene->name.size() + 1));
    GOBO_TRY(applyRestPose(*rig, *scene));
    if (!rig->animations.empty()) scene->rig = std::move(rig);
    scene->warnings = std::move(d.warnings);
    if (Status sealed = scene->seal(); !sealed.ok()) return Status(sealed.code(), sealed.message(), path + "#" + sealed.location().substr(std::min(sealed.location().size(), scene->name.size() + 1)));
    return ScenePtr(std::move(scene));
  } catch (const std::bad_alloc&) {
    return Status(Code::ResourceExhausted, "out of memory", path);
  } catch (const std::exception& e) {
    return internalError(std::string("reading failed: ") + e.what(), path);
  }
}

}  // namespace gobo
