// SPDX-License-Identifier: Apache-2.0
// CrashMarks: which frames a daemon was working on when it crashed, so that the next one does not start them again and again. A small
// file that is mapped and shared: what is written there is the kernel's at once and outlives the process, however it ends. Frames are
// entered while they are planned or rendered; other renders are counted. A handler of SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT writes
// the signal's number and lets the process die of it. So a kill from outside (SIGKILL, out of memory, power) leaves no signal there: its
// frames are tried again. SIGBUS under a mapped
// file is survived (base/mapped_faults.h) and leaves nothing. A stack overflow cannot run the handler; then the limit on lost leases counts.
//   FOLDER/marks/PID-RANDOM      locked (flock) while its process lives
// Thread-safe but for open() and read().
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/descriptor.h"
#include "base/status.h"
#include "server/jobs/job_store.h"

namespace gobo {
inline namespace jobs {

/// What a crashed daemon left.
struct CrashReport {
  int signal = 0;
  std::vector<TaskId> tasks;
  bool alone = false;  ///< one frame, and no other render beside it: the frame did it
};

class CrashMarks {
 public:
  ~CrashMarks();
  /// Makes this process's file and, once in a process, installs the handler. Errors: Internal, ResourceExhausted naming the file.
  static Result<std::unique_ptr<CrashMarks>> open(const std::string& folder);
  /// The reports of crashed processes; files of dead ones are removed, those of living ones left alone.
  static std::vector<CrashReport> read(const std::string& folder);

  /// While one lives, its frame counts as worked on.
  class Working {
   public:
    Working(CrashMarks* marks, TaskId task);
    ~Working();
    Working(const Working&) = delete;
    Working& operator=(const Working&) = delete;

   private:
    CrashMarks* marks_;
    int slot_ = -1;
  };
  /// While one lives, some other render of this process is planned or runs. Without marks: nothing.
  class Other {
   public:
    Other();
    ~Other();
  };

 private:
  CrashMarks() = default;
  struct Page;
  std::string path_;
  Page* page_ = nullptr;
  gobo::Descriptor fd_;
};

}  // namespace jobs
}  // namespace gobo
