// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_out.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "base/descriptor.h"
#include "server/jobs/out_pattern.h"
#include "server/log.h"
#include "server/random_hex.h"

namespace gobo {
inline namespace jobs {

namespace {

Status outFailed(const std::string& action, const std::string& path, int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return {full ? Code::ResourceExhausted : Code::Internal, "jobs.out_folder: cannot " + action + " \"" + escaped(path) + "\": " + std::strerror(error), path};
}

bool isLinkAt(int folder, const std::string& name) {
  struct stat info {};
  return ::fstatat(folder, name.c_str(), &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISLNK(info.st_mode);
}

/// The folder below `at`, made if it is not there.
Status enterFolder(Descriptor& at, const std::string& name, const std::string& path) {
  if (::mkdirat(at.get(), name.c_str(), 0777) == 0) {
    if (::fsync(at.get()) != 0) return outFailed("sync the folder of", path, errno);
  } else if (errno != EEXIST) {
    return outFailed("make folder", path, errno);
  }
  Descriptor next{::openat(at.get(), name.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)};
  const int error = errno;
  if (next) {
    at = std::move(next);
    return {};
  }
  if (isLinkAt(at.get(), name))
    return {Code::Unavailable, "jobs.out_folder: \"" + escaped(path) + "\" is a symbolic link: files of jobs are not written through links", path};
  return outFailed("open folder", path, error);
}

/// A file beside its place; removed unless it was put there.
struct OutTemp {
  int folder;
  std::string name;
  Descriptor file;
  ~OutTemp() {
    if (!name.empty()) ::unlinkat(folder, name.c_str(), 0);
  }
};

}  // namespace

Status JobOut::write(const std::string& path, const std::vector<uint8_t>& bytes) const {
  const std::string whole = folder_ + "/" + path;
  const auto at = [&](const char* what) { return step ? step(what, whole) : Status(); };
  GOBO_TRY(at("write"));
  Descriptor folder{::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (!folder) return outFailed("open folder", folder_, errno);
  size_t begin = 0;
  for (size_t end; (end = path.find('/', begin)) != std::string::npos; begin = end + 1)
    GOBO_TRY(enterFolder(folder, path.substr(begin, end - begin), folder_ + "/" + path.substr(0, end)));
  const std::string name = path.substr(begin);
  const auto random = randomHex(8);
  if (!random) return {Code::Internal, "jobs.out_folder: the kernel gives no random bytes", whole};
  OutTemp temp{folder.get(), ".gobo-" + *random + ".part", Descriptor()};
  temp.file = Descriptor{::openat(folder.get(), temp.name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666)};
  if (!temp.file) return temp.name.clear(), outFailed("make a file beside", whole, errno);
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(temp.file.get(), bytes.data() + done, bytes.size() - done);
    if (n >= 0) done += size_t(n);
    else if (errno != EINTR) return outFailed("write", whole, errno);
  }
  GOBO_TRY(at("sync"));
  if (::fdatasync(temp.file.get()) != 0) return outFailed("sync", whole, errno);
  GOBO_TRY(at("rename"));
  if (::renameat(folder.get(), temp.name.c_str(), folder.get(), name.c_str()) != 0) return outFailed("rename the new file to", whole, errno);
  temp.name.clear();
  GOBO_TRY(at("sync-folder"));
  return ::fsync(folder.get()) == 0 ? Status() : outFailed("sync the folder of", whole, errno);
}

Status JobOut::deliver(TaskStore& store, const JobFiles& files, const Lease& lease, const std::vector<v1::FrameFile>& done) const {
  const auto record = store.get(lease.task.job, false);
  if (!record.ok()) return record.status().code() == Code::NotFound ? Status() : record.status();
  const v1::JobSpec& spec = record->job.spec();
  if (spec.out().empty() || placeOf(lease.task.index, int64_t(record->job.frames_total()), record->parts).part) return {};
  if (const auto state = store.check(lease); !state.ok()) return state.status().code() == Code::FailedPrecondition ? Status() : state.status();
  if (!on())
    return {Code::Unavailable, jobIdText(lease.task.job) + " is to be written to \"" + escaped(spec.out()) + "\", but jobs.out_folder is not set any more"};
  for (const v1::FrameFile& f : done) {
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, files.read(files.resultPath(lease.task.job, f.sha256())));
    GOBO_TRY(write(outPath(spec, jobIdText(lease.task.job), lease.frame, f.output()), bytes));
  }
  return {};
}

}  // namespace jobs
}  // namespace gobo
