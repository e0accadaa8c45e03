// SPDX-License-Identifier: Apache-2.0
// JobFiles: the files beside the job store, all made as temp file + fdatasync + rename + fsync of the folder, named after what they
// hold, so that a name stands for a whole file and a file that no row names is litter:
//   FOLDER/identity                  32 hex digits: the store that the files belong to (server/jobs/store_identity.h)
//   FOLDER/lock                      flock: shared while a daemon lives, exclusive for the sweep at start
//   FOLDER/tmp/                      being written
//   FOLDER/checkpoints/JOB-INDEX-DIGEST.term   32 hex digits, xxh3-128 of the bytes (docs/term_file.md)
//   FOLDER/results/JOB/SHA256        a finished picture, encoded
//   FOLDER/scenes/SHA256.glb         an uploaded scene
//   FOLDER/scenes/KEY/NAME...        one of several files (server/file_store.h)
//   FOLDER/scenes/SHA256.hdr         an environment that was put (.exr)
//   FOLDER/marks/                    which frames a crashed daemon worked on (crash_marks.h)
// Thread-safe but for open().
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "server/jobs/job_store.h"
#include "server/jobs/litter.h"

namespace gobo {
inline namespace jobs {

class JobFiles {
 public:
  ~JobFiles();
  /// Makes the folders (mode 0700). Errors: FailedPrecondition when the folder is not this user's own (base/own_folder.h). `alone`: no other daemon has the
  /// folder open, so leases and litter of dead ones may go; the others wait until opened() is called.
  Status open(const std::string& folder, bool& alone);
  void opened();  ///< the exclusive lock becomes a shared one
  /// Removes temp files, and checkpoints and results of jobs that the store has made and no row needs (results only of jobs that are over),
  /// once they have lain unchanged for `age` seconds of this process (0 only when alone: a file is written before its row).
  Status sweep(JobStore& store, double age);
  /// Uploaded scenes and environments that neither an unfinished job nor `loaded` (first 16 digits of the sha256) needs, after ten minutes of that.
  void sweepScenes(const std::vector<std::string>& needed, const std::vector<std::string>& loaded);

  std::string storePath() const { return folder_ + "/jobs.sqlite"; }
  std::string identityPath() const { return folder_ + "/identity"; }
  /// What the file says; empty without one. Errors: DataLoss when it says something else than 32 digits.
  Result<std::string> identity() const;
  Status writeIdentity(const std::string& id);
  /// Somebody was promised what lies here: results, checkpoints, or a log of the store without the store.
  bool holdsPromises() const;
  int64_t lastJob() const;  ///< the highest id among results and checkpoints; 0 without
  std::string checkpointPath(TaskId task, const std::string& digest) const {
    return folder_ + "/checkpoints/" + std::to_string(task.job) + "-" + std::to_string(task.index) + "-" + digest + ".term";
  }
  std::string resultPath(int64_t job, const std::string& sha256) const { return resultFolder(job) + "/" + sha256; }
  std::string resultFolder(int64_t job) const { return folder_ + "/results/" + std::to_string(job); }
  std::string scenePath(const std::string& name) const { return folder_ + "/scenes/" + name; }

  /// Durable on return. A file of that name stays as it is (it has the same bytes) unless its size differs.
  /// Errors: ResourceExhausted (disk full), Internal; the file named.
  Status write(const std::string& path, const void* bytes, size_t size);
  /// A file that comes in pieces; without commit() nothing stays.
  class Incoming {
   public:
    Incoming() = default;
    ~Incoming();
    Incoming(const Incoming&) = delete;
    Incoming& operator=(const Incoming&) = delete;
    Status begin(JobFiles& files, const std::string& path);
    Status add(const void* bytes, size_t size);
    Status commit();  ///< durable on return

   private:
    JobFiles* files_ = nullptr;
    std::string temp_, path_;
    int fd_ = -1;
  };
  /// Takes over a file of the same or another file system.
  Status adopt(const std::string& from, const std::string& path);
  /// The same for a folder of files, whole or not at all.
  Status adoptTree(const std::string& from, const std::string& path);
  Result<std::vector<uint8_t>> read(const std::string& path) const;  ///< NotFound, Internal
  void remove(const std::string& path);
  void removeResults(int64_t job);
  void removeCheckpoints(int64_t job);  ///< of all its frames
  void removeCheckpoints(TaskId task);
  void removeAllOnTheirWay();  ///< results, checkpoints and temp files of every job: of a folder without a store

  Litter litter;
  std::function<Status(const char* step, const std::string& path)> step;  ///< a test's seam: before "write", "sync", "rename", "sync-folder"

 private:
  void removePrefix(const std::string& prefix);
  std::string folder_, temps_;
  int lock_ = -1;
  std::atomic<uint64_t> counter_{0};
};

}  // namespace jobs
}  // namespace gobo
