// SPDX-License-Identifier: Apache-2.0
// The daemon's SceneLoader: files are parsed by gobo-ingest children, and their blobs are kept in a content-addressed cache.
// Key of a blob = SHA-256 over (task, format of the fields, options, file name, SHA-256 of the file, and for each file that it
// names, in order, name and SHA-256 or "absent"). A file whose stat (device, inode, size, mtime, ctime) is that of an earlier
// load, and was at least two seconds old then, is not read again unless `verify` is always (base/file_stamp.h).
// docs/ingest.md tells the whole way of a file. Thread-safe.
#pragma once

#include <memory>
#include <string>

#include "scene/loader.h"

namespace gobo {
inline namespace server {

struct IngestOptions {
  std::string program;      ///< gobo-ingest; empty: found beside the running program
  std::string cacheFolder;  ///< blobs; empty: none are kept
  uint64_t cacheBytes = 8ull << 30;
  bool verifyAlways = false;           ///< hash files at every load
  uint64_t memoryBytes = 4ull << 30;   ///< address space of a child beyond its program
  uint64_t blobBytes = 2ull << 30;     ///< of one scene; of an environment map at most what its file can decode to
  uint64_t textureBytes = 1ull << 30;  ///< of one scene, mip levels included
  uint64_t inputBytes = 4ull << 30;    ///< of one scene's files together
  uint64_t triangles = 64ull << 20;
  uint32_t cpuSeconds = 300;
  double wallSeconds = 600;
  uint32_t atOnce = 2;  ///< children; more wait
};

/// Errors: FailedPrecondition when there is no gobo-ingest or the cache folder cannot be trusted (base/own_folder.h).
/// A cache folder that cannot be made or written to is a warning: the loader goes without.
Result<std::shared_ptr<SceneLoader>> childLoader(const IngestOptions& options);

}  // namespace server
}  // namespace gobo
