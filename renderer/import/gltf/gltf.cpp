// SPDX-License-Identifier: Apache-2.0
// loadGltf: the order of the passes. See document.h for how errors are placed.
#include <chrono>

#include "base/utf8.h"
#include "import/gltf/document.h"
#include "scene/mipmap.h"

namespace gobo {
inline namespace imports {
namespace {

Result<ScenePtr> load(const std::string& path, const LoadOptions& options) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  double textureMs = 0;
  const auto timed = [&](auto&& work) {
    const auto from = Clock::now();
    auto result = work();
    textureMs += std::chrono::duration<double, std::milli>(Clock::now() - from).count();
    return result;
  };
  const auto goOn = [&]() -> Status { return options.stop.stopRequested() ? Status(Code::Cancelled, "the load was cancelled", path) : Status(); };
  try {
    gltf::Document d;
    GOBO_TRY(gltf::openDocument(path, options, d));
    auto scene = std::make_shared<Scene>();
    const size_t from = path.find_last_of('/') + 1;  // npos + 1 = 0
    scene->name = cleanUtf8(path.substr(from));
    auto rig = std::make_shared<Rig>();
    gltf::Parts parts;
    std::vector<int> place;
    GOBO_TRY(goOn());
    GOBO_TRY(timed([&] { return gltf::readMaterials(d, *scene); }));
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
    if (Status sealed = sealRig(*rig, *scene); !sealed.ok())
      return Status(sealed.code(), sealed.message(), path + "#" + sealed.location().substr(scene->name.size() + 1));
    GOBO_TRY(applyRestPose(*rig, *scene, options.stop));
    if (!rig->animations.empty()) scene->rig = std::move(rig);
    for (std::string& w : d.warnings) scene->warnings.push_back(cleanUtf8(std::move(w)));
    timed([&] {
      finishTextures(*scene, options.textureBytes, options.stop);
      return 0;
    });
    GOBO_TRY(goOn());
    if (Status sealed = scene->seal(); !sealed.ok())
      return Status(sealed.code(), sealed.message(), path + "#" + sealed.location().substr(std::min(sealed.location().size(), scene->name.size() + 1)));
    if (options.times) *options.times = {std::chrono::duration<double, std::milli>(Clock::now() - start).count() - textureMs, textureMs};
    return ScenePtr(std::move(scene));
  } catch (const std::bad_alloc&) { return Status(Code::ResourceExhausted, "out of memory", path); } catch (const std::exception& e) {
    return internalError(std::string("reading failed: ") + e.what(), path);
  }
}

}  // namespace

// Escaped names, cut quotations and what libraries quote may hold any byte: here is where it becomes text.
Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions& options) {
  auto scene = load(path, options);
  if (!scene.ok()) return cleanUtf8(scene.status());
  return scene;
}

}  // namespace imports
}  // namespace gobo
