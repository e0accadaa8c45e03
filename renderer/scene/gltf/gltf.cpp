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
    std::vector<std::vector<int>> parts;
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readMaterials(d, *scene));
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readMeshes(d, *scene, parts));
    GOBO_TRY(goOn());
    GOBO_TRY(gltf::readNodes(d, *scene, parts));
    if (d.list("animations").size() > 0) d.warn("/animations", "animations are ignored");
    if (!d.ok()) return d.status;
    GOBO_TRY(goOn());
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
