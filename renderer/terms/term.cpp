// SPDX-License-Identifier: Apache-2.0
#include "terms/term.h"

#include <sys/mman.h>

#include <cstdlib>
#include <cstring>
#include <deque>
#include <mutex>
#include <new>

namespace gobo {
inline namespace terms {

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
  struct Block {
    uint8_t* p;
    size_t length;
  };
  std::mutex mutex_;
  std::deque<Block> blocks_;
  size_t bytes_ = 0;
};

BlockPool& pool() {
  static BlockPool* const instance = new BlockPool;  // never destroyed: terms may outlive main
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
    fresh_ = p == nullptr;
    if (fresh_) p = mapBlock(length);
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
  size_t total = kTermBytes - 16 * kPlaneBytes;
  for (const Plane& p : planes_) total += p.bytes.size() + kPlaneBytes;
  return total;
}

size_t Term::freshBytes() const {
  size_t total = 0;
  for (const Plane& p : planes_) total += p.bytes.fresh() ? p.bytes.size() : 0;
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
  planes_.reserve(16);  // spans handed out earlier stay valid: planes move, their storage does not
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

}  // namespace terms
}  // namespace gobo
