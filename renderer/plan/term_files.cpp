// SPDX-License-Identifier: Apache-2.0
#include "plan/term_files.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <new>
#include <thread>

#include "base/descriptor.h"
#include "base/hash.h"
#include "base/own_folder.h"

namespace gobo {
inline namespace plan {

namespace {

constexpr size_t kPiece = size_t(4) << 20;  // bytes between two looks at a stop token

int openRetry(const std::string& path, int flags, mode_t mode = 0644) {
  int fd;
  do fd = ::open(path.c_str(), flags | O_CLOEXEC, mode);
  while (fd < 0 && errno == EINTR);
  return fd;
}

int syncFolder(const std::string& path) {
  Descriptor d(openRetry(path, O_RDONLY | O_DIRECTORY));
  return d && ::fsync(d.get()) == 0 ? 0 : errno;
}

int64_t micros(const timespec& t) { return int64_t(t.tv_sec) * 1000000 + t.tv_nsec / 1000; }

template <typename F>
void eachEntry(const std::string& folder, F f) {
  DIR* dir = ::opendir(folder.c_str());
  if (!dir) return;
  while (const dirent* e = ::readdir(dir)) {
    struct stat st;
    if (::fstatat(::dirfd(dir), e->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(st.st_mode)) f(std::string(e->d_name), st);
  }
  ::closedir(dir);
}

}  // namespace

Status fileError(const std::string& action, const std::string& path, int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return {full ? Code::ResourceExhausted : Code::Internal, "cannot " + action + ": " + std::strerror(error), path};
}

TermFiles::~TermFiles() {
  if (lock_ >= 0) ::close(lock_);
}

Status TermFiles::makeFolders() {
  GOBO_TRY(makeOwnFolder(folder_, "cache folder"));
  if (::mkdir(tempFolder().c_str(), 0700) != 0 && errno != EEXIST) return fileError("make cache folder", tempFolder(), errno);
  if (::access(folder_.c_str(), W_OK | X_OK) != 0 || ::access(tempFolder().c_str(), W_OK | X_OK) != 0)
    return fileError("write to cache folder", folder_, errno);
  return {};
}

Status TermFiles::lock(double seconds, const StopToken& stop) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  const std::string name = folder_ + "/lock";
  for (;;) {
    struct stat mine, named;
    // Somebody may have removed the folder, or its lock: two holders of two different files would both believe they have it.
    if (lock_ < 0 || ::fstat(lock_, &mine) != 0 || ::stat(name.c_str(), &named) != 0 || mine.st_ino != named.st_ino || mine.st_dev != named.st_dev) {
      if (lock_ >= 0) ::close(lock_);
      lock_ = -1;
      GOBO_TRY(makeFolders());  // and what is there now may be another's
      lock_ = openRetry(name, O_RDWR | O_CREAT);
      if (lock_ < 0) return fileError("open the lock of the cache folder", name, errno);
    }
    if (::flock(lock_, LOCK_EX | LOCK_NB) == 0) {
      if (::fstat(lock_, &mine) == 0 && ::stat(name.c_str(), &named) == 0 && mine.st_ino == named.st_ino) return {};
      ::flock(lock_, LOCK_UN);
      continue;
    }
    if (errno != EWOULDBLOCK && errno != EINTR) return fileError("lock the cache folder", name, errno);
    if (stop.stopRequested()) return {Code::Cancelled, "stopped while waiting for the cache folder", name};
    if (std::chrono::steady_clock::now() >= until) return {Code::Unavailable, "cache folder is held by another process", name};
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
}

void TermFiles::unlock() {
  if (lock_ >= 0) ::flock(lock_, LOCK_UN);
}

std::vector<TermFiles::File> TermFiles::scan() const {
  std::vector<File> files;
  static const char* digits = "0123456789abcdef";
  for (int i = 0; i < 256; ++i) {
    const std::string head{digits[i >> 4], digits[i & 15]};
    eachEntry(folder_ + "/" + head, [&](const std::string& name, const struct stat& st) {
      if (name.size() != 37 || name.compare(32, 5, ".term") != 0 || name.compare(0, 2, head) != 0) return;
      if (name.find_first_not_of(digits) != 32) return;
      files.push_back({name.substr(0, 32), int64_t(st.st_size), micros(st.st_mtim)});
    });
  }
  return files;
}

TermFiles::Content TermFiles::read(const std::string& key, const StopToken& stop) const {
  // read() and not mmap: a bad sector is then an error here, not SIGBUS in whoever touches the page.
  Content c;
  Descriptor d(openRetry(path(key), O_RDONLY | O_NOFOLLOW | O_NONBLOCK));
  struct stat st;
  if (!d) {
    c.error = errno == ENOENT || errno == ENOTDIR ? 0 : errno;
    return c;
  }
  if (::fstat(d.get(), &st) != 0) {
    c.error = errno;
    return c;
  }
  c.inode = st.st_ino;
  if (!S_ISREG(st.st_mode)) {
    c.error = EISDIR;
    return c;
  }
  std::unique_ptr<uint8_t[]> bytes(new (std::nothrow) uint8_t[size_t(st.st_size) + 1]);
  if (!bytes) {
    c.error = ENOMEM;
    return c;
  }
  while (c.size < size_t(st.st_size)) {
    if (stop.stopRequested()) return {};
    const ssize_t n = ::read(d.get(), bytes.get() + c.size, std::min(kPiece, size_t(st.st_size) - c.size));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) c.error = errno;
    if (n <= 0) break;
    c.size += size_t(n);
  }
  if (!c.error) c.bytes = std::move(bytes);
  return c;
}

int64_t TermFiles::size(const std::string& key, ino_t* inode) const {
  struct stat st;
  if (::lstat(path(key).c_str(), &st) != 0) return -1;
  if (inode) *inode = st.st_ino;
  return st.st_size;
}

bool TermFiles::equals(const std::string& key, const std::vector<uint8_t>& bytes) const {
  if (bytes.size() < 16) return false;
  Descriptor d(openRetry(path(key), O_RDONLY | O_NOFOLLOW | O_NONBLOCK));
  struct stat st;
  if (!d || ::fstat(d.get(), &st) != 0 || size_t(st.st_size) != bytes.size()) return false;
  uint8_t tail[16];
  return ::pread(d.get(), tail, 16, off_t(bytes.size() - 16)) == 16 && std::memcmp(tail, bytes.data() + bytes.size() - 16, 16) == 0;
}

Status TermFiles::writeTemp(const std::string& temp, const std::vector<uint8_t>& bytes, const std::function<int(const char*)>& step, const StopToken& stop) {
  int error = step("create");
  Descriptor d(error ? -1 : openRetry(temp, O_WRONLY | O_CREAT | O_EXCL));
  if (!error && !d && errno == ENOENT) {
    GOBO_TRY(makeFolders());
    d = Descriptor(openRetry(temp, O_WRONLY | O_CREAT | O_EXCL));
  }
  if (!d) return fileError("make", temp, error ? error : errno);
  error = step("write");
  bool stopped = false;
  for (size_t at = 0; !error && !stopped && at < bytes.size();) {
    const ssize_t n = ::write(d.get(), bytes.data() + at, std::min(kPiece, bytes.size() - at));
    if (n < 0 && errno != EINTR) error = errno;
    if (n < 0) continue;
    if (bytes.size() > kPiece) {  // hints: what they could not do, fdatasync() does
      ::sync_file_range(d.get(), off_t(at), n, SYNC_FILE_RANGE_WRITE);
      if (at >= kPiece)
        ::sync_file_range(d.get(), off_t(at - kPiece), off_t(kPiece), SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER);
    }
    at += size_t(n);
    stopped = stop.stopRequested();
  }
  if (stopped && !error) {
    ::unlink(temp.c_str());
    return {Code::Cancelled, "stopped while writing", temp};
  }
  if (!error) error = step("sync");
  if (!error && ::fdatasync(d.get()) != 0) error = errno;
  if (!error) return {};
  ::unlink(temp.c_str());
  return fileError("write", temp, error);
}

Status TermFiles::moveIntoPlace(const std::string& temp, const std::string& key) {
  const std::string to = path(key);
  if (::rename(temp.c_str(), to.c_str()) == 0) return {};
  const std::string sub = folder_ + "/" + key.substr(0, 2);
  if (errno != ENOENT) return fileError("rename the new file to", to, errno);
  if (::mkdir(sub.c_str(), 0700) != 0 && errno != EEXIST) return fileError("make", sub, errno);
  if (const int error = syncFolder(folder_)) return fileError("sync", folder_, error);
  if (::rename(temp.c_str(), to.c_str()) != 0) return fileError("rename the new file to", to, errno);
  return {};
}

Status TermFiles::syncFolderOf(const std::string& key) {
  const std::string sub = folder_ + "/" + key.substr(0, 2);
  const int error = syncFolder(sub);
  return error ? fileError("sync", sub, error) : Status();
}

bool TermFiles::unlink(const std::string& key) { return ::unlink(path(key).c_str()) == 0 || errno == ENOENT; }

uint64_t TermFiles::removeStaleTemps(int64_t nowMicros, double seconds) {
  uint64_t removed = 0;
  eachEntry(tempFolder(), [&](const std::string& name, const struct stat& st) {
    if (double(nowMicros - micros(st.st_mtim)) * 1e-6 < seconds) return;
    if (::unlink((tempFolder() + "/" + name).c_str()) == 0) ++removed;
  });
  return removed;
}

}  // namespace plan
}  // namespace gobo
