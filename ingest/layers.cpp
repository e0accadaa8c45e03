// SPDX-License-Identifier: Apache-2.0
#include "ingest/layers.h"

#include <linux/capability.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace gobo::ingest {
namespace {

// The numbers are those of every architecture; headers of the build machine may be older than the kernel that runs this.
constexpr long kLandlockCreate = 444, kLandlockRestrict = 446;
constexpr uint32_t kAskVersion = 1;
struct Ruleset {
  uint64_t files = 0, net = 0, scoped = 0;
};

/// Rights by version of the interface. A version that is not known here has at least those of the last.
Ruleset everyRight(int version) {
  Ruleset r;
  r.files = (1ull << 13) - 1;               // execute, write, read, read_dir, remove_*, make_*
  if (version >= 2) r.files |= 1ull << 13;  // refer
  if (version >= 3) r.files |= 1ull << 14;  // truncate
  if (version >= 5) r.files |= 1ull << 15;  // ioctl of devices
  if (version >= 4) r.net = 3;              // bind, connect (TCP)
  if (version >= 6) r.scoped = 3;           // abstract Unix sockets, signals
  return r;
}
size_t sizeOf(int version) { return version >= 6 ? 24 : version >= 4 ? 16 : 8; }

std::string why(int error) { return std::string(strerrordesc_np(error)) + " (" + strerrorname_np(error) + ")"; }

void take(Layers& layers, const char* name, bool done) {
  if (done) layers.active.push_back(name);
  else layers.missing.push_back(std::string(name) + ": " + why(errno));
}

/// The root becomes an empty file system that nobody can write to; the old one is no longer mounted here.
bool emptyRoot() {
  if (::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) return false;
  for (const char* place : {"/tmp", "/proc", "/dev"}) {
    if (::mount("gobo", place, "tmpfs", MS_RDONLY | MS_NOSUID | MS_NODEV | MS_NOEXEC, "size=4k,nr_inodes=2,mode=0555") != 0) continue;
    return ::chdir(place) == 0 && ::syscall(SYS_pivot_root, ".", ".") == 0 && ::umount2(".", MNT_DETACH) == 0 && ::chdir("/") == 0;
  }
  return false;
}

void dropCapabilities() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct none[_LINUX_CAPABILITY_U32S_3] = {};
  (void)!::syscall(SYS_capset, &header, none);
}

}  // namespace

void enterUserNamespace(Layers& layers) { take(layers, "user_namespace", ::unshare(CLONE_NEWUSER) == 0); }

void enterNamespaces(Layers& layers) {
  take(layers, "mount_namespace", ::unshare(CLONE_NEWNS) == 0 && emptyRoot());
  take(layers, "network_namespace", ::unshare(CLONE_NEWNET) == 0);
  take(layers, "ipc_namespace", ::unshare(CLONE_NEWIPC) == 0);
  take(layers, "uts_namespace", ::unshare(CLONE_NEWUTS) == 0);
  dropCapabilities();
}

void denyFiles(Layers& layers) {
  const long version = ::syscall(kLandlockCreate, nullptr, 0, kAskVersion);
  const auto missing = [&](const std::string& reason) { layers.missing.push_back("landlock: " + reason); };
  if (version <= 0) return missing(why(errno));
  const Ruleset rights = everyRight(int(std::min(version, 1000l)));
  const int rules = int(::syscall(kLandlockCreate, &rights, sizeOf(int(std::min(version, 1000l))), 0));
  if (rules < 0) return missing(why(errno));
  const bool on = ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && ::syscall(kLandlockRestrict, rules, 0) == 0;
  const int error = errno;
  ::close(rules);
  if (on) layers.active.push_back("landlock");
  else missing(why(error));
}

}  // namespace gobo::ingest
