// SPDX-License-Identifier: Apache-2.0
#include "server/upload.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "server/log.h"

namespace gobo {
inline namespace server {

namespace fs = std::filesystem;

UploadFile::~UploadFile() {
  if (fd_ >= 0) ::close(fd_);
}

Status UploadFile::begin(const std::string& tmpFolder, const v1::UploadSceneRequest& first, uint64_t maxBytes, const char* limitKey) {
  std::string extension = first.extension();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (extension != ".glb" && extension != ".gltf")
    return invalidArgument("extension = \"" + escaped(first.extension()) + "\": must be .glb or .gltf", "upload.extension");
  if (first.total_bytes() == 0) return invalidArgument("total_bytes = 0: the first message must say how much follows", "upload.total_bytes");
  if (first.total_bytes() > maxBytes)
    return {Code::ResourceExhausted,
            "total_bytes = " + std::to_string(first.total_bytes()) + ": uploads are limited to " + std::to_string(maxBytes) + " bytes (" + limitKey + ")",
            "upload.total_bytes"};
  expected_ = first.sha256();
  std::transform(expected_.begin(), expected_.end(), expected_.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (!expected_.empty() && (expected_.size() != 64 || expected_.find_first_not_of("0123456789abcdef") != std::string::npos))
    return invalidArgument("sha256 = \"" + escaped(first.sha256().substr(0, 80)) + "\": must be 64 hex digits", "upload.sha256");
  total_ = first.total_bytes();
  auto made = ScratchFolder::make(tmpFolder, kUploadFolder);
  if (!made.ok()) return internalError(made.status().message());
  folder_ = std::move(*made);
  path_ = folder_->path() + "/scene" + extension;
  fd_ = ::open(path_.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600);
  if (fd_ < 0) return internalError("cannot write \"" + path_ + "\": " + std::strerror(errno));
  return {};
}

Status UploadFile::add(const std::string& data) {
  if (data.size() > total_ - received_) return invalidArgument("data goes beyond total_bytes = " + std::to_string(total_), "upload.data");
  size_t at = 0;
  while (at < data.size()) {
    const ssize_t n = ::write(fd_, data.data() + at, data.size() - at);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return {errno == ENOSPC ? Code::ResourceExhausted : Code::Internal, "cannot write \"" + path_ + "\": " + std::strerror(errno)};
    at += size_t(n);
  }
  sha_.add(data.data(), data.size());
  received_ += data.size();
  return {};
}

Status UploadFile::finish() {
  if (received_ != total_)
    return invalidArgument("received " + std::to_string(received_) + " bytes of total_bytes = " + std::to_string(total_), "upload.total_bytes");
  digest_ = sha_.hex();
  if (!expected_.empty() && digest_ != expected_) return invalidArgument("sha256 = " + expected_ + ": the bytes received have " + digest_, "upload.sha256");
  if (::close(std::exchange(fd_, -1)) != 0) return internalError("cannot write \"" + path_ + "\": " + std::strerror(errno));
  return {};
}

/// One of an earlier version, which had its process's number for a name and no lock.
static Result<bool> removeOfProcess(const std::string& folder, long pid) {
  if (::kill(pid_t(pid), 0) == 0 || errno != ESRCH) return false;
  std::error_code error;
  fs::remove_all(folder, error);
  if (error) return internalError("cannot remove \"" + folder + "\": " + error.message());
  return true;
}

void removeStaleUploads(const std::string& tmpFolder) {
  std::error_code error;
  for (fs::directory_iterator it(tmpFolder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const char* const prefix = name.rfind(kUploadFolder, 0) == 0 ? kUploadFolder : kWorkerFolder;
    if (name.rfind(prefix, 0) != 0) continue;
    struct stat info {};
    if (::lstat(it->path().c_str(), &info) != 0 || !S_ISDIR(info.st_mode) || info.st_uid != ::getuid()) continue;
    const long pid = std::atol(name.c_str() + std::strlen(prefix));
    const Result<bool> removed = pid > 0 ? removeOfProcess(it->path().string(), pid) : removeIfAbandoned(it->path().string(), prefix);
    if (!removed.ok()) logWarn("stale folders: %s", removed.status().toString().c_str());
    else if (*removed) logInfo("removed stale folder %s", it->path().c_str());
  }
}

}  // namespace server
}  // namespace gobo
