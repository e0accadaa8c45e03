// SPDX-License-Identifier: Apache-2.0
#include "server/scenes_service.h"

#include <filesystem>
#include <optional>

#include "scene/load.h"
#include "server/file_store.h"
#include "server/jobs/durable_jobs.h"
#include "server/limits.h"
#include "server/scratch.h"
#include "server/upload.h"

namespace gobo {
inline namespace server {
namespace {

grpc::Status answer(Rpc& rpc, Result<v1::SceneInfo> result, v1::SceneInfo* reply) {
  if (!result.ok()) return toGrpc(result.status());
  *reply = std::move(result).value();
  rpc.note("id", reply->id());
  rpc.note("triangles", std::to_string(reply->triangles()));
  return grpc::Status::OK;
}

// Runs `load` behind the gate; a client that goes away, or the end of a drain, stops it between phases.
template <typename Load>
grpc::Status gated(Rpc& rpc, ServerCore::Call& call, v1::SceneInfo* reply, const Load& load) {
  std::optional<Result<v1::SceneInfo>> result;
  const Status status = rpc.core().loads.run(
      rpc.who().name,
      [&](const StopToken& stop) -> Status {
        result.emplace(load(stop));
        return {};
      },
      [&] { return rpc.context().IsCancelled() || call.stop.token().stopRequested(); });
  if (call.stop.token().stopRequested() && rpc.core().draining()) return rpc.refuseDraining();
  if (status.code() == Code::ResourceExhausted) return rpc.refuseBusy("loads", status.message(), 1000);
  if (!status.ok()) return toGrpc(status);
  return answer(rpc, std::move(*result), reply);
}

constexpr size_t kMostFiles = 10001;  // of one scene: its own and those beside it (server/ingest_child.h)

grpc::Status missing(const char* field) { return toGrpc(invalidArgument("\"\": must not be empty", field)); }

}  // namespace

grpc::Status ScenesService::Open(grpc::ServerContext* context, const v1::OpenSceneRequest* request, v1::SceneInfo* reply) {
  return serve(core_, *context, "open", [&](Rpc& rpc) -> grpc::Status {
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    if (request->source().empty()) return missing("open.source");
    rpc.note("source", request->source());
    if (request->files_size() > 0) return openFiles(rpc, call, *request, reply);
    const grpc::Status allowed = checkPath(rpc, request->source(), "open.source");
    if (!allowed.ok()) return allowed;
    return gated(rpc, call, reply, [&](const StopToken& stop) {
      return core_.engine.openScene(request->source(), request->name(), stop, rpc.access(), {request->share().begin(), request->share().end()});
    });
  });
}

grpc::Status ScenesService::openFiles(Rpc& rpc, ServerCore::Call& call, const v1::OpenSceneRequest& request, v1::SceneInfo* reply) {
  const std::map<std::string, std::string> files(request.files().begin(), request.files().end());
  if (files.size() > kMostFiles) return toGrpc(invalidArgument(strf("open.files: %zu files, at most %zu", files.size(), kMostFiles), "open.files"));
  if (const Status names = checkFileNames(files, request.source()); !names.ok()) return toGrpc(names);
  auto tree = core_.files->tree(rpc.renderOwner(), files, "open.files", call.stop.token());
  if (!tree.ok()) return toGrpc(tree.status());
  const std::shared_ptr<const FileTree> held = *tree;
  if (core_.durable) {  // jobs of this scene must find it after a restart
    if (const Status kept = core_.durable->keepTree(held->folder(), held->key()); !kept.ok()) return toGrpc(kept);
  }
  const std::string source = "blobs:" + held->key().substr(0, 16) + "/" + request.source();
  return gated(rpc, call, reply, [&](const StopToken& stop) -> Result<v1::SceneInfo> {
    auto opened = core_.engine.openUploaded(held->path(request.source()), source, request.name(), stop, rpc.access(),
                                            {request.share().begin(), request.share().end()}, held);
    return opened.ok() ? opened : withoutFolder(opened.status(), held->folder());
  });
}

grpc::Status ScenesService::Upload(grpc::ServerContext* context, grpc::ServerReader<v1::UploadSceneRequest>* reader, v1::SceneInfo* reply) {
  return serve(core_, *context, "upload", [&](Rpc& rpc) { return upload(rpc, *reader, reply); });
}

grpc::Status ScenesService::upload(Rpc& rpc, grpc::ServerReader<v1::UploadSceneRequest>& reader, v1::SceneInfo* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return rpc.refuseDraining();
  const auto slot = core_.uploads.take(rpc.who().name, 1);
  if (!slot) return rpc.refuseFull("uploads", "uploads are in progress", core_.uploads, "limits.uploads_at_once", 1000);

  UploadFile file;
  std::string name, extension;
  std::vector<std::string> share;
  v1::UploadSceneRequest message;
  bool first = true;
  const auto next = [&] {
    const IdleWatch::Wait wait(core_.idle, rpc.context());
    return reader.Read(&message);
  };
  while (next()) {
    if (call.stop.token().stopRequested()) return rpc.refuseDraining();
    Status status;
    if (first) {
      name = message.name();
      extension = message.extension();
      share.assign(message.share().begin(), message.share().end());
      const UploadLimit limit = uploadLimit(rpc);
      status = file.begin(core_.config.tmpFolder, message, limit.bytes, limit.key);
      if (status.code() == Code::ResourceExhausted) return rpc.refuse("upload_bytes", status);
    }
    first = false;
    if (status.ok()) status = file.add(message.data());
    if (!status.ok()) return toGrpc(status);
    core_.metrics.add("gobo_upload_bytes_total", {}, double(message.data().size()));
  }
  if (rpc.context().IsCancelled())
    return {grpc::StatusCode::CANCELLED, strf("upload cancelled, by its client or because nothing came for %g s (limits.client_idle_s)", core_.idle.seconds())};
  if (first) return toGrpc(invalidArgument("no message: the first one names extension and total_bytes", "upload"));
  const Status status = file.finish();
  if (!status.ok()) return toGrpc(status);
  rpc.note("sha256", file.digest());
  // The file goes away when this returns: the engine keeps the parsed scene, the jobs folder a link to it.
  const std::string source = "upload:" + file.digest().substr(0, 16) + extension;
  if (core_.durable) {  // jobs of this scene must find it after a restart
    const Status kept = core_.durable->keepUpload(file.path(), file.digest() + std::filesystem::path(file.path()).extension().string());
    if (!kept.ok()) return toGrpc(kept);
  }
  return gated(rpc, call, reply, [&](const StopToken& stop) -> Result<v1::SceneInfo> {
    auto opened = core_.engine.openUploaded(file.path(), source, name, stop, rpc.access(), share);
    return opened.ok() ? opened : withoutFolder(opened.status(), std::filesystem::path(file.path()).parent_path().string());
  });
}

grpc::Status ScenesService::List(grpc::ServerContext* context, const v1::ListScenesRequest*, v1::ListScenesReply* reply) {
  return serve(core_, *context, "list", [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    for (v1::SceneInfo& info : core_.engine.listScenes(rpc.access())) *reply->add_scenes() = std::move(info);
    for (const std::string& name : builtinSceneNames()) reply->add_builtin(name);
    return grpc::Status::OK;
  });
}

grpc::Status ScenesService::Inspect(grpc::ServerContext* context, const v1::InspectSceneRequest* request, v1::SceneInfo* reply) {
  return serve(core_, *context, "inspect", [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    if (request->scene().empty()) return missing("inspect.scene");
    return answer(rpc, core_.engine.inspectScene(request->scene(), rpc.access()), reply);
  });
}

grpc::Status ScenesService::Patch(grpc::ServerContext* context, const v1::PatchSceneRequest* request, v1::SceneInfo* reply) {
  return serve(core_, *context, "patch", [&](Rpc& rpc) -> grpc::Status {
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    if (request->scene().empty()) return missing("patch.scene");
    rpc.note("scene", request->scene());
    return gated(rpc, call, reply, [&](const StopToken& stop) { return core_.engine.patchScene(*request, stop, rpc.access()); });
  });
}

grpc::Status ScenesService::Unload(grpc::ServerContext* context, const v1::UnloadSceneRequest* request, v1::UnloadSceneReply*) {
  return serve(core_, *context, "unload", [&](Rpc& rpc) -> grpc::Status {
    if (request->scene().empty()) return missing("unload.scene");
    rpc.note("scene", request->scene());
    return toGrpc(core_.engine.unloadScene(request->scene(), rpc.access()));
  });
}

}  // namespace server
}  // namespace gobo
