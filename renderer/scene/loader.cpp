// SPDX-License-Identifier: Apache-2.0
#include "scene/loader.h"

namespace gobo {
inline namespace scene {
namespace {

class NoLoader final : public SceneLoader {
 public:
  Result<LoadedScene> scene(const std::string& path, const StopToken&) override { return refusal(path); }
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken&) override { return refusal(path); }

 private:
  static Status refusal(const std::string& path) { return Status(Code::Unimplemented, "this program reads no files: its engine has no loader", path); }
};

}  // namespace

std::shared_ptr<SceneLoader> noLoader() { return std::make_shared<NoLoader>(); }

}  // namespace scene
}  // namespace gobo
