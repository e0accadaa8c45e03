// SPDX-License-Identifier: Apache-2.0
#include "scene/loader.h"

namespace gobo {
namespace {

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

std::shared_ptr<SceneLoader> inProcessLoader(const LoadOptions& options) { return std::make_shared<InProcess>(options); }

}  // namespace gobo
