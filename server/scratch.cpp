// SPDX-License-Identifier: Apache-2.0
#include "server/scratch.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <vector>

#include "server/random_hex.h"

namespace gobo {
inline namespace server {

namespace fs = std::filesystem;

namespace {

constexpr const char* kScratchLock = ".lock";  // "lock" is that of what may lie in it (server/jobs/job_files.h)
constexpr const char* kHead = "x";             // no digit: there earlier versions, which may start beside, read a process's number
constexpr size_t kRandomBytes = 16;
constexpr int kMostScratchNames = 8;  // that make() tries

Status scratchError(const std::string& what, const std::string& path, int error) {
  const bool none = error == ENOSPC || error == EDQUOT || error == EMFILE || error == ENFILE || error == ENOMEM;
  return {none ? Code::ResourceExhausted : Code::Internal, "cannot " + what + " \"" + path + "\": " + std::strerror(error)};
}

std::string scratchLock(const std::string& folder) { return folder + "/" + kScratchLock; }

/// The lock file last: what is left of a removal that fails or is broken off can be told as abandoned again.
Status removeScratch(const std::string& folder) {
  std::vector<fs::path> inside;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (it->path().filename() != kScratchLock) inside.push_back(it->path());
  if (error == std::errc::no_such_file_or_directory) return {};
  if (error) return scratchError("list", folder, error.value());
  for (const fs::path& path : inside)
    if (fs::remove_all(path, error); error) return scratchError("remove", path.string(), error.value());
  const std::string lock = scratchLock(folder);
  if (::unlink(lock.c_str()) != 0 && errno != ENOENT) return scratchError("remove", lock, errno);
  if (::rmdir(folder.c_str()) != 0 && errno != ENOENT) return scratchError("remove", folder, errno);
  return {};
}

}  // namespace

gobo::Descriptor lockNewFile(const std::string& path) {
  gobo::Descriptor fd{::open(path.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600)};
  if (!fd) return fd;
  const int error = ::flock(fd.get(), LOCK_EX | LOCK_NB) == 0 ? 0 : errno;
  struct stat info {};  // while it was not locked, a daemon that starts may have taken it for one of the dead
  if (!error && ::fstat(fd.get(), &info) == 0 && info.st_nlink > 0) return fd;
  ::unlink(path.c_str());
  errno = error ? error : EWOULDBLOCK;
  return gobo::Descriptor();
}

gobo::Descriptor lockAbandonedFile(const std::string& path) {
  gobo::Descriptor fd{::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK)};
  if (!fd || ::flock(fd.get(), LOCK_EX | LOCK_NB) == 0) return fd;
  const int error = errno;
  fd.close();
  errno = error;
  return fd;
}

Result<std::unique_ptr<ScratchFolder>> ScratchFolder::make(const std::string& in, const std::string& prefix) {
  for (int tries = 0; tries < kMostScratchNames; ++tries) {
    const auto name = randomHex(kRandomBytes);
    if (!name) return scratchError("make a folder in", in, errno);
    const std::string folder = in + "/" + prefix + kHead + *name;
    if (::mkdir(folder.c_str(), 0700) != 0) {
      if (errno == EEXIST) continue;
      return scratchError("make a folder in", in, errno);
    }
    gobo::Descriptor lock = lockNewFile(scratchLock(folder));
    if (lock) return std::unique_ptr<ScratchFolder>(new ScratchFolder(folder, std::move(lock)));
    const int error = errno;
    ::rmdir(folder.c_str());
    if (error != ENOENT && error != EWOULDBLOCK) return scratchError("lock", scratchLock(folder), error);
  }
  return Status(Code::Unavailable, "cannot make a folder in \"" + in + "\": none of its new ones stays");
}

ScratchFolder::~ScratchFolder() {
  (void)removeScratch(path_);  // what it leaves, a daemon's next start removes
}

Result<bool> removeIfAbandoned(const std::string& folder, const std::string& prefix) {
  const std::string name = fs::path(folder).filename().string(), head = prefix + kHead;
  if (name.rfind(head, 0) != 0 || name.size() != head.size() + 2 * kRandomBytes || name.find_first_not_of("0123456789abcdef", head.size()) != std::string::npos)
    return false;  // somebody else's, empty maybe
  const std::string path = scratchLock(folder);
  const gobo::Descriptor lock = lockAbandonedFile(path);
  if (lock) {
    GOBO_TRY(removeScratch(folder));
    return true;
  }
  if (errno == EWOULDBLOCK) return false;
  if (errno != ENOENT) return scratchError("lock", path, errno);
  // Made or removed by one that was killed meanwhile, or that lives: then it makes another one.
  if (::rmdir(folder.c_str()) == 0) return true;
  if (errno == ENOTEMPTY || errno == EEXIST || errno == ENOENT) return false;
  return scratchError("remove", folder, errno);
}

Status withoutFolder(const Status& status, const std::string& folder) {
  const auto without = [place = folder + "/"](std::string text) {
    for (size_t at; (at = text.find(place)) != std::string::npos;) text.erase(at, place.size());
    return text;
  };
  return {status.code(), without(status.message()), without(status.location())};
}

}  // namespace server
}  // namespace gobo
