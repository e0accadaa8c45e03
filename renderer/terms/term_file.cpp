// SPDX-License-Identifier: Apache-2.0
#include "terms/term_file.h"

#include <algorithm>
#include <cstring>

#include "base/check.h"

namespace gobo {
inline namespace terms {

namespace {

constexpr char kMagic[8] = {'G', 'O', 'B', 'O', 'T', 'R', 'M', '2'};
constexpr size_t kHead = sizeof kMagic + 16;  // magic and key
constexpr uint32_t kMaxText = 4096;
constexpr uint32_t kMaxPlanes = 1024;
constexpr int kMaxChannels = 1 << 16;
constexpr uint64_t kMaxElements = 1ull << 40;  // times channels and scalar size: still below 2^60

constexpr size_t kPiece = size_t(4) << 20;  // bytes between two looks at a stop token

struct Writer {
  std::vector<uint8_t>& out;
  StopToken stop;
  void bytes(const void* from, size_t n) {
    const auto* p = static_cast<const uint8_t*>(from);
    for (size_t at = 0; at < n && !(n > kPiece && stop.stopRequested()); at += kPiece) out.insert(out.end(), p + at, p + std::min(n, at + kPiece));
  }
  template <typename T>
  void put(T v) {
    bytes(&v, sizeof v);
  }
  void text(const std::string& s) {
    put(uint32_t(s.size()));
    bytes(s.data(), s.size());
  }
};

struct Reader {
  const uint8_t* p;
  size_t left;
  bool good = true;
  template <typename T>
  T take() {
    T v{};
    if (left < sizeof v) {
      good = false;
      return v;
    }
    std::memcpy(&v, p, sizeof v);
    p += sizeof v;
    left -= sizeof v;
    return v;
  }
  std::string text() {
    const uint32_t n = take<uint32_t>();
    if (!good || n > kMaxText || n > left) {
      good = false;
      return {};
    }
    std::string s(reinterpret_cast<const char*>(p), n);
    p += n;
    left -= n;
    return s;
  }
};

/// The one at the end of the file.
Hash128 digestOf(const uint8_t* bytes, size_t size) {
  Hash128 digest;
  std::memcpy(&digest.lo, bytes + size - 16, 8);
  std::memcpy(&digest.hi, bytes + size - 8, 8);
  return digest;
}

}  // namespace

std::vector<uint8_t> serializeTerm(const Term& term, const Hash128& key, const StopToken& stop) {
  size_t size = kHead + 4 + term.type().size() + 20 + 16;
  for (const Plane& p : term.planes()) size += 4 + p.name.size() + 16 + p.bytes.size();
  std::vector<uint8_t> out;
  out.reserve(size);  // not cleared: its pages come one by one, between polls
  Writer w{out, stop};
  w.bytes(kMagic, sizeof kMagic);
  w.put(key.lo);
  w.put(key.hi);
  w.text(term.type());
  w.put(uint32_t(term.domain()));
  w.put(int32_t(term.extent().width));
  w.put(int32_t(term.extent().height));
  w.put(int32_t(term.extent().layers));
  w.put(uint32_t(term.planes().size()));
  for (const Plane& p : term.planes()) {
    w.text(p.name);
    w.put(uint32_t(p.format));
    w.put(int32_t(p.channels));
    w.put(uint64_t(p.bytes.size()));
    w.bytes(p.bytes.data(), p.bytes.size());
  }
  if (stop.stopRequested()) return {};
  GOBO_CHECK_EQ(out.size(), size - 16);
  const Hash128 digest = hashBytes(out.data(), size - 16);
  w.put(digest.lo);
  w.put(digest.hi);
  return out;
}

std::shared_ptr<Term> parseTerm(const uint8_t* bytes, size_t size, const Hash128& key, const StopToken& stop) {
  if (size < kHead + 16 || std::memcmp(bytes, kMagic, sizeof kMagic) != 0) return nullptr;
  Hash128 named;
  std::memcpy(&named.lo, bytes + sizeof kMagic, 8);
  std::memcpy(&named.hi, bytes + sizeof kMagic + 8, 8);
  if (named != key) return nullptr;
  if (stop.stopRequested() || hashBytes(bytes, size - 16) != digestOf(bytes, size)) return nullptr;
  Reader r{bytes + kHead, size - kHead - 16};
  const std::string type = r.text();
  const uint32_t domainNumber = r.take<uint32_t>();
  const auto domain = Domain(domainNumber);
  Extent extent;
  extent.width = r.take<int32_t>();
  extent.height = r.take<int32_t>();
  extent.layers = r.take<int32_t>();
  const uint32_t planes = r.take<uint32_t>();
  // The digest guards against accidents only (anyone can compute it), so nothing below trusts a length: sizes are checked
  // where they cannot overflow, and whatever addRaw() would CHECK is refused first.
  if (!r.good || domainNumber > uint32_t(Domain::Table) || planes > kMaxPlanes) return nullptr;
  if (extent.width < 0 || extent.height < 0 || extent.layers < 0) return nullptr;
  const uint64_t area = uint64_t(extent.width) * uint64_t(extent.height);  // at most 2^62
  if (area > kMaxElements || (extent.layers > 0 && area > kMaxElements / uint64_t(extent.layers))) return nullptr;
  auto term = std::make_shared<Term>(type, domain, extent);
  for (uint32_t i = 0; i < planes; ++i) {
    const std::string name = r.text();
    const uint32_t formatNumber = r.take<uint32_t>();
    const auto format = Format(formatNumber);
    const int channels = r.take<int32_t>();
    const uint64_t length = r.take<uint64_t>();
    if (!r.good || formatNumber > uint32_t(Format::U8) || channels < 1 || channels > kMaxChannels) return nullptr;
    if (length > r.left || term->hasPlane(name)) return nullptr;
    if (length != extent.elements() * size_t(channels) * formatSize(format)) return nullptr;
    Plane& p = term->addRaw(name, format, channels);
    for (uint64_t at = 0; at < length; at += kPiece) {
      if (stop.stopRequested()) return nullptr;
      std::memcpy(p.bytes.data() + at, r.p + at, std::min<uint64_t>(kPiece, length - at));
    }
    r.p += length;
    r.left -= length;
  }
  return r.left == 0 ? term : nullptr;
}

bool isOtherTermVersion(const uint8_t* bytes, size_t size) {
  if (size < sizeof kMagic + 16 || std::memcmp(bytes, kMagic, sizeof kMagic - 1) != 0 || bytes[7] == uint8_t(kMagic[7])) return false;
  return digestOf(bytes, size) == hashBytes(bytes, size - 16);
}

std::string otherTermVersion(const uint8_t* bytes) {
  const auto digit = [](uint8_t c) { return c >= '0' && c <= '9' ? std::string(1, char(c)) : "byte " + std::to_string(c); };
  return "term file version " + digit(bytes[7]) + ", this build reads version " + digit(uint8_t(kMagic[7]));
}

}  // namespace terms
}  // namespace gobo
