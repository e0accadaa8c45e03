// SPDX-License-Identifier: Apache-2.0
// BlobCache: a folder of scene blobs named by what they were made from, bounded in bytes, least recently used out first. Safe
// against kill -9 (temporary file, fsync, rename) and against other daemons in the same folder: blobs never change, a blob
// that another one removes stays readable where it is mapped, and temporaries are locked while their writer lives.
//   KEY.blob    the blob; its modification time is when it was last used
//   KEY.files   names of the files beside a scene file, by the key of the scene file alone
//   KEY.stamp   stat and SHA-256 of a file outside, by the digest of its path
// Thread-safe.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/mapped_file.h"
#include "base/status.h"
#include "scene/blob.h"

namespace gobo {

std::string blobKeyHex(const BlobKey& key);
BlobKey blobKeyOf(const std::string& hex64);

class BlobCache {
 public:
  /// Makes the folder (mode 0700) and removes temporaries that nobody writes any more.
  /// Errors: FailedPrecondition when the folder belongs to another user or others may write to it; Internal.
  static Result<std::unique_ptr<BlobCache>> open(const std::string& folder, uint64_t maxBytes);

  /// The blob, mapped and marked as used; null when there is none.
  std::shared_ptr<const MappedFile> find(const BlobKey& key) const;
  void remove(const BlobKey& key) const;

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
    bool committed_ = false;
  };
  Result<std::unique_ptr<Temporary>> begin() const;
  /// Puts the key into the header, flushes, renames, and removes what is above the bound.
  Status commit(Temporary& temporary, const BlobKey& key) const;

  std::optional<std::vector<std::string>> sideNames(const BlobKey& mainKey) const;
  void rememberSideNames(const BlobKey& mainKey, const std::vector<std::string>& names) const;
  /// SHA-256 of the file at `path` as it was when it had this stamp.
  std::optional<std::string> knownDigest(const std::string& path, const std::string& stamp) const;
  void rememberDigest(const std::string& path, const std::string& stamp, const std::string& digest) const;

  uint64_t bytes() const;   ///< of all blobs now

 private:
  BlobCache(std::string folder, uint64_t maxBytes) : folder_(std::move(folder)), maxBytes_(maxBytes) {}
  std::string file(const BlobKey& key, const char* extension) const { return folder_ + "/" + blobKeyHex(key) + extension; }
  void trim(const std::string& keep) const;
  std::string folder_;
  uint64_t maxBytes_;
};

}  // namespace gobo
