// SPDX-License-Identifier: Apache-2.0
// RemoteScenes: scenes and maps of a coordinator's jobs, fetched as blobs (docs/scene_blob.md) and kept under FOLDER/scenes by what they are:
//   scene-HASH.blob         the scene's hash: a blob of another is not used
//   map-SHA256.blob         of the map's file, as the coordinator read it
// A file that is damaged is fetched again. No parser of glTF or pictures runs here. Thread-safe.
#pragma once

#include <mutex>

#include "server/farm/remote_tasks.h"
#include "server/jobs/task_scenes.h"

namespace gobo::farm {

class RemoteScenes final : public TaskScenes {
 public:
  /// `bytes`: of files that are kept; those that were used last stay.
  RemoteScenes(RemoteTasks& tasks, JobFiles& files, uint64_t bytes) : tasks_(tasks), files_(files), bytes_(bytes) {}
  Result<TaskScene> get(const JobRecord& record) override;

 private:
  Result<EnvironmentPtr> map(const JobRecord& record);  // under mutex_; null where the job has none
  Result<ScenePtr> scene(const JobRecord& record);      // under mutex_
  template <typename Pointer, typename Read>
  Result<Pointer> have(int64_t job, const std::string& name, const v1::GetFarmFileRequest& wanted, const Read& read);
  void trim(const std::string& newest);
  RemoteTasks& tasks_;
  JobFiles& files_;
  const uint64_t bytes_;
  std::mutex mutex_;  // one fetch at a time
  std::string sceneHash_, mapDigest_;
  ScenePtr scene_;  // the last of each
  EnvironmentPtr map_;
};

}  // namespace gobo::farm
