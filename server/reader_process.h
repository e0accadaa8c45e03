// SPDX-License-Identifier: Apache-2.0
// How a sandboxed reader (gobo-ingest) comes to be, and its end.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "base/stop.h"

namespace gobo {
inline namespace server {

/// One reader while it lives. Its destructor ends it. Of one thread.
class ReaderProcess {
 public:
  virtual ~ReaderProcess() = default;
  /// Does not block. `status` as waitpid gives it.
  virtual bool gone(int& status) = 0;
  /// Kills it and waits until it is gone.
  virtual void end() = 0;
};

/// Thread-safe.
class Readers {
 public:
  virtual ~Readers() = default;
  /// With the descriptors, which must be above 15, on kSocket and kOutput (ingest/wire.h); they stay the caller's too.
  /// Errors: Internal or ResourceExhausted, naming ingest.program. `stop` ends waiting for it to begin, not the reader.
  virtual Result<std::unique_ptr<ReaderProcess>> start(int socket, int output, const StopToken& stop = {}) = 0;
  /// Begins to load what the first reader would wait for, if it is not there; does not wait itself.
  virtual void prepare() {}
  /// A reader ended by a signal.
  virtual void crashed() {}
};

/// A new process for each: posix_spawn, which is safe in a process with threads.
std::shared_ptr<Readers> spawnedReaders(const std::string& program);
/// The same, for probes: without the codec of pictures, whose libraries are nearly all that a reader takes to start.
std::shared_ptr<Readers> bareReaders(const std::string& program);
/// Forks of one process that has loaded its libraries (ingest/nursery.h); it is started by the first reader and shared by everybody here who
/// names the program. After a crash the next reader comes of a new one: a reader's addresses must not be guessed by trying.
/// One that has not begun after `patience` seconds (the first who names a program says how long) is tried once more with a new process.
/// Under a sanitizer: spawned ones.
std::shared_ptr<Readers> forkedReaders(const std::string& program, double patience = 20);

}  // namespace server
}  // namespace gobo
