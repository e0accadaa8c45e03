// SPDX-License-Identifier: Apache-2.0
#include "ingest/nursery.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>

#include "ingest/descriptors.h"
#include "ingest/wire.h"

namespace gobo::ingest {
namespace {

void onlyWake(int) {}

/// Waits for the reader, and ends it when the daemon shuts the life line. A process of its own, because the nursery waits for requests.
[[noreturn]] void guard(pid_t reader, int life) {
  (void)!::send(life, &kTakenIn, sizeof kTakenIn, MSG_NOSIGNAL);
  sigset_t none;
  sigemptyset(&none);
  int status = 0;
  bool ended = false;
  for (;;) {
    const pid_t gone = ::waitpid(reader, &status, WNOHANG);
    if (gone == reader) break;
    if (gone < 0 && errno != EINTR) ::_exit(3);
    pollfd line{life, POLLIN, 0};
    // SIGCHLD is blocked but in here: a reader that ended since the look above ends this at once.
    if (::ppoll(ended ? nullptr : &line, ended ? 0 : 1, nullptr, &none) > 0) {
      ::kill(reader, SIGKILL);
      ended = true;
    }
  }
  const int32_t told = status;
  (void)!::send(life, &told, sizeof told, MSG_NOSIGNAL);
  ::_exit(0);
}

}  // namespace

void tendReaders(int control) {
  ::signal(SIGCHLD, SIG_IGN);  // nobody waits for the guards
  for (;;) {
    ReaderDescriptors descriptors;
    if (!receiveDescriptors(control, descriptors)) ::_exit(0);
    const auto [socket, output, life] = descriptors;
    if (life < 0) continue;
    const pid_t nursery = ::getpid();
    const pid_t guarding = ::fork();
    if (guarding != 0) {  // also when there was no fork: the daemon sees its life line end without a word
      for (const int fd : descriptors) ::close(fd);
      continue;
    }
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != nursery) ::_exit(3);
    ::close(control);
    sigset_t child;
    sigemptyset(&child);
    sigaddset(&child, SIGCHLD);
    ::sigprocmask(SIG_BLOCK, &child, nullptr);
    ::signal(SIGCHLD, onlyWake);
    const pid_t guardian = ::getpid(), reader = ::fork();
    if (reader < 0) ::_exit(3);
    if (reader > 0) {
      ::close(socket);  // or the reader's end would not be the end of the conversation
      ::close(output);
      guard(reader, life);
    }
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != guardian) ::_exit(3);
    ::signal(SIGCHLD, SIG_DFL);
    ::sigprocmask(SIG_UNBLOCK, &child, nullptr);
    ::close(life);
    // Above both places first: one may stand where the other belongs.
    const int highSocket = ::fcntl(socket, F_DUPFD_CLOEXEC, 16), highOutput = ::fcntl(output, F_DUPFD_CLOEXEC, 16);
    if (::dup2(highSocket, kSocket) < 0 || ::dup2(highOutput, kOutput) < 0) ::_exit(3);
    return;  // lockDown closes the rest
  }
}

}  // namespace gobo::ingest
