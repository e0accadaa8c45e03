// SPDX-License-Identifier: Apache-2.0
#include "base/own_folder.h"

#include <limits.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <sstream>

#include "base/image_io.h"

namespace gobo {
inline namespace base {

namespace {

constexpr int kMostLinks = 40;  // as the kernel's

std::string absolute(const std::string& folder) {
  std::error_code error;
  std::string path = std::filesystem::absolute(folder, error).string();
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  return path;
}

std::string modeText(mode_t mode) {
  char text[8];
  std::snprintf(text, sizeof text, "%04o", unsigned(mode & 07777));
  return text;
}

struct Judge {
  std::string what, folder;
  uid_t user = ::geteuid();
  gid_t group = ::getegid();

  Status refuse(const std::string& problem, const std::string& remedy) const {
    return {Code::FailedPrecondition, what + ": " + problem + "; " + remedy, folder};
  }
  Status link(const std::string& path, const struct stat& s) const {
    if (s.st_uid == user || s.st_uid == 0) return {};
    return refuse("\"" + path + "\" is a link of user " + std::to_string(s.st_uid),
                  "name the folder itself, or make the link as this user (" + std::to_string(user) + ")");
  }
  Status above(const std::string& path, const struct stat& s) const {
    if (!S_ISDIR(s.st_mode)) return refuse("\"" + path + "\" is not a folder", "name another folder");
    if (s.st_mode & S_ISVTX) return {};
    const bool all = s.st_mode & S_IWOTH, some = (s.st_mode & S_IWGRP) && s.st_gid != 0 && s.st_gid != group;
    if (!all && !some) return {};
    return refuse("others may write to \"" + path + "\" (mode " + modeText(s.st_mode) + "), which holds it, and so put another folder in its place",
                  std::string("chmod ") + (all ? "o-w" : "g-w") + " \"" + path + "\", or name another folder");
  }
  Status own(const std::string& path, const struct stat& s) const {
    if (!S_ISDIR(s.st_mode)) return refuse("\"" + path + "\" is not a folder", "name another folder");
    if (s.st_uid != user)
      return refuse("belongs to user " + std::to_string(s.st_uid) + " and not to this one (" + std::to_string(user) + ")",
                    "chown " + std::to_string(user) + " \"" + path + "\" if its files can be trusted, or name another folder");
    if (s.st_mode & 0022)
      return refuse("others may write to it (mode " + modeText(s.st_mode) + ")",
                    "chmod 0700 \"" + path + "\" if its files can be trusted, or name another folder");
    return {};
  }
};

}  // namespace

Status checkOwnFolder(const std::string& name, const std::string& what) {
  const Judge judge{what, absolute(name)};
  // Walked part by part as the kernel does it, so that every folder and link on the way is seen.
  std::deque<std::string> parts;
  const auto prepend = [&](const std::string& path) {
    std::deque<std::string> more;
    std::istringstream in(path);
    for (std::string part; std::getline(in, part, '/');)
      if (!part.empty() && part != ".") more.push_back(part);
    parts.insert(parts.begin(), more.begin(), more.end());
  };
  prepend(judge.folder);
  std::string at = "/";
  struct stat s {};
  if (::lstat("/", &s) != 0) return ioError(what + ": cannot examine", "/");
  for (int links = 0; !parts.empty();) {
    GOBO_TRY(judge.above(at, s));
    const std::string part = parts.front();
    parts.pop_front();
    std::string next = part == ".." ? std::filesystem::path(at).parent_path().string() : (at == "/" ? "" : at) + "/" + part;
    struct stat n {};
    if (::lstat(next.c_str(), &n) != 0) return ioError(what + ": cannot examine", next);
    if (!S_ISLNK(n.st_mode)) {
      at = std::move(next);
      s = n;
      continue;
    }
    GOBO_TRY(judge.link(next, n));
    if (++links > kMostLinks) return judge.refuse("too many links", "name the folder itself");
    char target[PATH_MAX];
    const ssize_t size = ::readlink(next.c_str(), target, sizeof target);
    if (size < 0) return ioError(what + ": cannot read the link", next);
    const std::string to(target, size_t(size));
    prepend(to);
    if (to.empty() || to[0] != '/') continue;
    at = "/";
    if (::lstat("/", &s) != 0) return ioError(what + ": cannot examine", "/");
  }
  return judge.own(at, s);
}

Status makeOwnFolder(const std::string& name, const std::string& what) {
  const std::string folder = absolute(name);
  for (size_t end = folder.find('/', 1); end != std::string::npos; end = folder.find('/', end + 1))
    if (const std::string above = folder.substr(0, end); ::mkdir(above.c_str(), 0755) != 0) {
      const int error = errno;  // EEXIST, but also EROFS, EACCES, EPERM of what is there
      struct stat s {};
      if (::stat(above.c_str(), &s) == 0) continue;
      errno = error;
      return ioError(what + ": cannot make the folder", above);
    }
  if (::mkdir(folder.c_str(), 0700) != 0) {
    const int error = errno;
    struct stat s {};
    if (::stat(folder.c_str(), &s) != 0) {
      errno = error;
      return ioError(what + ": cannot make the folder", folder);
    }
  }
  return checkOwnFolder(folder, what);
}

}  // namespace base
}  // namespace gobo
