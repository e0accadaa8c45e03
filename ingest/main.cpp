// SPDX-License-Identifier: Apache-2.0
// gobo-ingest: parses one scene or environment file for gobod in a sandbox and writes a scene blob, with a socket on descriptor 3 and the
// output on 4 (wire.h); it opens nothing itself. `gobo-ingest --nursery` forks such readers (nursery.h); `--bare` is one for probes, without
// the codec of pictures. docs/ingest.md has the whole story.
#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

#include "base/decode_limit.h"
#include "import/load.h"
#include "ingest/layers.h"
#include "ingest/nursery.h"
#include "ingest/probe.h"
#include "ingest/sandbox.h"
#include "ingest/wire.h"
#include "scene/blob.h"

#ifdef __SANITIZE_ADDRESS__
// The leak sanitizer stops its process by ptrace, which the sandbox forbids; what reads one file and ends cannot leak for long.
extern "C" int __lsan_is_turned_off() { return 1; }
// A crash ends it by its signal, as without the sanitizer, which is how the daemon tells whose fault it was.
extern "C" const char* __asan_default_options() { return "handle_segv=0:handle_sigbus=0:handle_sigfpe=0:handle_sigill=0"; }
#endif
#ifdef GOBO_THREAD_SANITIZER  // the sandbox allows no second thread; its parent's suppressions do not reach it
extern "C" const char* __tsan_default_options() { return "report_bugs=0:die_after_fork=0:handle_segv=0:handle_sigbus=0:handle_sigfpe=0:handle_sigill=0"; }
#endif

namespace gobo::ingest {
namespace {

/// The parent's end of the socket as a file source.
class ParentFiles final : public FileSource {
 public:
  Result<std::vector<uint8_t>> main(uint64_t maxBytes) override { return answer(maxBytes, "the scene file"); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t maxBytes) override {
    if (!writeFrame(kSocket, Frame::Ask, name.data(), name.size())) ::_exit(3);
    return answer(maxBytes, "\"" + name + "\"");
  }
  void parsing(const std::string& place) override {
    if (!writeFrame(kSocket, Frame::Note, place.data(), place.size())) ::_exit(3);
  }

 private:
  static Result<std::vector<uint8_t>> answer(uint64_t maxBytes, const std::string& what) {
    uint8_t head[9];
    uint64_t size = 0;
    if (!readAll(kSocket, head, sizeof head)) ::_exit(3);
    std::memcpy(&size, head + 1, 8);
    if (Frame(head[0]) == Frame::File && size > maxBytes)
      return Status(Code::ResourceExhausted, what + " has " + std::to_string(size) + " bytes, above the limit of " + std::to_string(maxBytes));
    std::vector<uint8_t> bytes(size);
    if (!readAll(kSocket, bytes.data(), bytes.size())) ::_exit(3);
    if (Frame(head[0]) == Frame::File) return bytes;
    Status status;
    if (Frame(head[0]) != Frame::Refusal || !decode(bytes, status)) ::_exit(3);
    return status;
  }
};

Status writeOut(const void* data, size_t bytes) {
  if (writeAll(kOutput, data, bytes)) return {};
  return Status(Code::ResourceExhausted, std::string("cannot write the blob: ") + std::strerror(errno));
}

Status work(const Job& job, Done& done) {
  ParentFiles files;
  setMostDecodedBytes(job.textureBytes);
  if (job.task == Task::Environment) {
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, files.main(~0ull));
    files.parsing("");
    GOBO_ASSIGN(const EnvironmentPtr map, readEnvironment(bytes.data(), bytes.size(), job.path));
    return writeBlob(*map, writeOut);
  }
  LoadTimes times;
  LoadOptions options;
  options.maxTriangles = job.maxTriangles;
  options.maxBytes = ~0ull;  // the parent bounds what comes in, RLIMIT_AS what it grows to
  options.textureBytes = job.textureBytes;
  options.files = &files;
  options.times = &times;
  GOBO_ASSIGN(const ScenePtr scene, loadGltf(job.path, options));
  done.parseMs = times.parseMs;
  done.textureMs = times.textureMs;
  return writeBlob(*scene, writeOut);
}

Status readJob(Job& job) {
  uint8_t head[9];
  uint64_t size = 0;
  if (!readAll(kSocket, head, sizeof head)) return internalError("no job arrived");
  std::memcpy(&size, head + 1, 8);
  if (Frame(head[0]) != Frame::Job || size > (1u << 16)) return internalError("the first frame is no job");
  std::vector<uint8_t> body(size);
  if (!readAll(kSocket, body.data(), body.size()) || !decode(body, job)) return internalError("the job cannot be read");
  return {};
}

/// Memory that is not there ends the child with the error that says so, wherever it was asked for: a library that catches
/// bad_alloc would leave out a picture instead, and the scene would depend on the limit in silence.
void outOfMemory() {
  static const uint8_t frame[] = {uint8_t(Frame::Failed),
                                  25,
                                  0,
                                  0,
                                  0,
                                  0,
                                  0,
                                  0,
                                  0,
                                  uint8_t(Code::ResourceExhausted),
                                  0,
                                  0,
                                  0,
                                  13,
                                  0,
                                  0,
                                  0,
                                  'o',
                                  'u',
                                  't',
                                  ' ',
                                  'o',
                                  'f',
                                  ' ',
                                  'm',
                                  'e',
                                  'm',
                                  'o',
                                  'r',
                                  'y',
                                  0,
                                  0,
                                  0,
                                  0};
  writeAll(kSocket, frame, sizeof frame);
  ::_exit(0);
}

int serve(Layers& layers) {
  std::set_new_handler(outOfMemory);
  Job job;
  Done done;
  Status status = readJob(job);
  if (status.ok()) status = lockDown(job, layers);
  if (status.ok()) {
    try {
      if (job.task == Task::Probe) writeFrame(kSocket, Frame::Note, nullptr, 0);
      status = job.task == Task::Probe ? probe(job.path) : work(job, done);
    } catch (const std::bad_alloc&) { status = Status(Code::ResourceExhausted, "out of memory", job.path); } catch (const std::exception& e) {
      status = internalError(e.what(), job.path);
    }
  }
  done.layers = layers;
  const std::vector<uint8_t> body = status.ok() ? encode(done) : encode(status);
  const bool told = writeFrame(kSocket, status.ok() ? Frame::Done : Frame::Failed, body.data(), body.size());
  ::_exit(told ? 0 : 3);  // no tear-down: it could only go wrong
}

/// Whether every other thread of this process sleeps. One that does holds no lock in the middle of something.
bool othersSleep() {
  DIR* const tasks = ::opendir("/proc/self/task");
  bool sleep = true;
  while (const dirent* task = tasks ? ::readdir(tasks) : nullptr) {
    if (task->d_name[0] == '.' || std::atoi(task->d_name) == int(::getpid())) continue;
    char name[64], text[256] = {};
    std::snprintf(name, sizeof name, "/proc/self/task/%.20s/stat", task->d_name);
    const int file = ::open(name, O_RDONLY | O_CLOEXEC);
    const ssize_t n = file < 0 ? 0 : ::read(file, text, sizeof text - 1);
    if (file >= 0) ::close(file);
    const char* const state = n > 0 ? std::strrchr(text, ')') : nullptr;
    sleep = sleep && (!state || state[2] == 'S');
  }
  if (tasks) ::closedir(tasks);
  return sleep;
}

/// Goes on in a process of one thread. Libraries start threads (log4cplus does, which OpenImageIO's plugins bring along), and a filter,
/// capabilities and Landlock are a thread's own: those would stay outside of the sandbox, in the reader's memory, and no user namespace can
/// be had. A fork leaves them behind. The first process reads nothing, waits, and ends as the second ended.
void leaveThreadsBehind(bool ofReader, bool codec) {
  const rlimit none{0, 0};
  ::setrlimit(RLIMIT_CORE, &none);
  prepareLibraries(codec);
  if (ofReader) ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // a nursery outlives the thread that started it: it ends when its socket does
  // Or a lock that one of them holds now would be held for ever in the fork, and in each fork of that.
  for (int asleep = 0, looks = 0; asleep < 3 && looks < 200; ++looks, ::usleep(1000)) asleep = othersSleep() ? asleep + 1 : 0;
  const pid_t first = ::getpid(), second = ::fork();
  if (second < 0) ::_exit(3);
  if (second == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != first) ::_exit(3);
    return;
  }
  ::close(kSocket);  // or the second's end would not be the end of the conversation
  ::close(kOutput);
  int status = 0;
  while (::waitpid(second, &status, 0) < 0 && errno == EINTR) {}
  if (WIFSIGNALED(status)) {
    ::signal(WTERMSIG(status), SIG_DFL);
    ::kill(::getpid(), WTERMSIG(status));
  }
  ::_exit(WIFEXITED(status) ? WEXITSTATUS(status) : 3);
}

}  // namespace
}  // namespace gobo::ingest

int main(int argc, char** argv) {
  using namespace gobo;
  if (argc == 3 && std::strcmp(argv[1], "--probe") == 0) {
    ingest::leaveThreadsBehind(true, true);
    ingest::Layers layers;
    ingest::enterUserNamespace(layers);
    const Status locked = ingest::lockDown({ingest::Task::Probe, argv[2], 0, 0, 0, 4ull << 30, 1 << 20, 10}, layers);
    for (const std::string& layer : layers.active) std::fprintf(stderr, "gobo-ingest: has %s\n", layer.c_str());
    for (const std::string& layer : layers.missing) std::fprintf(stderr, "gobo-ingest: lacks %s\n", layer.c_str());
    const Status status = locked.ok() ? ingest::probe(argv[2]) : locked;
    std::fprintf(stderr, "gobo-ingest: %s\n", status.toString().c_str());
    ::_exit(status.code() == Code::FailedPrecondition ? 0 : 1);  // what libraries do at exit expects the threads that were left behind
  }
  int type = 0;
  socklen_t size = sizeof type;
  const bool nursery = argc == 2 && std::strcmp(argv[1], "--nursery") == 0, bare = argc == 2 && std::strcmp(argv[1], "--bare") == 0;
  if ((argc != 1 && !nursery && !bare) || ::getsockopt(ingest::kSocket, SOL_SOCKET, SO_TYPE, &type, &size) != 0) {
    std::fprintf(stderr, "gobo-ingest is started by gobod; on its own it only answers --probe NAME (what the sandbox does about NAME)\n");
    return 2;
  }
  ingest::leaveThreadsBehind(!nursery, !bare);
  if (nursery) ingest::tendReaders(ingest::kSocket);
  ingest::Layers layers;
  ingest::enterUserNamespace(layers);
  return ingest::serve(layers);
}
