// SPDX-License-Identifier: Apache-2.0
#include "server/sandbox_probe.h"

#include <sys/mman.h>

#include <chrono>

#include "base/descriptor.h"
#include "server/ingest_child.h"

namespace gobo {
inline namespace server {
namespace {

constexpr double kWallSeconds = 30;

ingest::Layers probe(const std::string& program, const StopToken& stop) {
  const Descriptor output(::memfd_create("gobo-probe", MFD_CLOEXEC));
  if (output.get() < 0) return {{}, {"all: no descriptor for a probe"}};
  const ingest::Job job{ingest::Task::Probe, "empty", 0, 0, 0, 256ull << 20, 1 << 20, 10};
  const auto outcome = runIngest(*bareReaders(program), job, output.get(), kWallSeconds, stop);
  if (!outcome.ok()) return {{}, {"all: " + outcome.status().message()}};
  return outcome->done.layers;
}

}  // namespace

SandboxProbe::SandboxProbe(std::string program, double prepareSeconds) {
  if (program.empty()) program = findIngestProgram();
  if (program.empty()) {
    layers_.missing = {"all: gobo-ingest is not beside this program (ingest.program)"};
    known_ = true;
    return;
  }
  thread_ = std::thread([this, program, prepareSeconds] {
    ingest::Layers found = probe(program, stop_.token());
    std::unique_lock lock(mutex_);
    layers_ = std::move(found);
    known_ = true;
    changed_.notify_all();
    if (changed_.wait_for(lock, std::chrono::duration<double>(prepareSeconds), [&] { return ending_; })) return;
    lock.unlock();
    forkedReaders(program)->prepare();
  });
}

SandboxProbe::~SandboxProbe() {
  stop_.stop(StopReason::Cancelled);
  {
    const std::lock_guard hold(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

ingest::Layers SandboxProbe::layers(double waitSeconds) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::duration<double>(waitSeconds), [&] { return known_; });
  return known_ ? layers_ : ingest::Layers{{}, {"all: being looked for"}};
}

}  // namespace server
}  // namespace gobo
