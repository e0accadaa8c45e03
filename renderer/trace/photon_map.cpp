// SPDX-License-Identifier: Apache-2.0
#include "trace/photon_map.h"

#include <algorithm>
#include <bit>
#include <numeric>

#include "base/check.h"
#include "base/sobol.h"

namespace gobo {
inline namespace trace {

namespace {
uint64_t pack(const int64_t at[3]) { return uint64_t(at[0]) | uint64_t(at[1]) << 21 | uint64_t(at[2]) << 42; }
}  // namespace

PhotonMap::PhotonMap(std::vector<Photon> photons, float radius) : radius_(radius) {
  GOBO_CHECK(radius > 0.0f);
  std::erase_if(photons, [](const Photon& p) { return !isFinite(p.p) || !isFinite(p.flux) || !isFinite(p.toLight); });
  GOBO_CHECK_LT(photons.size(), size_t(~0u));
  if (photons.empty()) return;
  Vec3 lo(photons[0].p);
  for (const Photon& p : photons) lo = glm::min(lo, p.p);
  origin_ = DVec3(lo);
  perCell_ = 0.5 / double(radius);

  std::vector<uint64_t> keys(photons.size());
  for (size_t i = 0; i < photons.size(); ++i) {
    const int64_t at[3] = {cell(photons[i].p.x, 0), cell(photons[i].p.y, 1), cell(photons[i].p.z, 2)};
    keys[i] = pack(at);
  }
  std::vector<uint32_t> order(photons.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return keys[a] != keys[b] ? keys[a] < keys[b] : a < b; });
  photons_.reserve(photons.size());
  size_t cells = 0;
  for (size_t i = 0; i < order.size(); ++i) {
    photons_.push_back(photons[order[i]]);
    cells += i == 0 || keys[order[i]] != keys[order[i - 1]];
  }
  table_.resize(std::bit_ceil(2 * cells));
  for (size_t i = 0; i < order.size();) {
    const uint64_t key = keys[order[i]];
    size_t end = i + 1;
    while (end < order.size() && keys[order[end]] == key) ++end;
    size_t at = mix64(key) & (table_.size() - 1);
    while (table_[at].key != ~0ull) at = (at + 1) & (table_.size() - 1);
    table_[at] = {key, uint32_t(i), uint32_t(end)};
    i = end;
  }
}

const PhotonMap::Cell* PhotonMap::find(const int64_t at[3]) const {
  for (int c = 0; c < 3; ++c)
    if (at[c] < 0 || at[c] > kMost) return nullptr;
  const uint64_t key = pack(at);
  for (size_t i = mix64(key) & (table_.size() - 1); table_[i].key != ~0ull; i = (i + 1) & (table_.size() - 1))
    if (table_[i].key == key) return &table_[i];
  return nullptr;
}

}  // namespace trace
}  // namespace gobo
