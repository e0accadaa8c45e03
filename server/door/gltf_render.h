// SPDX-License-Identifier: Apache-2.0
// Drake's glTF Render Client-Server API over the door's channel (docs/drake.md): a form with a glTF file and a measured camera becomes an upload and
// a render of the service, whose picture becomes a PNG or a TIFF. A file whose SHA-256 came before is not uploaded, so not parsed, again.
#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include <grpcpp/grpcpp.h>

#include "base/status.h"
#include "gobo/v1/service.grpc.pb.h"
#include "server/door/gltf_form.h"
#include "server/shared_limit.h"

namespace gobo {

struct GltfRequest {
  enum class Image { Color, Depth, Label };
  Image image = Image::Color;
  double minDepth = 0, maxDepth = 0;  ///< m; of depth alone
  v1::RenderRequest render;           ///< without its scene
};

/// The form's text fields as a request. `extra`: JSON of a RenderRequest that the form's fields are laid over, may be empty; depth and labels
/// take from it what says how the scene stands (camera.name, time_s, animation, variant) and scheduling alone.
/// Errors: InvalidArgument naming field and value.
Result<GltfRequest> gltfRequestOf(const std::map<std::string, std::string>& fields, const std::string& extra);

struct GltfAnswer {
  int status = 200;
  const char* type = "text/plain; charset=utf-8";
  std::string body;       ///< a whole picture, or a sentence
  long retrySeconds = 0;  ///< of refusals that pass
};

/// Who asks: what dresses its calls, whether it has hung up, and a name for its share of memory and scenes.
struct GltfCaller {
  std::string key;
  std::function<void(grpc::ClientContext&)> dress;
  std::function<bool()> gone;
};

/// Thread-safe; a call blocks until the picture is there.
class GltfRenderer {
 public:
  static constexpr uint64_t kHeldBytes = 512ull << 20;   ///< of forms at once, and of pictures, of which one caller has half
  static constexpr uint64_t kSceneBytes = 256ull << 20;  ///< of one file at most
  static constexpr uint64_t kPixels = 1ull << 24;        ///< of one picture
  static constexpr size_t kScenes = 8;                   ///< that stay loaded for one caller
  static constexpr size_t kCallers = 64;                 ///< of whom scenes are remembered
  static constexpr size_t kFormOverhead = 64 << 10;      ///< what a form is longer than its file

  /// `sceneBytes`: of one file, 0: none are taken.
  GltfRenderer(const std::shared_ptr<grpc::Channel>& channel, uint64_t sceneBytes);
  uint64_t sceneBytes() const { return sceneBytes_; }
  SharedLimit& forms() { return forms_; }

  /// Whether this caller may ask at all; asks the service.
  GltfAnswer admit(const GltfCaller& caller);
  GltfAnswer render(const GltfCaller& caller, GltfForm& form, const std::string& extra);

 private:
  struct Known {
    std::string sha256, id;
  };
  struct Pictures {
    v1::RenderReply head;
    std::string bytes;  // of all its images, one behind the other
  };
  std::string knownScene(const GltfCaller& caller, const std::string& sha256);
  void forget(const GltfCaller& caller, const std::string& id);
  void remember(const GltfCaller& caller, const std::string& sha256, const std::string& id);
  void unload(const GltfCaller& caller, const std::string& id);
  GltfAnswer loaded(const GltfCaller& caller, const GltfForm& form, std::string& id);
  grpc::Status upload(const GltfCaller& caller, const GltfForm& form, v1::SceneInfo& info, long& retrySeconds);
  grpc::Status pictures(const GltfCaller& caller, const v1::RenderRequest& request, Pictures& out, long& retrySeconds);
  static GltfAnswer encoded(const GltfRequest& request, Pictures& made);

  const uint64_t sceneBytes_;
  SharedLimit forms_, pictures_;  // bytes
  std::unique_ptr<v1::Scenes::Stub> scenes_;
  std::unique_ptr<v1::Render::Stub> render_;
  std::timed_mutex uploading_;  // one at a time: a second one of the same file finds it known
  std::mutex mutex_;
  struct Caller {
    std::string key;
    std::list<Known> scenes;  // the last used first
  };
  std::list<Caller> callers_;  // the last used first
};

}  // namespace gobo
