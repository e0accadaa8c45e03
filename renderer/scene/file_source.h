// SPDX-License-Identifier: Apache-2.0
// Where a loader's bytes come from: the disk, or (in the sandboxed child) the parent process. And the one rule which names a
// scene file may use for the files beside it. Sources are used by one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace scene {

class FileSource {
 public:
  virtual ~FileSource() = default;
  /// The scene file itself. Errors: what reading gives; ResourceExhausted above maxBytes.
  virtual Result<std::vector<uint8_t>> main(uint64_t maxBytes) = 0;
  /// A file beside it, or below its folder. NotFound when it does not exist; InvalidArgument when the name is refused.
  virtual Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t maxBytes) = 0;
  /// The loader is about to parse the file ("") or the part of it at a JSON pointer ("/images/3"): who watches the loader knows
  /// what to blame if it does not come back.
  virtual void parsing(const std::string& /*place*/) {}
};

/// Refuses names that are empty, absolute, have a scheme or a "..", hold a zero byte, or are longer than 1024 bytes.
/// `shown` is what the error quotes (the URI before decoding).
Status checkSideName(const std::string& name, const std::string& shown);

/// Opens `name` below the folder of `mainPath`. The kernel keeps every step below that folder, symbolic links included
/// (openat2, RESOLVE_BENEATH); without openat2 real paths are compared. Errors as FileSource::beside.
Result<int> openBeside(const std::string& mainPath, const std::string& name);

class DiskFiles final : public FileSource {
 public:
  explicit DiskFiles(std::string path) : path_(std::move(path)) {}
  Result<std::vector<uint8_t>> main(uint64_t maxBytes) override;
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t maxBytes) override;

 private:
  std::string path_;
};

}  // namespace scene
}  // namespace gobo
