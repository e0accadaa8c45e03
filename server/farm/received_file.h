// SPDX-License-Identifier: Apache-2.0
// ReceivedFile: a result or a checkpoint that comes in pieces and is there only if it has the size and the digest that were announced.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "server/encode.h"
#include "server/jobs/job_files.h"

namespace gobo::farm {

class ReceivedFile {
 public:
  /// `digest`: sha256 (64 digits) or xxh3-128 (32), in hex.
  ReceivedFile(std::string digest, uint64_t bytes);
  ~ReceivedFile();
  Status begin(JobFiles& files, const std::string& path);
  /// Errors: InvalidArgument when more comes than was announced; the disk's.
  Status add(const std::string& data);
  /// Durable on return. Errors: InvalidArgument naming what differs; the disk's. Nothing stays then.
  Status finish();

 private:
  const std::string digest_;
  const uint64_t bytes_;
  uint64_t received_ = 0;
  JobFiles::Incoming file_;
  Sha256 sha_;
  struct Xxh128;
  std::unique_ptr<Xxh128> xxh_;  // null: sha_ counts
};

}  // namespace gobo::farm
