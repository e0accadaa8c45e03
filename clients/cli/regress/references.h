// SPDX-License-Identifier: Apache-2.0
// Accepted pictures: files named by the SHA-256 of their bytes, and a log of who accepted which for what case, when and why. The last line of a case is what
// holds. Nothing is ever overwritten: objects are what their names say, the log only grows. Folder:
//   objects/3f/3fa9...exr    the parts of one render, layers part0, part1, ...: 32-bit floats, no loss
//   accepted.jsonl           a line an acceptance
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo::cli {

/// What a render was and what it took, beside its pixels.
struct RenderFacts {
  std::string output;
  int width = 0, height = 0;
  uint32_t spp = 0, parts = 0;
  uint64_t seed = 0;
  std::string request, sceneHash, build;  ///< request: JSON
  std::vector<std::string> nodes;         ///< of the plan that ran or were reused, in its order
  uint64_t rays = 0;                      ///< of all parts
  double ms = 0;
};

struct Accepted {
  std::string name, digest, by, why, when;  ///< of the case; when: UTC, ISO 8601
  RenderFacts facts;
};

class References {
 public:
  explicit References(std::string folder) : folder_(std::move(folder)) {}
  /// The last acceptance of every case. An absent log is an empty one. Errors: InvalidArgument "FILE:LINE: ...".
  Result<std::map<std::string, Accepted>> accepted() const;
  /// Every acceptance, oldest first.
  Result<std::vector<Accepted>> log() const;
  /// Keeps the bytes and appends the entry, whose digest it fills in; the log is replaced as a whole (temporary file, rename) under a lock.
  Status accept(Accepted entry, const std::vector<uint8_t>& bytes);
  /// The parts of an acceptance. Errors: NotFound, DataLoss where the bytes are not what the name says.
  Result<std::vector<Image>> parts(const Accepted& entry) const;
  std::string objectPath(const std::string& digest) const;
  std::string logPath() const;

 private:
  std::string folder_;
};

/// Parts as one EXR, and back. Errors name the file.
Result<std::vector<uint8_t>> encodeParts(const std::vector<Image>& parts);
Result<std::vector<Image>> decodeParts(const std::vector<uint8_t>& bytes, const std::string& name, uint32_t count);
/// Nodes of one plan that the other has not, as "+ node" and "- node".
std::vector<std::string> planDifference(const std::vector<std::string>& before, const std::vector<std::string>& now);
/// Now, UTC, ISO 8601 with seconds.
std::string timeNow();

}  // namespace gobo::cli
