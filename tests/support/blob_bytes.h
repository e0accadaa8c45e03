// SPDX-License-Identifier: Apache-2.0
// Blobs in memory for tests: aligned as a mapping is, and with their digests made right again after damage.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "base/hash.h"
#include "scene/blob.h"

namespace gobo {

struct BlobBytes {
  std::vector<uint8_t> bytes;
  /// A copy at a multiple of 64 bytes, and a view of it.
  std::pair<std::shared_ptr<const void>, std::span<const uint8_t>> aligned() const {
    const size_t n = (bytes.size() + 127) / 64 * 64;
    std::shared_ptr<void> p(std::aligned_alloc(64, n), std::free);
    if (!bytes.empty()) std::memcpy(p.get(), bytes.data(), bytes.size());
    return {p, {static_cast<const uint8_t*>(p.get()), bytes.size()}};
  }
  template <typename T>
  T at(size_t i) const {
    T v;
    std::memcpy(&v, bytes.data() + i, sizeof v);
    return v;
  }
  /// docs/scene_blob.md: records at 144, their length at 80, arrays at what is at 88; digests: of the records at 96, of the arrays' slices at
  /// 112, of the header at 128.
  void mend() {
    if (bytes.size() < kBlobHeaderBytes) return;
    const uint64_t records = at<uint64_t>(80);
    if (records <= bytes.size() - kBlobHeaderBytes) {
      const Hash128 r = hashBytes(bytes.data() + kBlobHeaderBytes, size_t(records));
      std::memcpy(bytes.data() + 96, &r, 16);
    }
    if (const uint64_t from = at<uint64_t>(88); from <= bytes.size()) {
      std::vector<Hash128> slices;
      for (size_t i = size_t(from); i < bytes.size(); i += size_t(4) << 20)
        slices.push_back(hashBytes(bytes.data() + i, std::min(size_t(4) << 20, bytes.size() - i)));
      const Hash128 a = hashBytes(slices.data(), slices.size() * sizeof(Hash128));
      std::memcpy(bytes.data() + 112, &a, 16);
    }
    const Hash128 h = hashBytes(bytes.data(), 128);
    std::memcpy(bytes.data() + 128, &h, 16);
  }
  Result<ScenePtr> scene(BlobTrust trust) const {
    auto [owner, view] = aligned();
    return readSceneBlob(owner, view, trust);
  }
};

template <typename T>
BlobBytes blobOf(const T& item) {
  BlobBytes b;
  const Status s = writeBlob(item, [&](const void* p, size_t n) {
    const auto* c = static_cast<const uint8_t*>(p);
    b.bytes.insert(b.bytes.end(), c, c + n);
    return Status();
  });
  if (!s.ok()) b.bytes.clear();
  return b;
}

}  // namespace gobo
