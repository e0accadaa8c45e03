// SPDX-License-Identifier: Apache-2.0
// FileStore: files that clients put (gobo.v1.Blobs), by their SHA-256. Each owner has a folder of his own: what another one has put is not there for him,
// whatever digests he knows, so no answer tells who has what.
//   FOLDER/lock                         flock: one daemon
//   FOLDER/OWNER/SHA256                 a whole file; OWNER: 32 hex digits of the SHA-256 of his name
//   FOLDER/OWNER/SHA256.BYTES.part      what has arrived of one of so many bytes
//   FOLDER/trees/KEY/NAME...            whole files by the names that a scene's files call each other (hard links), while one is loaded
// A whole file is made as a part, checked, fdatasync, rename, fsync of the folder. After a restart it is checked again when it is first used; one that is
// damaged is removed, and its owner puts it again. Bounded in bytes, of which one owner may have half: the files used least recently of the owner that has most
// go first, never one that is held or being written. Thread-safe.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "base/descriptor.h"
#include "base/status.h"
#include "base/stop.h"
#include "server/encode.h"
#include "server/scratch.h"

namespace gobo {
inline namespace server {

struct FileStoreOptions {
  std::string folder;              ///< made if it is not there; empty: a fresh one under tmpFolder with the first file, which goes with the store
  std::string tmpFolder = "/tmp";  ///< only where `folder` is empty
  uint64_t bytes = 8ull << 30;     ///< of all files, parts by their size
  double partSeconds = 86400;      ///< a part that nobody has added to for so long goes
};

/// Ok for 64 hex digits, of any case; `field` places the error.
Status checkSha256(const std::string& text, const std::string& field);
/// Names by which the files of one scene call each other, as a tree of files: relative, normal ("a/b.bin", no "./"), at most 16 steps, none the folder of
/// another; digests; `source` is one of them and a .gltf or .glb. Errors: InvalidArgument at open.files or open.source.
Status checkFileNames(const std::map<std::string, std::string>& files, const std::string& source);

class FileStore;

/// Files of one owner by name, to be read by whoever takes a path. They stay while it lives.
class FileTree {
 public:
  ~FileTree();
  FileTree(const FileTree&) = delete;
  FileTree& operator=(const FileTree&) = delete;
  const std::string& folder() const { return folder_; }
  const std::string& key() const { return key_; }  ///< 64 hex digits: of owner, names and digests
  std::string path(const std::string& name) const { return folder_ + "/" + name; }

 private:
  friend class FileStore;
  FileTree() = default;
  std::shared_ptr<FileStore> store_;
  std::string folder_, key_;
  uint64_t turn_ = 0;
  std::vector<std::shared_ptr<const void>> holds_;
};

/// One file on its way in. One thread. What has arrived stays when it goes away unfinished.
class FilePut {
 public:
  ~FilePut();
  FilePut(const FilePut&) = delete;
  FilePut& operator=(const FilePut&) = delete;
  bool there() const { return part_.empty(); }  ///< the whole file was there before: what is added is dropped
  uint64_t received() const { return received_; }
  /// Errors: InvalidArgument beyond the announced bytes, ResourceExhausted when the disk is full: what had arrived before stays.
  Status add(const std::string& data);
  /// Errors: InvalidArgument when bytes are missing (they stay) or the digest differs (all of them go); ResourceExhausted, Internal: the disk.
  Status finish();

 private:
  friend class FileStore;
  FilePut() = default;
  std::shared_ptr<FileStore> store_;
  std::string owner_, digest_, part_;
  uint64_t bytes_ = 0, received_ = 0, dropped_ = 0;
  bool resumed_ = false, finished_ = false, damaged_ = false;
  gobo::Descriptor fd_;
  Sha256 sha_;
};

class FileStore : public std::enable_shared_from_this<FileStore> {
 public:
  /// Errors: FailedPrecondition when the folder is not this user's own (base/own_folder.h); Unavailable when another daemon has it; what making it says.
  static Result<std::shared_ptr<FileStore>> open(const FileStoreOptions& options);

  /// Bytes that are there of the owner's file of so many bytes: all of them, or where a put may go on. A file of another size is none.
  uint64_t received(const std::string& owner, const std::string& sha256, uint64_t bytes);
  /// Room is made for the whole file. Errors: InvalidArgument (digest; bytes 0, or another size than that file has; offset beyond what is there);
  /// Aborted while another call puts the same file; ResourceExhausted that names blobs.bytes, or without a descriptor; Cancelled; what the disk says. What
  /// has arrived of the file stays.
  Result<std::unique_ptr<FilePut>> begin(const std::string& owner, const std::string& sha256, uint64_t bytes, uint64_t offset, const StopToken& stop = {});
  /// Ok if files of this owner's (digest -> bytes), there or not, can be there together: beside what he has in use or on its way, within most(), and beside
  /// what everybody has so, within limit(). Those of a set that does not fit would push each other out, for ever. Errors: ResourceExhausted that names
  /// blobs.bytes.
  Status fitTogether(const std::string& owner, const std::map<std::string, uint64_t>& files) const;
  /// Files by name, checked. Errors: NotFound with field and digest of each that is not there (of 20, and how many there are), InvalidArgument, Cancelled,
  /// ResourceExhausted (disk full; no descriptor to check one by: it stays), what the disk says.
  Result<std::shared_ptr<const FileTree>> tree(const std::string& owner, const std::map<std::string, std::string>& files, const std::string& field,
                                               const StopToken& stop = {});
  /// The same for one environment map; `path` is its file, with the extension of what it holds. Errors: also InvalidArgument for what is no .hdr or .exr.
  Result<std::shared_ptr<const FileTree>> environment(const std::string& owner, const std::string& sha256, const std::string& field, std::string& path,
                                                      const StopToken& stop = {});

  uint64_t limit() const { return options_.bytes; }
  uint64_t most() const { return options_.bytes / 2; }  ///< of one owner
  struct Stats {
    uint64_t bytes = 0, files = 0, parts = 0, evicted = 0, damaged = 0;
  };
  Stats stats() const;
  const std::string& folder() const { return options_.folder; }
  /// Parts that nobody has added to for options.partSeconds.
  void sweep();

 private:
  friend class FilePut;
  friend class FileTree;
  struct Entry {
    uint64_t bytes = 0;     // of the whole file
    uint64_t received = 0;  // == bytes: whole
    int64_t used = 0;       // ns of the system's clock
    uint32_t holds = 0;
    bool whole = false, checked = false, writing = false;
    uint64_t charge() const;
  };
  using Key = std::pair<std::string, std::string>;  // owner's folder, digest
  class Hold;

  explicit FileStore(FileStoreOptions options) : options_(std::move(options)) {}
  Status ensureFolder();
  void scan();
  std::string pathOf(const Key& key, const Entry& entry) const;
  Result<std::shared_ptr<const void>> hold(const Key& key, const std::string& field, const StopToken& stop);
  // Under mutex_.
  /// For the file of `key`, which is not counted itself and will be charged `more`; null: until all is within the bound.
  Status makeRoom(const Key* key, uint64_t more);
  void drop(std::map<Key, Entry>::iterator at);
  void sweepParts();

  FileStoreOptions options_;
  bool private_ = false;
  std::unique_ptr<ScratchFolder> scratch_;  // the folder of a private one
  gobo::Descriptor lock_;
  mutable std::mutex mutex_;
  std::map<Key, Entry> entries_;
  uint64_t evicted_ = 0, damaged_ = 0;
  int64_t swept_ = 0;
  std::mutex treesMutex_;
  struct Tree {
    std::weak_ptr<const FileTree> tree;
    uint64_t turn = 0;
  };
  std::map<std::string, Tree> trees_;
  uint64_t turns_ = 0;
};

}  // namespace server
}  // namespace gobo
