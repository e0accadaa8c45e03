// SPDX-License-Identifier: Apache-2.0
// The check that keeps NaN and Inf inside the node that made them. One read pass; loops are written to vectorise.
#include <atomic>
#include <cmath>
#include <cstring>

#include "plan/executor.h"

namespace gobo {
inline namespace plan {

namespace {

// NaN and Inf are the values whose exponent bits are all ones; testing bits keeps the loop free of branches.
template <typename Bits, int exponentShift, Bits exponentMask>
bool anyNonFinite(const uint8_t* bytes, size_t count) {
  Bits bad = 0;
  for (size_t i = 0; i < count; ++i) {
    Bits b;
    std::memcpy(&b, bytes + i * sizeof(Bits), sizeof b);
    bad |= Bits(((b >> exponentShift) & exponentMask) == exponentMask);
  }
  return bad != 0;
}

template <typename T>
std::string describeNonFinite(const Plane& p, bool infAllowed) {
  const T* v = reinterpret_cast<const T*>(p.bytes.data());
  for (size_t i = 0; i < p.bytes.size() / sizeof(T); ++i)
    if (std::isnan(v[i]) || (!infAllowed && std::isinf(v[i])) || (infAllowed && std::isinf(v[i]) && v[i] < 0))
      return "plane " + p.name + ", element " + std::to_string(i / p.channels) + ": " + std::to_string(v[i]);
  return {};
}

}  // namespace

Result<std::string> firstNonFinite(const Term& term, const TaskArena& arena, const StopToken& stop) {
  for (const Plane& p : term.planes()) {
    if (p.format != Format::F32 && p.format != Format::F64) continue;
    const size_t size = formatSize(p.format), count = p.bytes.size() / size;
    std::atomic<bool> bad{false};
    const bool complete = arena.parallelFor(
        count, 1 << 18,
        [&](size_t begin, size_t end) {
          const uint8_t* at = p.bytes.data() + begin * size;
          const bool found =
              p.format == Format::F32 ? anyNonFinite<uint32_t, 23, 0xffu>(at, end - begin) : anyNonFinite<uint64_t, 52, 0x7ffull>(at, end - begin);
          if (found) bad.store(true, std::memory_order_relaxed);
        },
        stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    if (!bad) continue;
    const bool infAllowed = p.name == "depth";
    const std::string text = p.format == Format::F32 ? describeNonFinite<float>(p, infAllowed) : describeNonFinite<double>(p, infAllowed);
    if (!text.empty()) return text;
  }
  return std::string();
}

}  // namespace plan
}  // namespace gobo
