// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_scenes.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "base/descriptor.h"
#include "base/image_io.h"
#include "base/mapped_file.h"
#include "scene/scene.h"
#include "server/file_digest.h"

namespace gobo {
inline namespace jobs {

namespace fs = std::filesystem;

namespace {

/// The file under FOLDER/scenes of an "upload:DIGEST.ext" or "blobs:DIGEST/NAME" source.
std::string keptUpload(const std::string& folder, const std::string& source) {
  const std::string digest = keptSceneDigest(source), file = source.rfind("blobs:", 0) == 0 ? source.substr(22) : "";
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (name.rfind(digest, 0) == 0 && it->is_directory(error) == !file.empty()) return name + file;
  }
  return {};
}

/// A scene whose mapped file broke is loaded again.
bool readable(const Scene& scene) { return !scene.file || scene.file->intact(); }

}  // namespace

std::string keptSceneDigest(const std::string& source) {
  const std::string digest = source.rfind("upload:", 0) == 0 ? source.substr(7, 16) : source.rfind("blobs:", 0) == 0 ? source.substr(6, 16) : "";
  return digest.size() == 16 ? digest : "";
}

std::string JobScenes::environmentFile(const v1::RenderRequest& request) const {
  if (!request.environment().has_digest()) return {};
  std::string digest = request.environment().digest();
  std::transform(digest.begin(), digest.end(), digest.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  std::error_code error;
  const std::string exr = files_.scenePath(digest + ".exr");
  return fs::exists(exr, error) ? exr : files_.scenePath(digest + ".hdr");
}

Result<std::string> JobScenes::environmentDigest(const v1::RenderRequest& request, const StopToken& stop) const {
  if (const std::string kept = environmentFile(request); !kept.empty()) {
    auto opened = openRegular(kept);
    if (!opened.ok())
      return Status(Code::FailedPrecondition, "the file of environment.digest = " + request.environment().digest() + " is not kept any more: put it again",
                    "request.environment.digest");
    const Descriptor fd(*opened);
    return fileDigest(fd.get(), request.environment().digest(), {inputBytes_, "ingest.input_bytes"}, stop);
  }
  const std::string& path = request.environment().path();
  if (path.empty() || path == "none") return std::string();
  GOBO_ASSIGN(const std::string real, engine_.allowedPath(path, "request.environment.path"));
  GOBO_ASSIGN(const int opened, openRegular(real));
  const Descriptor fd(opened);
  return fileDigest(fd.get(), real, {inputBytes_, "ingest.input_bytes"}, stop);
}

Status JobScenes::describe(NewJob& job, const SceneAccess& access, const StopToken& stop, const std::string& environmentFile) {
  const v1::RenderRequest& request = job.spec.request();
  GOBO_ASSIGN(const v1::SceneInfo info, engine_.inspectScene(request.scene(), access));
  job.sceneSource = info.source();
  if (!keptSceneDigest(job.sceneSource).empty()) {
    job.sceneFile = keptUpload(files_.scenePath(""), job.sceneSource);
    if (job.sceneFile.empty())
      return {Code::FailedPrecondition, "the uploaded file of scene '" + request.scene() + "' is not kept any more: upload it again", "job.request.scene"};
    GOBO_TRY(files_.adopt("", files_.scenePath(job.sceneFile.substr(0, job.sceneFile.find('/')))));  // young again: not swept before the job is in the store
  }
  if (request.environment().has_digest()) {
    std::string digest = request.environment().digest();
    std::transform(digest.begin(), digest.end(), digest.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    GOBO_TRY(files_.adopt(environmentFile, files_.scenePath(digest + fs::path(environmentFile).extension().string())));
  }
  GOBO_ASSIGN(job.environmentDigest, environmentDigest(request, stop));
  return {};
}

Status JobScenes::keepAgain(const JobRecord& record) {
  std::vector<std::string> files;
  if (!record.sceneFile.empty()) files.push_back(files_.scenePath(record.sceneFile.substr(0, record.sceneFile.find('/'))));
  if (const std::string map = environmentFile(record.job.spec().request()); !map.empty()) files.push_back(map);
  for (const std::string& file : files) {
    std::error_code error;
    if (!fs::exists(file, error))
      return {Code::FailedPrecondition, "an uploaded file of " + jobIdText(record.id) + " is not kept any more: upload it and submit the job again", "id"};
    GOBO_TRY(files_.adopt("", file));
  }
  return {};
}

Result<EnvironmentPtr> JobScenes::map(const JobRecord& record, const StopToken& stop) {
  if (record.environmentDigest.empty()) return EnvironmentPtr();
  const v1::RenderRequest& request = record.job.spec().request();
  return engine_.mapOf(request.environment(), environmentFile(request), stop);
}

Result<TaskScene> JobScenes::get(const JobRecord& record) {
  GOBO_ASSIGN(const ScenePtr loaded, scene(record));
  return TaskScene{loaded, environmentFile(record.job.spec().request())};
}

Result<ScenePtr> JobScenes::scene(const JobRecord& record) {
  const v1::RenderRequest& request = record.job.spec().request();
  const std::string& wanted = record.job.scene_hash();
  GOBO_ASSIGN(const std::string environment, environmentDigest(request, {}));
  if (environment != record.environmentDigest)
    return Status(Code::FailedPrecondition,
                  "environment '" + request.environment().path() + request.environment().digest() +
                      "' changed since the job was submitted: its file had sha256 " + record.environmentDigest + ", now " + environment,
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

}  // namespace jobs
}  // namespace gobo
