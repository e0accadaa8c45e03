// SPDX-License-Identifier: Apache-2.0
#include "server/farm/received_file.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/hash.h"
#include "server/farm/messages.h"

namespace gobo::farm {

struct ReceivedFile::Xxh128 {
  XXH3_state_t state;
  Xxh128() { XXH3_128bits_reset(&state); }
};

ReceivedFile::ReceivedFile(std::string digest, uint64_t bytes) : digest_(std::move(digest)), bytes_(bytes) {
  if (digest_.size() == kXxh128Digits) xxh_ = std::make_unique<Xxh128>();
}

ReceivedFile::~ReceivedFile() = default;

Status ReceivedFile::begin(JobFiles& files, const std::string& path) { return file_.begin(files, path); }

Status ReceivedFile::add(const std::string& data) {
  if (data.size() > bytes_ - received_) return invalidArgument("more than the " + std::to_string(bytes_) + " bytes that were announced", "bytes");
  received_ += data.size();
  if (xxh_) XXH3_128bits_update(&xxh_->state, data.data(), data.size());
  else sha_.add(data.data(), data.size());
  return file_.add(data.data(), data.size());
}

Status ReceivedFile::finish() {
  if (received_ != bytes_) return invalidArgument(std::to_string(received_) + " bytes came, " + std::to_string(bytes_) + " were announced", "bytes");
  std::string has;
  if (xxh_) {
    const XXH128_hash_t h = XXH3_128bits_digest(&xxh_->state);
    has = Hash128{h.low64, h.high64}.hex();
  } else {
    has = sha_.hex();
  }
  if (has != digest_) return invalidArgument("the bytes have digest " + has + ", announced was " + digest_, "digest");
  return file_.commit();
}

}  // namespace gobo::farm
