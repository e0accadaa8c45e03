// SPDX-License-Identifier: Apache-2.0
#include "import/load.h"

#include <cctype>

namespace gobo {
inline namespace imports {
namespace {

bool endsWith(const std::string& text, std::string_view tail) {
  if (text.size() < tail.size()) return false;
  for (size_t i = 0; i < tail.size(); ++i)
    if (std::tolower(uint8_t(text[text.size() - tail.size() + i])) != tail[i]) return false;
  return true;
}

class InProcess final : public SceneLoader {
 public:
  explicit InProcess(const LoadOptions& options) : options_(options) {}
  Result<LoadedScene> scene(const std::string& path, const StopToken& stop) override {
    LoadTimes times;
    LoadOptions options = options_;
    options.times = &times;
    options.stop = stop;
    GOBO_ASSIGN(ScenePtr made, loadGltf(path, options));
    LoadedScene loaded;
    loaded.scene = std::move(made);
    loaded.report.parseMs = times.parseMs;
    loaded.report.textureMs = times.textureMs;
    return loaded;
  }
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken& stop) override { return loadEnvironment(path, stop); }

 private:
  LoadOptions options_;
};

}  // namespace

Result<ScenePtr> loadScene(const std::string& nameOrPath, const LoadOptions& options) {
  if (endsWith(nameOrPath, ".gltf") || endsWith(nameOrPath, ".glb")) return loadGltf(nameOrPath, options);
  return makeBuiltinScene(nameOrPath, options.stop);
}

std::shared_ptr<SceneLoader> inProcessLoader(const LoadOptions& options) { return std::make_shared<InProcess>(options); }

}  // namespace imports
}  // namespace gobo
