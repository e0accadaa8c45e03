// SPDX-License-Identifier: Apache-2.0
#include "ingest/sandbox.h"

#include <fcntl.h>

#include <OpenEXR/ImfThreading.h>
#include <seccomp.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "base/image_codec.h"
#include "ingest/layers.h"

namespace gobo::ingest {
namespace {

Status failed(const char* what) { return internalError(std::string("sandbox: ") + what + ": " + std::strerror(errno)); }

bool limit(int resource, uint64_t soft, uint64_t hard) {
  struct rlimit now {};
  if (::getrlimit(__rlimit_resource_t(resource), &now) != 0) return false;
  const rlim_t h = now.rlim_max == RLIM_INFINITY ? rlim_t(hard) : std::min(now.rlim_max, rlim_t(hard));
  const rlimit wanted{std::min(rlim_t(soft), h), h};
  return ::setrlimit(__rlimit_resource_t(resource), &wanted) == 0;
}

/// Address space that program and libraries take up already (about half a GB, hardly any of it memory).
uint64_t occupied() {
  char text[64] = {};
  const int fd = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  const ssize_t n = fd < 0 ? -1 : ::read(fd, text, sizeof text - 1);
  if (fd >= 0) ::close(fd);
  return n > 0 ? std::strtoull(text, nullptr, 10) * uint64_t(::sysconf(_SC_PAGESIZE)) : 512ull << 20;
}

/// 0, or the negative errno of the first rule that was not taken.
int addRules(scmp_filter_ctx filter) {
  const auto allow = [&](int call) { return seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); };
  const auto refuse = [&](int call) { return seccomp_rule_add(filter, SCMP_ACT_ERRNO(EPERM), call, 0); };
  for (const int call : {SCMP_SYS(read),
                         SCMP_SYS(readv),
                         SCMP_SYS(write),
                         SCMP_SYS(writev),
                         SCMP_SYS(lseek),
                         SCMP_SYS(close),
                         SCMP_SYS(fstat),
                         SCMP_SYS(poll),
                         SCMP_SYS(munmap),
                         SCMP_SYS(mremap),
                         SCMP_SYS(brk),
                         SCMP_SYS(madvise),
                         SCMP_SYS(futex),
                         SCMP_SYS(rt_sigreturn),
                         SCMP_SYS(rt_sigaction),
                         SCMP_SYS(rt_sigprocmask),
                         SCMP_SYS(sigaltstack),
                         SCMP_SYS(exit),
                         SCMP_SYS(exit_group),
                         SCMP_SYS(clock_gettime),
                         SCMP_SYS(clock_getres),
                         SCMP_SYS(gettimeofday),
                         SCMP_SYS(time),
                         SCMP_SYS(nanosleep),
                         SCMP_SYS(clock_nanosleep),
                         SCMP_SYS(getpid),
                         SCMP_SYS(gettid),
                         SCMP_SYS(getrandom),
                         SCMP_SYS(sched_yield),
                         SCMP_SYS(sched_getaffinity),
                         SCMP_SYS(sysinfo),
                         SCMP_SYS(uname),
                         SCMP_SYS(getrusage),
                         SCMP_SYS(restart_syscall),
                         SCMP_SYS(rseq),
                         SCMP_SYS(set_robust_list)})  // the last two: of a library's thread that was just being started or ended
    if (const int rc = allow(call)) return rc;
  // Memory stays data: neither new nor old pages may become executable.
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)})
    if (const int rc = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 1, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0))) return rc;
  // abort() signals itself; nobody else may be signalled.
  if (const int rc = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, SCMP_A0(SCMP_CMP_EQ, scmp_datum_t(::getpid())))) return rc;
  for (const int call : {SCMP_SYS(open),
                         SCMP_SYS(openat),
                         SCMP_SYS(openat2),
                         SCMP_SYS(stat),
                         SCMP_SYS(lstat),
                         SCMP_SYS(newfstatat),
                         SCMP_SYS(statx),
                         SCMP_SYS(access),
                         SCMP_SYS(faccessat),
                         SCMP_SYS(faccessat2),
                         SCMP_SYS(readlink),
                         SCMP_SYS(readlinkat),
                         SCMP_SYS(getcwd),
                         SCMP_SYS(ioctl),
                         SCMP_SYS(fcntl),
                         SCMP_SYS(prlimit64),
                         SCMP_SYS(getrlimit),
                         SCMP_SYS(setrlimit),
                         SCMP_SYS(sched_setaffinity),
                         SCMP_SYS(clone),
                         SCMP_SYS(clone3),
                         SCMP_SYS(fork),
                         SCMP_SYS(vfork),
                         SCMP_SYS(geteuid),
                         SCMP_SYS(getuid),
                         SCMP_SYS(unlink),
                         SCMP_SYS(unlinkat)})
    if (const int rc = refuse(call)) return rc;
  return 0;
}

}  // namespace

void prepareLibraries(bool withCodec) {
  Imf::setGlobalThreadCount(0);
  if (!withCodec) return;
  if (const auto codec = imageCodec(); codec.ok()) (*codec)->useOneThread();  // now: nothing can be loaded later. If it cannot be, pictures will say so
}

Status lockDown(const Job& job, Layers& layers) {
  [[maybe_unused]] const uint64_t space = occupied() + job.memoryBytes;  // while a descriptor can still be had
  // When the machine runs out of memory, this process goes before the daemon.
  if (const int fd = ::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC); fd >= 0) {
    (void)!::write(fd, "1000", 4);
    ::close(fd);
  }
  if (::syscall(SYS_close_range, kOutput + 1, ~0u, 0) != 0)
    for (int fd = kOutput + 1; fd < 65536; ++fd) ::close(fd);
  enterNamespaces(layers);
  denyFiles(layers);
  if (::prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) return failed("PR_SET_PDEATHSIG");
  if (::prctl(PR_SET_DUMPABLE, 0) != 0) return failed("PR_SET_DUMPABLE");
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return failed("PR_SET_NO_NEW_PRIVS");
  // SIGXCPU at the soft limit ends the process; the hard one is for who catches it.
  if (!limit(RLIMIT_CORE, 0, 0) || !limit(RLIMIT_CPU, job.cpuSeconds, job.cpuSeconds + 1) || !limit(RLIMIT_FSIZE, job.blobBytes, job.blobBytes) ||
      !limit(RLIMIT_NOFILE, kOutput + 1, kOutput + 1))
    return failed("setrlimit");
#if !defined(__SANITIZE_ADDRESS__) && !defined(GOBO_THREAD_SANITIZER)  // the sanitizer's shadow memory is terabytes of address space
  if (!limit(RLIMIT_AS, space, space)) return failed("setrlimit of the address space");
#endif
  scmp_filter_ctx filter = seccomp_init(SCMP_ACT_KILL_PROCESS);
  if (!filter) return internalError("sandbox: seccomp_init failed");
#ifdef GOBO_THREAD_SANITIZER
  const int together = 0;  // its own thread needs more than the filter gives
#else
  const int together = seccomp_attr_set(filter, SCMP_FLTATR_CTL_TSYNC, 1);  // should a library have a thread after all
#endif
  int rc = together != 0 ? together : addRules(filter);
  if (rc == 0) rc = seccomp_load(filter);
  seccomp_release(filter);
  if (rc != 0) {
    errno = -rc;
    return failed("seccomp");
  }
  layers.active.push_back("seccomp");
  return {};
}

}  // namespace gobo::ingest
