// SPDX-License-Identifier: Apache-2.0
// Drake's glTF Render Client-Server API over the door's channel (docs/drake.md): a form with a glTF file and a measured camera becomes an upload and
// a render of the service, whose picture becomes a PNG or a TIFF. A file whose SHA-256 came before is not uploaded, so not parsed, again.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include <grpcpp/grpcpp.h>

#include "base/status.h"
#include "gobo/v1/service.grpc.pb.h"
#include "server/door/gltf_form.h"
#include "server/shared_limit.h"

namespace gobo {
inline namespace door {

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
  std::string body;                         ///< a whole picture, or a sentence
  long retrySeconds = 0;                    ///< of refusals that pass
  std::unique_ptr<SharedLimit::Hold> held;  ///< the picture's memory, until the client has it
};

/// Who asks: a name for its share of memory and scenes, what dresses its calls (also those that outlive its connection: it holds no part of that),
/// whether it has hung up, whether the door closes.
struct GltfCaller {
  std::string key;
  std::function<void(grpc::ClientContext&)> dress;
  std::function<bool()> gone, stopping;
};

/// Thread-safe; a call blocks until the picture is there.
class GltfRenderer {
 public:
  static constexpr uint64_t kHeldBytes = 512ull << 20;   ///< of forms at once, and of pictures, of which one caller has half
  static constexpr uint64_t kSceneBytes = 256ull << 20;  ///< of one file at most
  static constexpr uint64_t kPixels = 1ull << 24;        ///< of one picture
  static constexpr uint64_t kLabelPixels = 1ull << 23;   ///< of one picture of labels, which takes more memory a pixel
  static constexpr size_t kScenes = 8;                   ///< that stay loaded for one caller
  static constexpr size_t kCallers = 64;                 ///< of whom scenes are remembered
  static constexpr size_t kFormOverhead = 64 << 10;      ///< what a form is longer than its file

  /// `sceneBytes`: of one file; asked for each form.
  GltfRenderer(const std::shared_ptr<grpc::Channel>& channel, std::function<uint64_t()> sceneBytes);
  uint64_t sceneBytes() const { return std::min(sceneBytes_(), kSceneBytes); }
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
  struct Loaded {
    std::string caller, id;
    std::function<void(grpc::ClientContext&)> dress;
  };
  enum class Turn { Known, Mine, Gone };
  std::string knownScene(const std::string& key, const std::string& sha256);
  Turn takeTurn(const GltfCaller& caller, const std::string& sha256, std::string& id);
  void endTurn(const GltfCaller& caller, const std::string& sha256);
  void forget(const GltfCaller& caller, const std::string& id);
  std::list<Loaded> remember(const GltfCaller& caller, const std::string& sha256, const std::string& id);
  void unload(const GltfCaller& caller, const Loaded& scene);
  GltfAnswer loaded(const GltfCaller& caller, GltfForm& form, std::string& id);
  grpc::Status exists(const GltfCaller& caller, const std::string& id, long& retryMs);
  grpc::Status upload(const GltfCaller& caller, const GltfForm& form, v1::SceneInfo& info, long& retryMs);
  grpc::Status pictures(const GltfCaller& caller, const v1::RenderRequest& request, Pictures& out, long& retryMs);
  static GltfAnswer encoded(const GltfRequest& request, Pictures& made);

  const std::function<uint64_t()> sceneBytes_;
  SharedLimit forms_, pictures_;  // bytes
  std::unique_ptr<v1::Scenes::Stub> scenes_;
  std::unique_ptr<v1::Render::Stub> render_;
  std::mutex mutex_;
  std::condition_variable turns_;
  std::set<std::pair<std::string, std::string>> uploading_;  // caller and file: a second one of the same file waits, and finds it known
  struct Caller {
    std::string key;
    std::function<void(grpc::ClientContext&)> dress;  // of its last upload
    std::list<Known> scenes;                          // the last used first
  };
  std::list<Caller> callers_;  // the last used first
};

}  // namespace door
}  // namespace gobo
