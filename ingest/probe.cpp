// SPDX-License-Identifier: Apache-2.0
#include "ingest/probe.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>
#include <thread>
#include <vector>

#include "ingest/wire.h"

namespace gobo::ingest {
namespace {

Status verdict(const std::string& what, bool happened) {
  if (happened) return internalError(what + " was NOT denied");
  return Status(Code::FailedPrecondition, what + " was denied: " + std::strerror(errno));
}

[[gnu::noinline]] void spin() {
  for (volatile uint64_t i = 0;; i = i + 1) {}
}

}  // namespace

Status probe(const std::string& what) {
  if (what == "open") return verdict("open of /etc/passwd", ::open("/etc/passwd", O_RDONLY) >= 0);
  if (what == "create") return verdict("making a file", ::open("/tmp/gobo-ingest-probe", O_CREAT | O_WRONLY, 0600) >= 0);
  if (what == "descriptor") return verdict("a new descriptor", ::dup(kSocket) >= 0);
  if (what == "fork") {
    const pid_t pid = ::fork();
    if (pid == 0) ::_exit(0);
    return verdict("fork", pid > 0);
  }
  if (what == "thread") {
    try {
      std::thread([] {}).join();
      return verdict("a thread", true);
    } catch (const std::system_error&) { return Status(Code::FailedPrecondition, "a thread was denied"); }
  }
  if (what == "socket") return verdict("socket", ::socket(AF_INET, SOCK_STREAM, 0) >= 0);
  if (what == "exec") {
    char shell[] = "/bin/true";
    char* argv[] = {shell, nullptr};
    ::execve(shell, argv, nullptr);
    return verdict("exec", false);
  }
  if (what == "kill") return verdict("a signal to the parent", ::kill(::getppid(), 0) == 0);
  if (what == "ptrace") return verdict("ptrace", ::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) == 0);
  if (what == "mmap-exec")
    return verdict("executable memory", ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED);
  if (what == "segv") {
    std::memset(reinterpret_cast<void*>(std::strlen(what.c_str()) + 4092), 1, what.size());
    return {};
  }  // a page that is never mapped
  if (what == "abort") std::abort();
  if (what == "spin") spin();
  if (what == "sleep")
    for (;;) ::usleep(100000);
  if (what == "allocate")
    for ([[maybe_unused]] void* volatile hoard;;) hoard = ::operator new(64u << 20);  // none of it touched: pages are dear, and time is bounded too
  if (what == "write") {
    const std::vector<char> block(1 << 20, 'x');
    while (writeAll(kOutput, block.data(), block.size())) {}
    return Status(Code::ResourceExhausted, std::string("cannot write the blob: ") + std::strerror(errno));
  }
  if (what == "silent") ::_exit(0);
  if (what == "babble") {
    const std::vector<char> junk(4096, '\xff');
    writeAll(kSocket, junk.data(), junk.size());
    return {};
  }
  if (what == "empty") return {};  // Done, with the layers, without a blob
  return invalidArgument("no probe \"" + what + "\"");
}

}  // namespace gobo::ingest
