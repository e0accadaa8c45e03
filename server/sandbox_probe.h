// SPDX-License-Identifier: Apache-2.0
// SandboxProbe: which layers this machine gives around the reader of files, for `status`: one child is started for it, on a thread of
// its own, when the daemon starts. The libraries that readers of files need are loaded later: a daemon that ends soon, as `gobo --local`
// does, or that is told to load a file before, does not pay for them here. Thread-safe.
#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "base/stop.h"
#include "ingest/wire.h"

namespace gobo {
inline namespace server {

class SandboxProbe {
 public:
  /// `program`: ingest.program of the configuration. `prepareSeconds` after it is known what there is, readers of files are prepared.
  explicit SandboxProbe(std::string program, double prepareSeconds = 10);
  ~SandboxProbe();  ///< ends the child
  /// Waits up to `waitSeconds`; says "being looked for" of what is not known yet.
  ingest::Layers layers(double waitSeconds);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool known_ = false, ending_ = false;
  ingest::Layers layers_;
  StopSource stop_;
  std::thread thread_;
};

}  // namespace server
}  // namespace gobo
