// SPDX-License-Identifier: Apache-2.0
#include "server/farm/remote_scenes.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>

#include "base/mapped_file.h"
#include "scene/blob.h"
#include "server/farm/messages.h"
#include "server/log.h"

namespace gobo::farm {

namespace fs = std::filesystem;

template <typename Pointer, typename Read>
Result<Pointer> RemoteScenes::have(int64_t job, const std::string& name, const v1::GetFarmFileRequest& wanted, const Read& read) {
  const std::string path = files_.scenePath(name);
  const auto mapped = [&]() -> Result<Pointer> {
    GOBO_ASSIGN(const auto file, MappedFile::open(path));
    return read(file);
  };
  if (auto kept = mapped(); kept.ok()) {
    ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0);  // used: others go first
    return kept;
  } else if (kept.status().code() != Code::NotFound) {
    logWarn("farm: %s is fetched again: %s", path.c_str(), kept.status().toString().c_str());
    files_.remove(path);
  }
  GOBO_TRY(tasks_.fetch(job, wanted, path));
  trim(name);
  return mapped();
}

Result<EnvironmentPtr> RemoteScenes::map(const JobRecord& record) {
  const std::string& digest = record.environmentDigest;
  if (digest.empty()) return EnvironmentPtr();
  if (map_ && mapDigest_ == digest && (!map_->file || map_->file->intact())) return map_;
  v1::GetFarmFileRequest wanted;
  wanted.set_environment(true);
  GOBO_ASSIGN(
      map_, have<EnvironmentPtr>(record.id, "map-" + digest + ".blob", wanted, [](const auto& file) { return readEnvironmentBlob(file, BlobTrust::Foreign); }));
  mapDigest_ = digest;
  return map_;
}

Result<ScenePtr> RemoteScenes::scene(const JobRecord& record) {
  const std::string& hash = record.job.scene_hash();
  if (scene_ && sceneHash_ == hash && (!scene_->file || scene_->file->intact())) return scene_;
  v1::GetFarmFileRequest wanted;
  wanted.set_scene(true);
  GOBO_ASSIGN(scene_, have<ScenePtr>(record.id, "scene-" + hash + ".blob", wanted, [&](const auto& file) -> Result<ScenePtr> {
                GOBO_ASSIGN(const ScenePtr blob, readSceneBlob(file, BlobTrust::Foreign));
                if (blob->hash().hex() == hash) return blob;
                return Status(Code::DataLoss, "the blob is of scene " + blob->hash().hex() + ", wanted is " + hash, "request.scene");
              }));
  sceneHash_ = hash;
  return scene_;
}

Result<TaskScene> RemoteScenes::get(const JobRecord& record) {
  const std::string& hash = record.job.scene_hash();
  if (!isDigest(hash, kXxh128Digits)) return internalError("the coordinator names scene \"" + escaped(hash.substr(0, 80)) + "\"");
  if (!record.environmentDigest.empty() && !isDigest(record.environmentDigest, kSha256Digits))
    return internalError("the coordinator names map \"" + escaped(record.environmentDigest.substr(0, 80)) + "\"");
  // Both in one step: meanwhile another slot may have those of another job fetched.
  const std::lock_guard lock(mutex_);
  GOBO_ASSIGN(const EnvironmentPtr environment, map(record));
  GOBO_ASSIGN(const ScenePtr loaded, scene(record));
  return TaskScene{loaded, environment};
}

void RemoteScenes::trim(const std::string& newest) {
  struct Kept {
    fs::path path;
    fs::file_time_type used;
    uint64_t bytes;
  };
  std::vector<Kept> kept;
  std::error_code error;
  uint64_t sum = 0;
  for (fs::directory_iterator it(files_.scenePath(""), error), end; !error && it != end; it.increment(error)) {
    kept.push_back({it->path(), it->last_write_time(error), it->file_size(error)});
    sum += kept.back().bytes;
  }
  std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) { return a.used < b.used; });
  for (const Kept& file : kept) {
    if (sum <= bytes_) return;
    if (file.path.filename() == newest) continue;
    files_.remove(file.path.string());  // who has it mapped keeps it
    sum -= file.bytes;
  }
}

}  // namespace gobo::farm
