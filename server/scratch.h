// SPDX-License-Identifier: Apache-2.0
// Scratch: files and folders that a daemon makes for a while, and what a killed one leaves of them. Each is locked (flock) while its maker lives, so whoever
// can lock it knows that the maker is gone. Numbers of processes do not tell: they are used again, and in containers many daemons are process 1.
//   FOLDER/PREFIXxHEX/         mode 0700
//   FOLDER/PREFIXxHEX/.lock    empty, locked
// Functions are thread-safe.
#pragma once

#include <memory>
#include <string>

#include "base/descriptor.h"
#include "base/status.h"

namespace gobo {
inline namespace server {

/// Makes the file (mode 0600) and locks it. None, and nothing is left of it, with an errno: after EEXIST, ENOENT (no folder) and EWOULDBLOCK (a daemon that
/// starts took it for a dead one's) another name may do.
gobo::Descriptor lockNewFile(const std::string& path);
/// The file, locked; none with an errno, which is EWOULDBLOCK while its maker lives.
gobo::Descriptor lockAbandonedFile(const std::string& path);

/// A fresh folder, which goes with the object.
class ScratchFolder {
 public:
  /// Errors: ResourceExhausted, Unavailable, Internal, naming the folder or file.
  static Result<std::unique_ptr<ScratchFolder>> make(const std::string& in, const std::string& prefix);
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  ScratchFolder(std::string path, gobo::Descriptor lock) : path_(std::move(path)), lock_(std::move(lock)) {}
  std::string path_;
  gobo::Descriptor lock_;
};

/// What a reader of files below `folder` said, for a client: names relative to it, since where the daemon keeps them is its own business.
Status withoutFolder(const Status& status, const std::string& folder);

/// Removes a folder of a ScratchFolder whose process is gone. False: it lives, nobody can tell for want of a lock file, or the name is none that make() gives.
/// Errors: naming the path.
Result<bool> removeIfAbandoned(const std::string& folder, const std::string& prefix);

}  // namespace server
}  // namespace gobo
