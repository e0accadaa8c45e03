// SPDX-License-Identifier: Apache-2.0
#include "terms/term.h"

#include <sys/mman.h>

#include <cstdlib>
#include <cstring>
#include <deque>
#include <mutex>
#include <new>

namespace gobo {

namespace {

constexpr size_t kHugePage = size_t(2) << 20;
constexpr size_t kPoolBytes = size_t(512) << 20;

/// Mapped blocks that were given back, by length; the oldest go to the system once they are more than kPoolBytes. Thread-safe.
class BlockPool {
 public:
  /// A block of `length` (whole huge pages), null when there is none; what it holds is not cleared.
  uint8_t* take(size_t length) {
    std::lock_guard lock(mutex_);
    for (auto block = blocks_.rbegin(); block != blocks_.rend(); ++block)
      if (block->length == length) {
        uint8_t* p = block->p;
        bytes_ -= length;
        blocks_.erase(std::next(block).base());
        return p;
      }
    return nullptr;
  }
  void give(uint8_t* p, size_t length) {
    std::vector<Block> out;
    {
      std::lock_guard lock(mutex_);
      blocks_.push_back({p, length});
      bytes_ += length;
      while (bytes_ > kPoolBytes) {
        out.push_back(blocks_.front());
        bytes_ -= blocks_.front().length;
        blocks_.pop_front();
      }
    }
    for (const Block& b : out) munmap(b.p, b.length);
  }

 private:
  struct Block { uint8_t* p; size_t length; };
  std::mutex mutex_;
  std::deque<Block> blocks_;
  size_t bytes_ = 0;
};

BlockPool& pool() {
  static BlockPool* const instance = new BlockPool;   // never destroyed: terms may outlive main
  return *instance;
}

uint8_t* mapBlock(size_t length) {
  // Mapped with room to begin at a huge page; what sticks out on both sides goes back.
  void* raw = mmap(nullptr, length + kHugePage, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (raw == MAP_FAILED) throw std::bad_alloc();
  uint8_t* base = static_cast<uint8_t*>(raw);
  const size_t before = (kHugePage - reinterpret_cast<uintptr_t>(base) % kHugePage) % kHugePage, after = kHugePage - before;
  if (before) munmap(base, before);
  if (after) munmap(base + before + length, after);
  madvise(base + before, length, MADV_HUGEPAGE);
  return base + before;
}

}  // namespace

ZeroedBytes::ZeroedBytes(size_t size, bool zeroed) : size_(size) {
  if (size >= 2 * kHugePage) {
    const size_t length = (size + kHugePage - 1) / kHugePage * kHugePage;
    uint8_t* p = pool().take(length);
    if (!p) p = mapBlock(length);
    else if (zeroed) std::memset(p, 0, size);
    data_ = std::unique_ptr<uint8_t, Free>(p, Free(length));
    return;
  }
  data_.reset(static_cast<uint8_t*>(std::calloc(std::max<size_t>(size, 1), 1)));
  if (!data_) throw std::bad_alloc();
}
ZeroedBytes::ZeroedBytes(const ZeroedBytes& other) : ZeroedBytes(other.size(), false) { std::copy(other.begin(), other.end(), data_.get()); }
void ZeroedBytes::Free::operator()(uint8_t* p) const {
  if (mapped) pool().give(p, mapped);
  else std::free(p);
}

size_t formatSize(Format format) {
  switch (format) {
    case Format::F32: return 4;
    case Format::F64: return 8;
    case Format::U32: return 4;
    case Format::U8: return 1;
  }
  return 0;
}

size_t Term::bytes() const {
  size_t total = 256;
  for (const Plane& p : planes_) total += p.bytes.size() + 64;
  return total;
}

const Plane* Term::find(std::string_view name) const {
  for (const Plane& p : planes_)
    if (p.name == name) return &p;
  return nullptr;
}

const Plane& Term::need(std::string_view name) const {
  const Plane* p = find(name);
  if (!p) {
    std::cerr << "term '" << type_ << "' has no plane '" << name << "'" << std::endl;
    std::abort();
  }
  return *p;
}

Plane& Term::addRaw(std::string name, Format format, int channels, bool zeroed) {
  GOBO_CHECK(find(name) == nullptr);
  Plane p{std::move(name), format, channels, {}};
  p.bytes = ZeroedBytes(extent_.elements() * channels * formatSize(format), zeroed);
  planes_.reserve(16);   // spans handed out earlier stay valid: planes move, their storage does not
  planes_.push_back(std::move(p));
  return planes_.back();
}

Hash128 Term::content() const {
  std::call_once(once_, [this] {
    Hasher h("term");
    h.add(type_).add(domain_).add(extent_.width).add(extent_.height).add(extent_.layers);
    for (const Plane& p : planes_) h.add(p.name).add(p.format).add(p.channels).addArray(std::span<const uint8_t>(p.bytes.data(), p.bytes.size()));
    content_ = h.digest();
  });
  return content_;
}

// File form: docs/term_file.md. Little endian; strings and planes are length-prefixed; the last 16 bytes are the digest
// of everything before them.
namespace {

constexpr char kMagic[8] = {'G', 'O', 'B', 'O', 'T', 'R', 'M', '1'};
constexpr uint32_t kMaxText = 4096;
constexpr uint32_t kMaxPlanes = 1024;
constexpr int kMaxChannels = 1 << 16;
constexpr uint64_t kMaxElements = 1ull << 40;   // times channels and scalar size: still below 2^60

constexpr size_t kPiece = size_t(4) << 20;   // bytes between two looks at a stop token

struct Writer {
  std::vector<uint8_t>& out;
  StopToken stop;
  void bytes(const void* from, size_t n) {
    const auto* p = static_cast<const uint8_t*>(from);
    for (size_t at = 0; at < n && !(n > kPiece && stop.stopRequested()); at += kPiece) out.insert(out.end(), p + at, p + std::min(n, at + kPiece));
  }
  template <typename T> void put(T v) { bytes(&v, sizeof v); }
  void text(const std::string& s) {
    put(uint32_t(s.size()));
    bytes(s.data(), s.size());
  }
};

struct Reader {
  const uint8_t* p;
  size_t left;
  bool good = true;
  template <typename T> T take() {
    T v{};
    if (left < sizeof v) { good = false; return v; }
    std::memcpy(&v, p, sizeof v);
    p += sizeof v; left -= sizeof v;
    return v;
  }
  std::string text() {
    const uint32_t n = take<uint32_t>();
    if (!good || n > kMaxText || n > left) { good = false; return {}; }
    std::string s(reinterpret_cast<const char*>(p), n);
    p += n; left -= n;
    return s;
  }
};

}  // namespace

std::vector<uint8_t> serializeTerm(const Term& term, const StopToken& stop) {
  size_t size = 8 + 4 + term.type().size() + 20 + 16;
  for (const Plane& p : term.planes()) size += 4 + p.name.size() + 16 + p.bytes.size();
  std::vector<uint8_t> out;
  out.reserve(size);   // not cleared: its pages come one by one, between polls
  Writer w{out, stop};
  w.bytes(kMagic, sizeof kMagic);
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

std::shared_ptr<Term> parseTerm(const uint8_t* bytes, size_t size, const StopToken& stop) {
  if (size < 24 || std::memcmp(bytes, kMagic, 8) != 0) return nullptr;
  Hash128 stored;
  std::memcpy(&stored.lo, bytes + size - 16, 8);
  std::memcpy(&stored.hi, bytes + size - 8, 8);
  if (stop.stopRequested() || hashBytes(bytes, size - 16) != stored) return nullptr;
  Reader r{bytes + 8, size - 24};
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
  const uint64_t area = uint64_t(extent.width) * uint64_t(extent.height);   // at most 2^62
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
    r.p += length; r.left -= length;
  }
  return r.left == 0 ? term : nullptr;
}

}  // namespace gobo
