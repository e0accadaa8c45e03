// SPDX-License-Identifier: Apache-2.0
#include "scene/file_source.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "base/image_io.h"

namespace gobo {
namespace {

Status openError(const std::string& path) {
  const Code code = errno == ENOENT || errno == ENOTDIR ? Code::NotFound : errno == EACCES || errno == EPERM ? Code::PermissionDenied
                    : errno == EMFILE || errno == ENFILE ? Code::ResourceExhausted : Code::Unavailable;
  return Status(code, std::string("cannot open file: ") + std::strerror(errno), path);
}

Result<int> regular(int fd, const std::string& path) {
  struct stat info{};
  if (::fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) return fd;
  ::close(fd);
  return invalidArgument("not a regular file", path);
}

std::string realPath(const std::string& p) {
  char* r = ::realpath(p.c_str(), nullptr);
  std::string s = r ? r : "";
  ::free(r);
  return s;
}

}  // namespace

Status checkSideName(const std::string& name, const std::string& shown) {
  const auto refuse = [&](const char* why) { return invalidArgument("URI \"" + shown.substr(0, 100) + "\" " + why); };
  if (name.empty() || name.find('\0') != std::string::npos) return refuse("is empty or holds a zero byte");
  if (name.size() > 1024) return refuse("is longer than 1024 bytes");
  if (name[0] == '/' || name[0] == '\\' || name[0] == '~') return refuse("is absolute");
  const size_t colon = name.find(':');
  if (colon != std::string::npos && colon < name.find('/')) return refuse("has a scheme; only files beside the glTF are read");
  for (size_t from = 0; from <= name.size();) {
    const size_t to = std::min(name.find_first_of("/\\", from), name.size());
    if (name.compare(from, to - from, "..") == 0) return refuse("leaves the folder of the glTF");
    from = to + 1;
  }
  return {};
}

Result<int> openRegular(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return openError(path);
  return regular(fd, path);
}

Result<int> openBeside(const std::string& mainPath, const std::string& name) {
  GOBO_TRY(checkSideName(name, name));
  const auto refuse = [&] { return invalidArgument("URI \"" + name.substr(0, 100) + "\" leaves the folder of the glTF"); };
  const size_t slash = mainPath.find_last_of('/');
  const std::string folder = slash == std::string::npos ? "." : mainPath.substr(0, slash + 1);
  const int at = ::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (at < 0) return openError(folder);
  open_how how{};
  how.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS;
  int fd = int(::syscall(SYS_openat2, at, name.c_str(), &how, sizeof how));
  const int error = errno;
  ::close(at);
  if (fd < 0 && (error == ENOSYS || error == EPERM)) {   // an old kernel, or a container's filter that does not know the call
    const std::string base = realPath(folder), file = realPath(folder + "/" + name);
    if (file.empty()) return notFound("file \"" + name + "\" does not exist beside the glTF");
    if (base != "/" && file.compare(0, base.size() + 1, base + "/") != 0) return refuse();
    fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
    if (fd < 0) return openError(name);
  } else if (fd < 0) {
    if (error == ENOENT || error == ENOTDIR) return notFound("file \"" + name + "\" does not exist beside the glTF");
    if (error == EXDEV || error == ELOOP) return refuse();
    errno = error;
    return openError(name);
  }
  return regular(fd, name);
}

Result<std::vector<uint8_t>> readAndClose(int fd, const std::string& name, uint64_t maxBytes) {
  struct stat info{};
  Status status;
  std::vector<uint8_t> bytes;
  if (::fstat(fd, &info) != 0) status = openError(name);
  else if (uint64_t(info.st_size) > maxBytes)
    status = Status(Code::ResourceExhausted, "file of " + std::to_string(info.st_size) + " bytes is above the limit of " + std::to_string(maxBytes), name);
  if (status.ok()) {
    bytes.resize(size_t(info.st_size));
    size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t n = ::read(fd, bytes.data() + done, bytes.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) { status = Status(Code::Unavailable, std::string("cannot read file: ") + std::strerror(errno), name); break; }
      if (n == 0) break;   // shortened while being read
      done += size_t(n);
    }
    bytes.resize(done);
  }
  ::close(fd);
  if (!status.ok()) return status;
  return bytes;
}

Result<std::vector<uint8_t>> DiskFiles::main(uint64_t maxBytes) { return readFile(path_, maxBytes); }

Result<std::vector<uint8_t>> DiskFiles::beside(const std::string& name, uint64_t maxBytes) {
  GOBO_ASSIGN(const int fd, openBeside(path_, name));
  auto bytes = readAndClose(fd, name, maxBytes);
  if (!bytes.ok()) return Status(bytes.status().code(), bytes.status().message() + " (\"" + name + "\")");
  return bytes;
}

}  // namespace gobo
