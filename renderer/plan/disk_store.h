// SPDX-License-Identifier: Apache-2.0
// DiskStore: content of the RAM tier that was dear to compute, as files FOLDER/ab/abcdef....term (docs/term_file.md) with an
// index in FOLDER/index.sqlite (key, bytes, last use) for least-recently-used eviction. Two daemons may share a folder;
// kill -9 at any moment leaves no wrong term: files appear by rename after fdatasync, reads check the digest, damaged or
// orphaned files are dropped. The files are the truth, the index is rebuilt when missing. Thread-safe.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/status.h"
#include "terms/term.h"

namespace gobo {

class DiskStore {
 public:
  /// Errors: folder cannot be made or written; the message names it.
  static Result<std::unique_ptr<DiskStore>> open(const std::string& folder, uint64_t maxBytes);
  ~DiskStore();
  TermPtr get(const Hash128& key);                 ///< null if absent or damaged (then removed)
  Status put(const Hash128& key, const Term& term); ///< evicts beyond maxBytes
  void clear();
  uint64_t bytes() const;

 private:
  DiskStore();
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gobo
