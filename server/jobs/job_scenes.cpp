// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_scenes.h"

#include <filesystem>

#include "base/descriptor.h"
#include "base/image_io.h"
#include "base/mapped_file.h"
#include "scene/scene.h"
#include "server/file_digest.h"

namespace gobo {

namespace fs = std::filesystem;

namespace {

/// A file under FOLDER/scenes that begins with the digest of an "upload:DIGEST.ext" source.
std::string keptUpload(const std::string& folder, const std::string& source) {
  const std::string digest = source.substr(7, 16);
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (const std::string name = it->path().filename().string(); digest.size() == 16 && name.rfind(digest, 0) == 0) return name;
  return {};
}

/// A scene whose mapped file broke is loaded again.
bool readable(const Scene& scene) { return !scene.file || scene.file->intact(); }

}  // namespace

Result<std::string> JobScenes::environmentDigest(const v1::RenderRequest& request, const StopToken& stop) const {
  const std::string& path = request.environment().path();
  if (path.empty() || path == "none") return std::string();
  GOBO_ASSIGN(const std::string real, engine_.allowedPath(path, "request.environment.path"));
  GOBO_ASSIGN(const int opened, openRegular(real));
  const Descriptor fd(opened);
  return fileDigest(fd.get(), real, {inputBytes_, "ingest.input_bytes"}, stop);
}

Status JobScenes::describe(NewJob& job, const SceneAccess& access, const StopToken& stop) {
  const v1::RenderRequest& request = job.spec.request();
  GOBO_ASSIGN(const v1::SceneInfo info, engine_.inspectScene(request.scene(), access));
  job.sceneSource = info.source();
  if (job.sceneSource.rfind("upload:", 0) == 0) {
    job.sceneFile = keptUpload(files_.scenePath(""), job.sceneSource);
    if (job.sceneFile.empty())
      return {Code::FailedPrecondition, "the uploaded file of scene '" + request.scene() + "' is not kept any more: upload it again", "job.request.scene"};
    GOBO_TRY(files_.adopt("", files_.scenePath(job.sceneFile)));  // young again: not swept before the job is in the store
  }
  GOBO_ASSIGN(job.environmentDigest, environmentDigest(request, stop));
  return {};
}

Result<ScenePtr> JobScenes::get(const JobRecord& record) {
  const v1::RenderRequest& request = record.job.spec().request();
  const std::string& wanted = record.job.scene_hash();
  GOBO_ASSIGN(const std::string environment, environmentDigest(request, {}));
  if (environment != record.environmentDigest)
    return Status(Code::FailedPrecondition,
                  "environment '" + request.environment().path() + "' changed since the job was submitted: its file had sha256 " + record.environmentDigest +
                      ", now " + environment,
                  "request.environment.path");
  std::string loadedHash;
  if (auto scene = engine_.scene(request.scene()); scene.ok()) {
    loadedHash = (*scene)->hash().hex();
    if (loadedHash == wanted && readable(**scene)) return scene;
  }
  const std::lock_guard lock(mutex_);
  if (cached_ && cachedHash_ == wanted && readable(*cached_)) return cached_;
  const bool kept = !record.sceneFile.empty();
  auto scene = engine_.loadScene(kept ? files_.scenePath(record.sceneFile) : record.sceneSource, kept);
  if (!scene.ok())
    return Status(scene.status().code(),
                  "scene '" + request.scene() + "' of the job cannot be loaded again from " + record.sceneSource + ": " + scene.status().message(),
                  "request.scene");
  const std::string hash = (*scene)->hash().hex();
  if (hash != wanted)
    return Status(Code::FailedPrecondition,
                  "scene '" + request.scene() + "' changed since the job was submitted: it had hash " + wanted + ", " + record.sceneSource + " has " + hash +
                      (loadedHash.empty() ? "" : ", the loaded scene " + loadedHash),
                  "request.scene");
  cachedHash_ = wanted;
  cached_ = *scene;
  return scene;
}

}  // namespace gobo
