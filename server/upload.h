// SPDX-License-Identifier: Apache-2.0
// UploadFile: a scene that arrives in pieces, kept in a fresh folder of mode 0700 under the tmp folder (server/scratch.h); the folder goes
// away with the object, whatever happened. The name is made here, never by the client. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/status.h"
#include "gobo/v1/service.pb.h"
#include "server/encode.h"
#include "server/scratch.h"

namespace gobo {
inline namespace server {

class UploadFile {
 public:
  UploadFile() = default;
  ~UploadFile();
  UploadFile(const UploadFile&) = delete;
  UploadFile& operator=(const UploadFile&) = delete;

  /// Checks the first message: extension (.glb, .gltf), total_bytes in 1..maxBytes, sha256 empty or 64 hex digits.
  /// Errors: InvalidArgument naming the field, ResourceExhausted when it is too large, Internal when the disk refuses.
  Status begin(const std::string& tmpFolder, const v1::UploadSceneRequest& first, uint64_t maxBytes, const char* limitKey = "limits.upload_bytes");
  /// Errors: InvalidArgument when more arrives than announced, ResourceExhausted when the disk is full.
  Status add(const std::string& data);
  /// Errors: InvalidArgument when bytes are missing or the digest differs.
  Status finish();
  const std::string& path() const { return path_; }
  const std::string& digest() const { return digest_; }

 private:
  std::unique_ptr<ScratchFolder> folder_;
  std::string path_, expected_, digest_;
  uint64_t total_ = 0, received_ = 0;
  int fd_ = -1;
  Sha256 sha_;
};

// What names of ScratchFolders begin with.
inline constexpr char kUploadFolder[] = "gobo-upload-";  ///< uploads, and files that were put where there is no folder for them (server/file_store.h)
inline constexpr char kWorkerFolder[] = "gobo-worker-";  ///< of a worker (server/farm/farm_worker.h)

/// Removes what killed daemons of the same user left under the tmp folder: such folders whose maker is gone, and those of earlier versions (gobo-upload-PID-*,
/// gobo-worker-PID-*) where nobody has that number. Errors are logged.
void removeStaleUploads(const std::string& tmpFolder);

}  // namespace server
}  // namespace gobo
