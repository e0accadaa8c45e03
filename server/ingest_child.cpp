// SPDX-License-Identifier: Apache-2.0
#include "server/ingest_child.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>

#include "base/descriptor.h"
#include "base/file_stamp.h"
#include "base/image_io.h"
#include "base/utf8.h"
#include "scene/file_source.h"
#include "server/encode.h"

namespace gobo {
inline namespace server {
namespace {

using Clock = std::chrono::steady_clock;

/// Blocking I/O with a deadline and a stop token. False: end of file, time out or stop; `reason` tells the last two.
class Channel {
 public:
  Channel(int fd, Clock::time_point deadline, const StopToken& stop) : fd_(fd), deadline_(deadline), stop_(stop) {}
  bool expired() const { return Clock::now() >= deadline_; }
  bool stopped() const { return stop_.stopRequested(); }
  bool read(void* to, size_t bytes) {
    auto* p = static_cast<uint8_t*>(to);
    while (bytes > 0) {
      const ssize_t n = ::recv(fd_, p, bytes, MSG_DONTWAIT);
      if (n > 0) {
        p += n;
        bytes -= size_t(n);
        continue;
      }
      if (n == 0 || !again() || !wait(POLLIN)) return false;
    }
    return true;
  }
  bool write(const void* from, size_t bytes) {
    const auto* p = static_cast<const uint8_t*>(from);
    while (bytes > 0) {
      const ssize_t n = ::send(fd_, p, bytes, MSG_DONTWAIT | MSG_NOSIGNAL);
      if (n > 0) {
        p += n;
        bytes -= size_t(n);
        continue;
      }
      if (!again() || !wait(POLLOUT)) return false;
    }
    return true;
  }
  bool frame(ingest::Frame type, uint64_t bytes) {
    uint8_t head[9];
    head[0] = uint8_t(type);
    memcpy(head + 1, &bytes, 8);
    return write(head, sizeof head);
  }

 private:
  static bool again() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }
  bool wait(short events) {
    if (expired() || stopped()) return false;
    pollfd p{fd_, events, 0};
    ::poll(&p, 1, 20);
    return true;
  }
  int fd_;
  Clock::time_point deadline_;
  StopToken stop_;
};

Status changed(const std::string& name) { return Status(Code::Aborted, "file \"" + name + "\" changed while it was being read; try again"); }

/// Sends what `file` has and hashes it. False in `alive` when the child does not take it.
Status sendFile(Channel& channel, int file, const std::string& name, uint64_t limit, std::string& digest, std::string& settledStamp, uint64_t& total,
                bool& alive) {
  struct stat info {};
  if (::fstat(file, &info) != 0) return internalError("cannot examine \"" + name + "\"");
  const FileStamp stamp = FileStamp::of(info);
  const bool settled = stamp.settled();
  uint64_t left = uint64_t(info.st_size);
  if (left > limit - total)
    return Status(Code::ResourceExhausted, "file \"" + name + "\" has " + std::to_string(left) + " bytes: the files of one scene are limited to " +
                                               std::to_string(limit) + " bytes together (ingest.input_bytes)");
  total += left;
  alive = channel.frame(ingest::Frame::File, left);
  Sha256 sha;
  std::vector<uint8_t> block(1 << 20);
  while (left > 0 && alive) {
    const ssize_t n = ::read(file, block.data(), size_t(std::min<uint64_t>(left, block.size())));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return changed(name);
    sha.add(block.data(), size_t(n));
    alive = channel.write(block.data(), size_t(n));
    left -= size_t(n);
  }
  digest = sha.hex();
  if (settled && ::fstat(file, &info) == 0 && FileStamp::of(info) == stamp) settledStamp = stamp.text();
  return {};
}

bool isCrash(int signal) { return signal == SIGSEGV || signal == SIGBUS || signal == SIGILL || signal == SIGFPE || signal == SIGABRT || signal == SIGSYS; }

/// A crash in the middle of a client's file is that file's doing, and so the client's error; before, it is the server's.
Status crashed(int signal, const IngestOutcome& outcome) {
  const char* name = ::sigabbrev_np(signal);
  const std::string end = std::string(::strsignal(signal)) + (name ? std::string(", SIG") + name : "");
  if (!outcome.parsing) return internalError("the sandboxed reader crashed before it read the file (" + end + ")");
  return invalidArgument("the file crashes its reader (" + end + ")" + (outcome.place.empty() ? "" : " at " + outcome.place) +
                         "; it is damaged or made to do so, and only this load is affected");
}

Status whyItEnded(const ingest::Job& job, const IngestOutcome& outcome, int status) {
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return internalError("the sandboxed reader left without an answer");
  if (WIFEXITED(status)) return internalError("the sandboxed reader gave up with exit code " + std::to_string(WEXITSTATUS(status)));
  const int signal = WTERMSIG(status);
  switch (signal) {
    case SIGXCPU: return Status(Code::ResourceExhausted, "reading it takes more than " + std::to_string(job.cpuSeconds) + " s of CPU time (ingest.cpu_s)");
    case SIGXFSZ: return Status(Code::ResourceExhausted, "its blob is larger than " + std::to_string(job.blobBytes) + " bytes (ingest.blob_bytes)");
    case SIGSYS: return internalError("the sandboxed reader tried a system call that its sandbox forbids and was stopped");
    case SIGKILL: return Status(Code::ResourceExhausted, "the sandboxed reader was killed from outside (is the machine out of memory?)");
    case SIGTERM:
    case SIGINT:
    case SIGHUP: return Status(Code::Unavailable, std::string("the sandboxed reader was stopped from outside (") + ::strsignal(signal) + "); try again");
    default: return crashed(signal, outcome);
  }
}

/// One side file for the child: the file, or why not.
Status answer(Channel& channel, const ingest::Job& job, const std::string& name, IngestOutcome& outcome, uint64_t& total, bool& alive) {
  const auto refuse = [&](const Status& why) {
    const std::vector<uint8_t> body = ingest::encode(why);
    alive = channel.frame(ingest::Frame::Refusal, body.size()) && channel.write(body.data(), body.size());
    return Status();
  };
  if (outcome.sides.size() >= kMaxSideFiles) return Status(Code::ResourceExhausted, "it names more than " + std::to_string(kMaxSideFiles) + " files");
  SideFile side{name, "absent", ""};
  auto opened = openBeside(job.path, name);
  if (!opened.ok()) {
    if (opened.status().code() == Code::NotFound) outcome.sides.push_back(side);
    else if (opened.status().code() != Code::InvalidArgument) return Status(opened.status().code(), opened.status().message() + " (\"" + name + "\")");
    return refuse(Status(opened.status().code(), opened.status().message()));
  }
  const Descriptor file(*opened);
  GOBO_TRY(sendFile(channel, file.get(), name, job.maxBytes, side.digest, side.stamp, total, alive));
  outcome.sides.push_back(side);
  return {};
}

/// The conversation. `alive` false: the child is gone or does not answer; its end says why.
Status talk(Channel& channel, const ingest::Job& job, int mainFile, IngestOutcome& outcome, bool& alive) {
  const std::vector<uint8_t> body = ingest::encode(job);
  uint64_t total = 0;
  alive = channel.frame(ingest::Frame::Job, body.size()) && channel.write(body.data(), body.size());
  if (alive && mainFile >= 0) GOBO_TRY(sendFile(channel, mainFile, job.path, job.maxBytes, outcome.mainDigest, outcome.mainStamp, total, alive));
  // Also when it took nothing: what it said before it went is still there.
  for (;;) {
    uint8_t head[9];
    uint64_t size = 0;
    if (!channel.read(head, sizeof head)) break;
    memcpy(&size, head + 1, 8);
    if (size > (1u << 20)) return internalError("the sandboxed reader broke the protocol");
    std::vector<uint8_t> bytes(size);
    if (!channel.read(bytes.data(), bytes.size())) break;
    Status reported;
    switch (ingest::Frame(head[0])) {
      case ingest::Frame::Note:
        outcome.parsing = true;
        outcome.place.assign(bytes.begin(), bytes.begin() + std::min<ptrdiff_t>(ptrdiff_t(bytes.size()), 200));
        break;
      case ingest::Frame::Ask: GOBO_TRY(answer(channel, job, std::string(bytes.begin(), bytes.end()), outcome, total, alive)); break;
      case ingest::Frame::Done: return ingest::decode(bytes, outcome.done) ? Status() : internalError("the sandboxed reader broke the protocol");
      case ingest::Frame::Failed:
        if (!ingest::decode(bytes, reported)) return internalError("the sandboxed reader broke the protocol");
        if (reported.code() == Code::ResourceExhausted && reported.message() == "out of memory")
          return Status(Code::ResourceExhausted, "reading it needs more memory than " + std::to_string(job.memoryBytes) + " bytes (ingest.memory_bytes)");
        return reported;
      default: return internalError("the sandboxed reader broke the protocol");
    }
  }
  alive = false;
  return {};
}

}  // namespace

std::string findIngestProgram() {
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {"gobo-ingest", "../ingest/gobo-ingest", "../libexec/gobo/gobo-ingest"}) {
    const std::string path = (folder / place).lexically_normal().string();
    if (::access(path.c_str(), X_OK) == 0) return path;
  }
  return {};
}

Result<IngestOutcome> runIngest(Readers& readers, const ingest::Job& job, int output, double wallSeconds, const StopToken& stop) {
  int mainFile = -1;
  if (job.task != ingest::Task::Probe) { GOBO_ASSIGN(mainFile, openRegular(job.path)); }
  const Descriptor file(mainFile);
  int pair[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0)
    return Status(Code::ResourceExhausted, std::string("cannot make a socket pair: ") + ::strerror(errno), job.path);
  // Above the child's numbers: dup2 in the child must not overwrite a descriptor that it still has to copy.
  Descriptor mine(pair[0]), low(pair[1]);
  Descriptor theirs(::fcntl(low.get(), F_DUPFD_CLOEXEC, 16)), target(::fcntl(output, F_DUPFD_CLOEXEC, 16));
  if (theirs.get() < 0 || target.get() < 0) return Status(Code::ResourceExhausted, std::string("no descriptor left: ") + ::strerror(errno), job.path);
  auto started = readers.start(theirs.get(), target.get(), stop);
  if (!started.ok()) return started.status().at(job.path);
  const std::unique_ptr<ReaderProcess> child = std::move(*started);
  theirs.close();
  target.close();
  low.close();  // or the end of the child would not be the end of the stream

  Channel channel(mine.get(), Clock::now() + std::chrono::microseconds(int64_t(wallSeconds * 1e6)), stop);
  IngestOutcome outcome;
  bool alive = true;
  const Status said = talk(channel, job, mainFile, outcome, alive);
  if (!said.ok()) return cleanUtf8(said.at(job.path));  // its destructor ends it
  int status = 0;
  bool over = child->gone(status);
  while (!over && !channel.expired() && !channel.stopped()) {
    ::usleep(500);
    over = child->gone(status);
  }
  if (!over) {
    child->end();
    if (!channel.stopped()) readers.crashed();  // should it be the nursery's fault, the next comes of another
    if (channel.stopped()) return Status(Code::Cancelled, "the load was cancelled", job.path);
    char limit[32];
    snprintf(limit, sizeof limit, "%g", wallSeconds);
    return Status(Code::ResourceExhausted, std::string("reading it takes longer than ") + limit + " s (ingest.wall_s)", job.path);
  }
  if (WIFSIGNALED(status) && isCrash(WTERMSIG(status))) readers.crashed();
  if (!alive || !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    const std::string place = !outcome.place.empty() && WIFSIGNALED(status) ? job.path + "#" + outcome.place : job.path;
    return cleanUtf8(whyItEnded(job, outcome, status).at(place));
  }
  return outcome;
}

}  // namespace server
}  // namespace gobo
