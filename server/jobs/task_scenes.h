// SPDX-License-Identifier: Apache-2.0
// TaskScenes: the scene and the map that a frame is rendered with, held to what its job was submitted with: from this machine's files
// (job_scenes.h) or from a coordinator (server/farm/remote_scenes.h). Thread-safe.
#pragma once

#include "plan/engine.h"
#include "server/jobs/task_store.h"

namespace gobo {
inline namespace jobs {

struct TaskScene {
  ScenePtr scene;
  EnvironmentSource environment;  ///< of the map; neither: the request's own path is to be used, or the job has none
};

class TaskScenes {
 public:
  virtual ~TaskScenes() = default;
  /// Errors: FailedPrecondition naming both hashes when the scene or the map is another by now; what loading says.
  virtual Result<TaskScene> get(const JobRecord& record) = 0;
};

}  // namespace jobs
}  // namespace gobo
