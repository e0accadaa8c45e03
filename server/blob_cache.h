// SPDX-License-Identifier: Apache-2.0
// BlobCache: a folder of scene blobs named by what they were made from, bounded in bytes, least recently used out first. Safe
// against kill -9 (temporary file, fsync, rename) and against other daemons in the same folder: blobs never change, a blob
// that another one removes stays readable where it is mapped, and temporaries are locked while their writer lives.
//   KEY.blob    the blob
//   KEY.used    empty; its modification time is when the blob was last used (that of the blob would tell of a change that is none)
//   KEY.files   names of the files beside a scene file, by the key of the scene file alone
//   KEY.stamp   stat and SHA-256 of a file outside, by the digest of its path
// The folder may go, fill up or become read-only at any time: that costs time, not a load. Thread-safe.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/file_stamp.h"
#include "base/mapped_file.h"
#include "base/status.h"
#include "scene/blob.h"

namespace gobo {
inline namespace server {

std::string blobKeyHex(const BlobKey& key);
BlobKey blobKeyOf(const std::string& hex64);

class BlobCache {
 public:
  /// Makes the folder (mode 0700) and removes temporaries that nobody writes any more.
  /// Errors: FailedPrecondition when its blobs cannot be believed (base/own_folder.h); others when it cannot be made or written to.
  static Result<std::unique_ptr<BlobCache>> open(const std::string& folder, uint64_t maxBytes);

  /// The blob, mapped and marked as used; null when there is none. One that is mapped already is not mapped again: what was built over its
  /// arrays is of use to all who load it. Its arrays are checked against their digest (checkBlobArrays) the first
  /// time in this process, and again when stat shows another file or change, or one of the last two seconds (FileStamp::settled).
  /// Errors: DataLoss when they are damaged; Cancelled.
  Result<std::shared_ptr<const MappedFile>> find(const BlobKey& key, const StopToken& stop = {}) const;
  void remove(const BlobKey& key) const { drop(file(key, ".blob")); }
  /// Removes the blob that is mapped there, whatever it is called. One that has taken its place stays.
  void discard(const MappedFile& mapped) const;
  std::string path(const BlobKey& key) const { return file(key, ".blob"); }

  /// A blob that is being written: an open, locked temporary file. It is removed again unless it is committed.
  class Temporary {
   public:
    ~Temporary();
    Temporary(const Temporary&) = delete;
    Temporary& operator=(const Temporary&) = delete;
    int fd() const { return fd_; }

   private:
    friend class BlobCache;
    Temporary() = default;
    std::string path_;
    int fd_ = -1;
    bool committed_ = false, stamped_ = false;
  };
  /// Makes a folder that was deleted again. Errors: as open().
  Result<std::unique_ptr<Temporary>> begin() const;
  /// Puts the key into the header: before the file is mapped, if it is mapped before commit().
  Status stamp(Temporary& temporary, const BlobKey& key) const;
  /// Stamps it, flushes, renames, and removes what is above the bound. `mapped`: the file as its maker has it mapped, which find() gives from now on.
  Status commit(Temporary& temporary, const BlobKey& key, const std::shared_ptr<const MappedFile>& mapped = nullptr) const;

  std::optional<std::vector<std::string>> sideNames(const BlobKey& mainKey) const;
  void rememberSideNames(const BlobKey& mainKey, const std::vector<std::string>& names) const;
  /// SHA-256 of the file at `path` as it was when it had this stamp.
  std::optional<std::string> knownDigest(const std::string& path, const std::string& stamp) const;
  void rememberDigest(const std::string& path, const std::string& stamp, const std::string& digest) const;

  uint64_t bytes() const;   ///< of all blobs now
  uint64_t checks() const;  ///< how often find() has read a whole blob

 private:
  BlobCache(std::string folder, uint64_t maxBytes) : folder_(std::move(folder)), maxBytes_(maxBytes) {}
  std::string file(const BlobKey& key, const char* extension) const { return folder_ + "/" + blobKeyHex(key) + extension; }
  void trim(const std::string& keep) const;
  void drop(const std::string& blob) const;
  void rememberMapped(const std::string& path, const std::shared_ptr<const MappedFile>& mapped) const;  ///< under mutex_
  std::string folder_;
  uint64_t maxBytes_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, FileStamp> checked_;                       // files whose arrays had their digest, by path
  mutable std::map<std::string, std::weak_ptr<const MappedFile>> mapped_;  // by path
  mutable uint64_t checks_ = 0;
};

}  // namespace server
}  // namespace gobo
