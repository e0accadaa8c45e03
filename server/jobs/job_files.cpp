// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_files.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <set>
#include <utility>

#include "base/descriptor.h"
#include "base/own_folder.h"
#include "server/jobs/job_store.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace fs = std::filesystem;

namespace {

Status failed(const std::string& action, const std::string& path, int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return {full ? Code::ResourceExhausted : error == ENOENT ? Code::NotFound : Code::Internal, "cannot " + action + ": " + std::strerror(error), path};
}

constexpr double kSceneSeconds = 600;

/// "7" of results, "7-0-DIGEST.term" of checkpoints; 0: of no job.
int64_t jobOfFile(const fs::path& p) {
  const std::string name = p.filename().string();
  const size_t digits = std::min(name.find_first_not_of("0123456789"), name.size());
  if (digits == 0 || digits > 18 || (digits < name.size() && name[digits] != '-')) return 0;
  return std::atoll(name.c_str());
}

Status syncFolder(const std::string& path) {
  const Descriptor d{::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (!d || ::fsync(d.get()) != 0) return failed("sync", path, errno);
  return {};
}

Status makeFolder(const std::string& path) {
  if (::mkdir(path.c_str(), 0700) == 0) return syncFolder(fs::path(path).parent_path().string());
  return errno == EEXIST ? Status() : failed("make folder", path, errno);
}

}  // namespace

JobFiles::~JobFiles() {
  if (lock_ >= 0) ::close(lock_);
}

Status JobFiles::open(const std::string& folder, bool& alone) {
  std::error_code error;
  folder_ = fs::absolute(folder, error).lexically_normal().string();
  while (folder_.size() > 1 && folder_.back() == '/') folder_.pop_back();
  const bool fresh = !fs::exists(folder_, error);
  GOBO_TRY(makeOwnFolder(folder_, "jobs folder"));
  if (fresh) GOBO_TRY(syncFolder(fs::path(folder_).parent_path().string()));
  for (const char* sub : {"/tmp", "/checkpoints", "/results", "/scenes"}) GOBO_TRY(makeFolder(folder_ + sub));
  const std::string name = folder_ + "/lock";
  lock_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock_ < 0) return failed("open", name, errno);
  alone = ::flock(lock_, LOCK_EX | LOCK_NB) == 0;
  if (!alone && ::flock(lock_, LOCK_SH) != 0) return failed("lock", name, errno);  // waits for the one that sweeps
  std::random_device random;                                                       // process ids repeat: names of temp files must not
  temps_ = folder_ + "/tmp/" + std::to_string(::getpid()) + "-" + std::to_string(random()) + "-";
  return {};
}

void JobFiles::opened() { ::flock(lock_, LOCK_SH); }

Status JobFiles::write(const std::string& path, const void* bytes, size_t size) {
  struct stat info {};
  const std::string parent = fs::path(path).parent_path().string();
  if (::stat(path.c_str(), &info) == 0 && size_t(info.st_size) == size) {
    ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0);  // changed, for a sweep that has taken it for litter
    return syncFolder(parent);                        // its writer may have been killed before that
  }
  Incoming file;
  GOBO_TRY(file.begin(*this, path));
  GOBO_TRY(file.add(bytes, size));
  return file.commit();
}

Status JobFiles::Incoming::begin(JobFiles& files, const std::string& path) {
  files_ = &files;
  path_ = path;
  if (files.step) GOBO_TRY(files.step("write", path));
  temp_ = files.temps_ + std::to_string(files.counter_++) + ".tmp";
  fd_ = ::open(temp_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd_ >= 0) return {};
  return failed("make", std::exchange(temp_, {}), errno);
}

Status JobFiles::Incoming::add(const void* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    const ssize_t n = ::write(fd_, static_cast<const char*>(bytes) + done, size - done);
    if (n >= 0) done += size_t(n);
    else if (errno != EINTR) return failed("write", path_, errno);
  }
  return {};
}

Status JobFiles::Incoming::commit() {
  const auto at = [&](const char* what) { return files_->step ? files_->step(what, path_) : Status(); };
  const std::string parent = fs::path(path_).parent_path().string();
  GOBO_TRY(at("sync"));
  if (::fdatasync(fd_) != 0) return failed("sync", path_, errno);
  GOBO_TRY(at("rename"));
  if (::rename(temp_.c_str(), path_.c_str()) != 0) {
    if (errno != ENOENT) return failed("rename the new file to", path_, errno);
    GOBO_TRY(makeFolder(parent));
    if (::rename(temp_.c_str(), path_.c_str()) != 0) return failed("rename the new file to", path_, errno);
  }
  temp_.clear();
  GOBO_TRY(at("sync-folder"));
  return syncFolder(parent);
}

JobFiles::Incoming::~Incoming() {
  if (fd_ >= 0) ::close(fd_);
  if (!temp_.empty()) ::unlink(temp_.c_str());
}

Status JobFiles::adopt(const std::string& from, const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) {
    ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0);  // young again: no sweep
    return {};
  }
  if (::link(from.c_str(), path.c_str()) == 0) {
    const Descriptor d{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
    if (!d || ::fdatasync(d.get()) != 0) return failed("sync", path, errno);
    return syncFolder(fs::path(path).parent_path().string());
  }
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, read(from));
  return write(path, bytes.data(), bytes.size());
}

Status JobFiles::adoptTree(const std::string& from, const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) {
    ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0);  // young again: no sweep
    return {};
  }
  const std::string temp = temps_ + std::to_string(counter_++) + ".tmp";
  std::error_code error;
  Status status = makeFolder(temp);
  for (fs::recursive_directory_iterator it(from, error), end; status.ok() && !error && it != end; it.increment(error)) {
    const std::string to = temp + it->path().string().substr(from.size());
    status = it->is_directory(error) ? makeFolder(to) : adopt(it->path().string(), to);
  }
  if (status.ok() && error) status = failed("list", from, error.value());
  if (status.ok() && ::rename(temp.c_str(), path.c_str()) != 0 && ::stat(path.c_str(), &info) != 0) status = failed("rename the new folder to", path, errno);
  fs::remove_all(temp, error);  // also where another call was first
  return status.ok() ? syncFolder(fs::path(path).parent_path().string()) : status;
}

Result<std::vector<uint8_t>> JobFiles::read(const std::string& path) const {
  const Descriptor d{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW)};
  struct stat info {};
  if (!d || ::fstat(d.get(), &info) != 0) return failed("read", path, errno);
  std::vector<uint8_t> bytes(size_t(info.st_size));
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::read(d.get(), bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return failed("read", path, n < 0 ? errno : EIO);
    done += size_t(n);
  }
  return bytes;
}

void JobFiles::remove(const std::string& path) { ::unlink(path.c_str()); }

void JobFiles::removeResults(int64_t job) {
  std::error_code ignored;
  fs::remove_all(resultFolder(job), ignored);
}

void JobFiles::removePrefix(const std::string& prefix) {
  std::error_code error;
  std::vector<fs::path> found;
  for (fs::directory_iterator it(folder_ + "/checkpoints", error), end; !error && it != end; it.increment(error))
    if (it->path().filename().string().rfind(prefix, 0) == 0) found.push_back(it->path());
  for (const fs::path& p : found) ::unlink(p.c_str());
}

void JobFiles::removeAllOnTheirWay() {
  std::error_code error;
  for (const char* sub : {"/results", "/checkpoints", "/tmp"})
    for (fs::directory_iterator it(folder_ + sub, error), end; !error && it != end; it.increment(error)) {
      std::error_code ignored;
      fs::remove_all(it->path(), ignored);
    }
}

void JobFiles::removeCheckpoints(int64_t job) { removePrefix(std::to_string(job) + "-"); }
void JobFiles::removeCheckpoints(TaskId task) { removePrefix(std::to_string(task.job) + "-" + std::to_string(task.index) + "-"); }

Result<std::string> JobFiles::identity() const {
  const auto bytes = read(identityPath());
  if (bytes.status().code() == Code::NotFound) return std::string();
  if (!bytes.ok()) return bytes.status();
  const std::string text(bytes->begin(), bytes->end());
  if (text.size() == 33 && text[32] == '\n' && text.find_first_not_of("0123456789abcdef") == 32) return text.substr(0, 32);
  return Status(Code::DataLoss, "is not the identity of a job store: remove it if jobs.sqlite is the store of this folder", identityPath());
}

Status JobFiles::writeIdentity(const std::string& id) { return write(identityPath(), (id + "\n").data(), id.size() + 1); }

bool JobFiles::holdsPromises() const {
  std::error_code error;
  for (const char* sub : {"/results", "/checkpoints"})
    if (fs::directory_iterator(folder_ + sub, error) != fs::directory_iterator()) return true;
  return !fs::exists(storePath(), error) && fs::exists(storePath() + "-wal", error);
}

int64_t JobFiles::lastJob() const {
  int64_t last = 0;
  for (const char* sub : {"/results", "/checkpoints"}) {
    std::error_code error;
    for (fs::directory_iterator it(folder_ + sub, error), end; !error && it != end; it.increment(error)) last = std::max(last, jobOfFile(it->path()));
  }
  return last;
}

Status JobFiles::sweep(JobStore& store, double age) {
  std::error_code error;
  const auto each = [&](const std::string& folder, const auto& visit) {
    std::vector<fs::path> found;
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) found.push_back(it->path());
    for (const fs::path& p : found) visit(p);
  };
  uint64_t removed = 0;
  const auto drop = [&](const fs::path& p) {
    if (litter.lain(p.string(), age)) removed += fs::remove_all(p, error) > 0;
  };
  each(folder_ + "/tmp", drop);
  GOBO_ASSIGN(const OwnedJobs owned, store.owned());  // before what they need: a job submitted meanwhile is not one that needs nothing
  GOBO_ASSIGN(const auto digests, store.neededCheckpoints());
  const std::set<std::string> checkpoints(digests.begin(), digests.end());
  each(folder_ + "/checkpoints", [&](const fs::path& p) {
    if (owned.has(jobOfFile(p)) && !checkpoints.count(p.stem().string())) drop(p);
  });
  GOBO_ASSIGN(const auto ids, store.jobIds());
  const std::set<int64_t> jobs(ids.begin(), ids.end());
  Status status;
  each(folder_ + "/results", [&](const fs::path& p) {
    const int64_t id = jobOfFile(p);
    if (!owned.has(id)) return;
    if (!jobs.count(id)) return drop(p);
    // Of a job that goes on, an older copy of the store does not name what was finished since; its frames come to the same files.
    const auto job = store.get(id, false);
    if (!job.ok() || !jobIsOver(job->job.state())) return;
    const auto names = store.neededResults(id);
    if (!names.ok()) {
      status = names.status();
      return;
    }
    const std::set<std::string> needed(names->begin(), names->end());
    each(p.string(), [&](const fs::path& file) {
      if (!needed.count(file.filename().string())) drop(file);
    });
  });
  litter.forget(2 * 3600);  // swept hourly
  if (removed) logInfo("jobs: removed %llu files that nothing needs", (unsigned long long)removed);
  return status;
}

void JobFiles::sweepScenes(const std::vector<std::string>& needed, const std::vector<std::string>& loaded) {
  std::error_code error;
  std::vector<fs::path> gone;
  for (fs::directory_iterator it(folder_ + "/scenes", error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const auto isOf = [&](const std::string& n) { return n == name || n.rfind(name + "/", 0) == 0 || name.rfind(n + ".", 0) == 0; };
    if (std::any_of(needed.begin(), needed.end(), isOf)) continue;
    if (std::any_of(loaded.begin(), loaded.end(), [&](const std::string& digest) { return name.rfind(digest, 0) == 0; })) continue;
    if (litter.lain(it->path().string(), kSceneSeconds)) gone.push_back(it->path());
  }
  for (const fs::path& p : gone) fs::remove_all(p, error);
}

}  // namespace jobs
}  // namespace gobo
