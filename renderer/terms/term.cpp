// SPDX-License-Identifier: Apache-2.0
#include "terms/term.h"

#include <cstring>

namespace gobo {

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

Plane& Term::addRaw(std::string name, Format format, int channels) {
  GOBO_CHECK(find(name) == nullptr);
  Plane p{std::move(name), format, channels, {}};
  p.bytes.resize(extent_.elements() * channels * formatSize(format));
  planes_.reserve(16);   // spans handed out earlier stay valid: vectors of bytes do not move their storage
  planes_.push_back(std::move(p));
  return planes_.back();
}

Hash128 Term::content() const {
  std::call_once(once_, [this] {
    Hasher h("term");
    h.add(type_).add(domain_).add(extent_.width).add(extent_.height).add(extent_.layers);
    for (const Plane& p : planes_) h.add(p.name).add(p.format).add(p.channels).addArray(p.bytes);
    content_ = h.digest();
  });
  return content_;
}

// File form: docs/term_file.md. Little endian; strings and planes are length-prefixed; the last 16 bytes are the digest
// of everything before them.
namespace {

constexpr char kMagic[8] = {'G', 'O', 'B', 'O', 'T', 'R', 'M', '1'};

template <typename T> void put(std::vector<uint8_t>& out, T v) {
  const auto* p = reinterpret_cast<const uint8_t*>(&v);
  out.insert(out.end(), p, p + sizeof v);
}
void putText(std::vector<uint8_t>& out, const std::string& s) {
  put(out, uint32_t(s.size()));
  out.insert(out.end(), s.begin(), s.end());
}

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
    if (!good || n > 4096 || n > left) { good = false; return {}; }
    std::string s(reinterpret_cast<const char*>(p), n);
    p += n; left -= n;
    return s;
  }
};

}  // namespace

std::vector<uint8_t> serializeTerm(const Term& term) {
  std::vector<uint8_t> out;
  out.reserve(term.bytes() + 256);
  out.insert(out.end(), kMagic, kMagic + 8);
  putText(out, term.type());
  put(out, uint32_t(term.domain()));
  put(out, int32_t(term.extent().width));
  put(out, int32_t(term.extent().height));
  put(out, int32_t(term.extent().layers));
  put(out, uint32_t(term.planes().size()));
  for (const Plane& p : term.planes()) {
    putText(out, p.name);
    put(out, uint32_t(p.format));
    put(out, int32_t(p.channels));
    put(out, uint64_t(p.bytes.size()));
    out.insert(out.end(), p.bytes.begin(), p.bytes.end());
  }
  const Hash128 digest = hashBytes(out.data(), out.size());
  put(out, digest.lo);
  put(out, digest.hi);
  return out;
}

std::shared_ptr<Term> parseTerm(const uint8_t* bytes, size_t size) {
  if (size < 24 || std::memcmp(bytes, kMagic, 8) != 0) return nullptr;
  Hash128 stored;
  std::memcpy(&stored.lo, bytes + size - 16, 8);
  std::memcpy(&stored.hi, bytes + size - 8, 8);
  if (hashBytes(bytes, size - 16) != stored) return nullptr;
  Reader r{bytes + 8, size - 24};
  const std::string type = r.text();
  const auto domain = Domain(r.take<uint32_t>());
  Extent extent;
  extent.width = r.take<int32_t>();
  extent.height = r.take<int32_t>();
  extent.layers = r.take<int32_t>();
  const uint32_t planes = r.take<uint32_t>();
  if (!r.good || extent.width < 0 || extent.height < 0 || extent.layers < 0 || planes > 64) return nullptr;
  auto term = std::make_shared<Term>(type, domain, extent);
  for (uint32_t i = 0; i < planes; ++i) {
    const std::string name = r.text();
    const auto format = Format(r.take<uint32_t>());
    const int channels = r.take<int32_t>();
    const uint64_t length = r.take<uint64_t>();
    if (!r.good || formatSize(format) == 0 || channels < 1 || channels > 1 << 16 || length > r.left) return nullptr;
    if (length != extent.elements() * size_t(channels) * formatSize(format)) return nullptr;
    Plane& p = term->addRaw(name, format, channels);
    std::memcpy(p.bytes.data(), r.p, length);
    r.p += length; r.left -= length;
  }
  return r.left == 0 ? term : nullptr;
}

}  // namespace gobo
