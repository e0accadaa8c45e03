// SPDX-License-Identifier: Apache-2.0
// The key of a path tracer's terms has every setting in it: what a setting does shows in some scenes only (the height of an orthographic
// camera), so the digest itself is asked.
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <type_traits>

#include "scene/fields.h"
#include "trace/path_tracer.h"

namespace gobo {
namespace {

std::string digest(const PathTracerSettings& s) {
  Hasher h("settings");
  s.hash(h);
  return h.digest().hex();
}

PathTracerSettings base() {
  PathTracerSettings s;
  s.width = 7;
  s.height = 5;
  s.groups = 2;
  s.groupOf = {0, 1};
  s.nominal = {Vec3(1.0f, 2.0f, 3.0f), Vec3(4.0f)};
  return s;
}

struct Change {
  template <typename T>
  void operator()(const char*, T& field) const {
    if constexpr (std::is_same_v<T, bool>) field = !field;
    else if constexpr (std::is_same_v<T, Vec2>) field.y += 0.25f;
    else if constexpr (std::is_same_v<T, Mat4>) field[3].x += 1.0f;
    else field += 0.25f;
  }
};

TEST(PathTracerSettings, EveryFieldIsInTheKey) {
  std::map<std::string, PathTracerSettings> changed;
  const auto change = [&](const std::string& what, const std::function<void(PathTracerSettings&)>& edit) { edit(changed[what] = base()); };
  int cameraFields = 0;
  {
    Camera probe;
    visitFields(probe, [&](const char*, auto&) { ++cameraFields; });
  }
  for (int k = 0; k < cameraFields; ++k)
    change("camera field " + std::to_string(k), [k](PathTracerSettings& s) {
      int i = 0;
      visitFields(s.camera, [&](const char* name, auto& field) {
        if (i++ == k) Change()(name, field);
      });
    });
  change("camera.centre.x", [](PathTracerSettings& s) { s.camera.centre.x += 0.25f; });
  change("camera.optics.focal", [](PathTracerSettings& s) { s.camera.optics.focal = 1.5; });
  change("camera.optics.pixelAspect", [](PathTracerSettings& s) { s.camera.optics.pixelAspect = 1.5f; });
  change("camera.optics.clipNear", [](PathTracerSettings& s) { s.camera.optics.clipNear = 0.5f; });
  change("camera.optics.clipFar", [](PathTracerSettings& s) { s.camera.optics.clipFar = 50.0f; });
  change("camera.optics.panorama", [](PathTracerSettings& s) { s.camera.optics.panorama = true; });
  change("camera.optics.lensRadius", [](PathTracerSettings& s) { s.camera.optics.lensRadius = 0.5f; });
  change("camera.optics.focus", [](PathTracerSettings& s) { s.camera.optics.lensRadius = s.camera.optics.focus = 0.5f; });
  change("width", [](PathTracerSettings& s) { ++s.width; });
  change("height", [](PathTracerSettings& s) { ++s.height; });
  change("viewSamples", [](PathTracerSettings& s) { ++s.viewSamples; });
  change("maxBounces", [](PathTracerSettings& s) { ++s.maxBounces; });
  change("rouletteStart", [](PathTracerSettings& s) { ++s.rouletteStart; });
  change("blockSize", [](PathTracerSettings& s) { ++s.blockSize; });
  change("seed", [](PathTracerSettings& s) { ++s.seed; });
  change("behindOnly", [](PathTracerSettings& s) { s.behindOnly = !s.behindOnly; });
  change("unlit", [](PathTracerSettings& s) { s.unlit = !s.unlit; });
  change("cover", [](PathTracerSettings& s) { s.cover = PathClass::Direct; });
  change("split", [](PathTracerSettings& s) { s.split = SplitMode::ByLobe; });
  change("selection", [](PathTracerSettings& s) { s.selection = LightSelection::Power; });
  for (const SamplerKind kind : {SamplerKind::Halton, SamplerKind::Independent})
    change("sampler " + std::to_string(int(kind)), [kind](PathTracerSettings& s) { s.sampler = kind; });
  change("groups", [](PathTracerSettings& s) { ++s.groups; });
  change("groupOf", [](PathTracerSettings& s) { s.groupOf = {1, 0}; });
  for (int c = 0; c < 3; ++c) change("nominal " + std::to_string(c), [c](PathTracerSettings& s) { s.nominal[1][c] += 1.0f; });
  change("nominal of none", [](PathTracerSettings& s) {
    s.nominal.pop_back();
    s.groupOf.pop_back();
  });
  std::map<std::string, std::string> seen{{digest(base()), "the base"}};
  for (const auto& [what, settings] : changed) {
    const auto [other, fresh] = seen.emplace(digest(settings), what);
    EXPECT_TRUE(fresh) << what << " has the key of " << other->second;
  }
}

}  // namespace
}  // namespace gobo
