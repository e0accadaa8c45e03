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
inline namespace scene {
namespace {

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

Result<int> openBeside(const std::string& mainPath, const std::string& name) {
  GOBO_TRY(checkSideName(name, name));
  const auto refuse = [&] { return invalidArgument("URI \"" + name.substr(0, 100) + "\" leaves the folder of the glTF"); };
  const size_t slash = mainPath.find_last_of('/');
  const std::string folder = slash == std::string::npos ? "." : mainPath.substr(0, slash + 1);
  const int at = ::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (at < 0) return ioError("cannot open file", folder);
  open_how how{};
  how.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS;
  int fd = int(::syscall(SYS_openat2, at, name.c_str(), &how, sizeof how));
  const int error = errno;
  ::close(at);
  if (fd < 0 && (error == ENOSYS || error == EPERM)) {  // an old kernel, or a container's filter that does not know the call
    const std::string base = realPath(folder), file = realPath(folder + "/" + name);
    if (file.empty()) return notFound("file \"" + name + "\" does not exist beside the glTF");
    if (base != "/" && file.compare(0, base.size() + 1, base + "/") != 0) return refuse();
    fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
    if (fd < 0) return ioError("cannot open file", name);
  } else if (fd < 0) {
    if (error == ENOENT || error == ENOTDIR) return notFound("file \"" + name + "\" does not exist beside the glTF");
    if (error == EXDEV || error == ELOOP) return refuse();
    errno = error;
    return ioError("cannot open file", name);
  }
  return regularOrClose(fd, name);
}

Result<std::vector<uint8_t>> DiskFiles::main(uint64_t maxBytes) { return readFile(path_, maxBytes); }

Result<std::vector<uint8_t>> DiskFiles::beside(const std::string& name, uint64_t maxBytes) {
  GOBO_ASSIGN(const int fd, openBeside(path_, name));
  auto bytes = readAndClose(fd, name, maxBytes);
  if (!bytes.ok()) return Status(bytes.status().code(), bytes.status().message() + " (\"" + name + "\")");
  return bytes;
}

}  // namespace scene
}  // namespace gobo
