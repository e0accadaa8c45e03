// SPDX-License-Identifier: Apache-2.0
// JobOut: writes files of finished frames below jobs.out_folder, where JobSpec.out says (out_pattern.h), before the frame counts as done: a crash in between
// renders it again, to the same bits. Each file appears whole or not at all, in place of what had its name: temp file beside it (".gobo-*.part"), fdatasync,
// rename, fsync of the folder. Folders are made as needed; no symbolic link below out_folder is followed, so nothing is written outside of it. A kill
// while a file is written leaves its temp file. Thread-safe.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/jobs/job_files.h"
#include "server/jobs/task_store.h"

namespace gobo {
inline namespace jobs {

class JobOut {
 public:
  void open(const std::string& folder) { folder_ = folder; }  ///< empty: none
  bool on() const { return !folder_.empty(); }
  /// The frame's files, which lie in `files`, to where the job wants them; nothing where it wants none, or the lease is over (whoever reports is told that by
  /// the store). Errors mean that the report is to be repeated: Unavailable without a folder or through a link, ResourceExhausted, Internal; the path named.
  Status deliver(TaskStore& store, const JobFiles& files, const Lease& lease, const std::vector<v1::FrameFile>& done) const;
  /// `path`: relative, checked by checkOutPattern. Durable on return.
  Status write(const std::string& path, const std::vector<uint8_t>& bytes) const;

  std::function<Status(const char* step, const std::string& path)> step;  ///< a test's seam: before "write", "sync", "rename", "sync-folder"

 private:
  std::string folder_;
};

}  // namespace jobs
}  // namespace gobo
