// SPDX-License-Identifier: Apache-2.0
#include "server/scenes_service.h"

#include <filesystem>

#include "scene/load.h"
#include "server/jobs/durable_jobs.h"
#include "server/rpc.h"
#include "server/upload.h"

namespace gobo {
namespace {

grpc::Status answer(const char* method, const std::string& subject, Result<v1::SceneInfo> result, v1::SceneInfo* reply) {
  if (!result.ok()) {
    const grpc::Status status = toGrpc(result.status());
    logInfo("%s scene=%s status=%s %s", method, subject.c_str(), codeName(result.status().code()), status.error_message().c_str());
    return status;
  }
  *reply = std::move(result).value();
  logInfo("%s scene=%s triangles=%llu ms=%.1f status=OK", method, reply->id().c_str(),
          static_cast<unsigned long long>(reply->triangles()), reply->load_ms());
  return grpc::Status::OK;
}

grpc::Status missing(const char* field) { return toGrpc(invalidArgument("\"\": must not be empty", field)); }

}  // namespace

grpc::Status ScenesService::Open(grpc::ServerContext*, const v1::OpenSceneRequest* request, v1::SceneInfo* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  if (request->source().empty()) return missing("open.source");
  return answer("open", request->source(), core_.engine.openScene(request->source(), request->name()), reply);
}

grpc::Status ScenesService::Upload(grpc::ServerContext* context, grpc::ServerReader<v1::UploadSceneRequest>* reader,
                                   v1::SceneInfo* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  struct Slot {
    std::atomic<uint32_t>& count;
    const uint32_t mine;
    explicit Slot(std::atomic<uint32_t>& c) : count(c), mine(c.fetch_add(1)) {}
    ~Slot() { count.fetch_sub(1); }
  } slot(core_.uploads);
  if (slot.mine >= core_.config.uploadsAtOnce)
    return busy(*context, std::to_string(slot.mine) + " uploads are in progress (limits.uploads_at_once)", 1000);

  UploadFile file;
  std::string name, extension;
  v1::UploadSceneRequest message;
  bool first = true;
  while (reader->Read(&message)) {
    if (call.stop.token().stopRequested()) return drainingStatus();
    Status status;
    if (first) {
      name = message.name();
      extension = message.extension();
      status = file.begin(core_.config.tmpFolder, message, core_.config.uploadBytes);
    }
    first = false;
    if (status.ok()) status = file.add(message.data());
    if (!status.ok()) return answer("upload", name, status, reply);
  }
  if (context->IsCancelled()) return {grpc::StatusCode::CANCELLED, "upload cancelled"};
  if (first) return answer("upload", "", invalidArgument("no message: the first one names extension and total_bytes", "upload"), reply);
  const Status status = file.finish();
  if (!status.ok()) return answer("upload", name, status, reply);
  // The file goes away when this returns: the engine keeps the parsed scene, the jobs folder a link to it.
  const std::string source = "upload:" + file.digest().substr(0, 16) + extension;
  if (core_.durable) {   // jobs of this scene must find it after a restart
    const Status kept = core_.durable->keepUpload(file.path(), file.digest() + std::filesystem::path(file.path()).extension().string());
    if (!kept.ok()) return answer("upload", name, kept, reply);
  }
  return answer("upload", name, core_.engine.openUploaded(file.path(), source, name), reply);
}

grpc::Status ScenesService::List(grpc::ServerContext*, const v1::ListScenesRequest*, v1::ListScenesReply* reply) {
  for (v1::SceneInfo& info : core_.engine.listScenes()) *reply->add_scenes() = std::move(info);
  for (const std::string& name : builtinSceneNames()) reply->add_builtin(name);
  return grpc::Status::OK;
}

grpc::Status ScenesService::Inspect(grpc::ServerContext*, const v1::InspectSceneRequest* request, v1::SceneInfo* reply) {
  if (request->scene().empty()) return missing("inspect.scene");
  auto result = core_.engine.inspectScene(request->scene());
  if (!result.ok()) return toGrpc(result.status());
  *reply = std::move(result).value();
  return grpc::Status::OK;
}

grpc::Status ScenesService::Patch(grpc::ServerContext*, const v1::PatchSceneRequest* request, v1::SceneInfo* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  if (request->scene().empty()) return missing("patch.scene");
  return answer("patch", request->scene(), core_.engine.patchScene(*request), reply);
}

grpc::Status ScenesService::Unload(grpc::ServerContext*, const v1::UnloadSceneRequest* request, v1::UnloadSceneReply*) {
  if (request->scene().empty()) return missing("unload.scene");
  const Status status = core_.engine.unloadScene(request->scene());
  logInfo("unload scene=%s status=%s", request->scene().c_str(), codeName(status.code()));
  return toGrpc(status);
}

}  // namespace gobo
