// SPDX-License-Identifier: Apache-2.0
// TermFiles: the file side of DiskStore: names, scanning, whole-file reads and writes of FOLDER/ab/<32 hex>.term, temp files
// in FOLDER/tmp, and the lock FOLDER/lock that every change of names is made under. Stateless but for the lock's descriptor.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"

namespace gobo {
inline namespace plan {

/// ResourceExhausted for a full disk or quota, Internal else; names the action and the file.
Status fileError(const std::string& action, const std::string& path, int error);

class TermFiles {
 public:
  struct File {
    std::string key;
    int64_t bytes = 0, modified = 0;
  };  ///< modified: microseconds since 1970
  struct Content {
    std::unique_ptr<uint8_t[]> bytes;  ///< null: not there, or (error != 0) unreadable
    size_t size = 0;
    ino_t inode = 0;
    int error = 0;
  };

  explicit TermFiles(std::string folder) : folder_(std::move(folder)) {}
  ~TermFiles();
  /// Errors: FailedPrecondition when the folder is not this user's own (base/own_folder.h); others when it cannot be made or written to.
  Status makeFolders();
  std::string path(const std::string& key) const { return folder_ + "/" + key.substr(0, 2) + "/" + key + ".term"; }
  std::string tempFolder() const { return folder_ + "/tmp"; }

  /// Takes the folder's lock, waiting for other processes at most `seconds`. Errors: Unavailable, Cancelled.
  Status lock(double seconds, const StopToken& stop = {});
  void unlock();

  std::vector<File> scan() const;  ///< every term file; foreign names are left alone
  /// What `stop`, polled every few MB, has cut short has neither bytes nor an error.
  Content read(const std::string& key, const StopToken& stop = {}) const;
  /// Size of the file, or -1; `inode` may be null.
  int64_t size(const std::string& key, ino_t* inode = nullptr) const;
  bool equals(const std::string& key, const std::vector<uint8_t>& bytes) const;  ///< by size and trailing digest
  /// Writes and syncs a temp file; on error there is none. Errors: also Cancelled; `stop` is polled every few MB, and each piece is on its
  /// way to the disk before the next but one is written, so that the sync at the end has little left to wait for.
  Status writeTemp(const std::string& temp, const std::vector<uint8_t>& bytes, const std::function<int(const char*)>& step, const StopToken& stop = {});
  Status moveIntoPlace(const std::string& temp, const std::string& key);
  Status syncFolderOf(const std::string& key);
  bool unlink(const std::string& key);  ///< true when the file is gone
  uint64_t removeStaleTemps(int64_t nowMicros, double seconds);

 private:
  std::string folder_;
  int lock_ = -1;
};

}  // namespace plan
}  // namespace gobo
