// SPDX-License-Identifier: Apache-2.0
// JobScenes: the scene that a job was submitted with, also after a restart: the loaded one when it still has that hash, else loaded
// again from where it came from (built-in, file under a root, kept upload). Another hash is an error, never another picture.
// The environment's file is held to its sha256 in the same way. Thread-safe.
#pragma once

#include <mutex>

#include "server/jobs/job_files.h"
#include "server/jobs/task_scenes.h"

namespace gobo {
inline namespace jobs {

/// The first 16 digits of what names a scene's files under FOLDER/scenes: of sources "upload:DIGEST.glb" and "blobs:DIGEST/NAME"; empty for others.
std::string keptSceneDigest(const std::string& source);

class JobScenes final : public TaskScenes {
 public:
  /// Environment files above `inputBytes` are refused.
  JobScenes(Engine& engine, JobFiles& files, uint64_t inputBytes = UINT64_MAX) : engine_(engine), files_(files), inputBytes_(inputBytes) {}
  /// At submission: fills in sceneSource, sceneFile, environmentDigest. `environmentFile`, that of request.environment.digest, is kept for the job.
  Status describe(NewJob& job, const SceneAccess& access = {}, const StopToken& stop = {}, const std::string& environmentFile = {});
  /// What was kept for request.environment.digest; empty without one.
  std::string environmentFile(const v1::RenderRequest& request) const;
  /// Errors: FailedPrecondition naming both hashes; what loading says.
  /// Before frames of a job that is over wait again: an upload that it needs is young again. Errors: FailedPrecondition when it is gone.
  Status keepAgain(const JobRecord& record);
  Result<TaskScene> get(const JobRecord& record) override;
  /// The map of a job, loaded; null without. Errors as get().
  Result<EnvironmentPtr> map(const JobRecord& record, const StopToken& stop);

 private:
  Result<std::string> environmentDigest(const v1::RenderRequest& request, const StopToken& stop) const;
  Result<ScenePtr> scene(const JobRecord& record);
  Engine& engine_;
  JobFiles& files_;
  const uint64_t inputBytes_;
  std::mutex mutex_;  // one load at a time
  std::string cachedHash_;
  std::shared_ptr<const Scene> cached_;  // the last one that had to be loaded
};

}  // namespace jobs
}  // namespace gobo
