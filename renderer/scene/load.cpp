// SPDX-License-Identifier: Apache-2.0
#include "scene/load.h"

#include "scene/builtin/build.h"

namespace gobo {
inline namespace scene {
namespace {

struct Builtin {
  const char* name;
  Result<ScenePtr> (*make)(const StopToken&);
};
constexpr Builtin kBuiltins[] = {
    {"cornell", builtin::cornell}, {"furnace", builtin::furnace}, {"grids", builtin::grids}, {"fence", builtin::fence},   {"tentacles", builtin::tentacles},
    {"spheres", builtin::spheres}, {"trees", builtin::trees},     {"lamps", builtin::lamps}, {"atrium", builtin::atrium}, {"lights8", builtin::lights8},
};

}  // namespace

const std::vector<std::string>& builtinSceneNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const Builtin& b : kBuiltins) list.push_back(b.name);
    return list;
  }();
  return names;
}

Result<ScenePtr> makeBuiltinScene(const std::string& name, const StopToken& stop) {
  for (const Builtin& b : kBuiltins)
    if (name == b.name) return b.make(stop);
  std::string list;
  for (const Builtin& b : kBuiltins) list += std::string(list.empty() ? "" : ", ") + b.name;
  return notFound("no built-in scene \"" + name + "\"; there are: " + list);
}

}  // namespace scene
}  // namespace gobo
