// SPDX-License-Identifier: Apache-2.0
// Terms: the content digest tells any two values apart, and the parser of the file form takes nothing on trust.
#include "terms/term_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <set>

#include "terms/scratch.h"

namespace gobo {
namespace {

const Hash128 kKey{0x0807060504030201ull, 0x100f0e0d0c0b0a09ull};

uint64_t next(uint64_t& state) {
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return state;
}

const Term& sample() {
  static Term term("gbuffer", Domain::ViewSample, {4, 3, 2});
  if (!term.planes().empty()) return term;
  auto p = term.addPlane<float>("P", 3);
  for (size_t i = 0; i < p.size(); ++i) p[i] = 0.5f * float(i);
  auto id = term.addPlane<uint32_t>("id");
  for (size_t i = 0; i < id.size(); ++i) id[i] = uint32_t(i * i);
  term.addPlane<uint8_t>("mask", 2)[5] = 9;
  term.addPlane<double>("sum")[1] = 1e300;
  return term;
}

/// What anybody can do to a file: the digest is no secret.
void sign(std::vector<uint8_t>& bytes) {
  const Hash128 h = hashBytes(bytes.data(), bytes.size() - 16);
  std::memcpy(bytes.data() + bytes.size() - 16, &h.lo, 8);
  std::memcpy(bytes.data() + bytes.size() - 8, &h.hi, 8);
}

/// Whatever was parsed must be a sound value: sizes agree, names differ, and it survives a round trip.
void expectSound(const Term& term) {
  std::set<std::string> names;
  for (const Plane& p : term.planes()) {
    ASSERT_TRUE(names.insert(p.name).second);
    ASSERT_LE(int(p.format), int(Format::U8));
    ASSERT_EQ(p.bytes.size(), term.extent().elements() * size_t(p.channels) * formatSize(p.format));
  }
  ASSERT_LE(int(term.domain()), int(Domain::Table));
  const auto bytes = serializeTerm(term, kKey);
  const auto back = parseTerm(bytes.data(), bytes.size(), kKey);
  ASSERT_NE(back, nullptr);
  ASSERT_EQ(back->content(), term.content());
}

TEST(Term, ContentDigestTellsEveryPartApart) {
  const auto make = [](const char* type, Domain domain, Extent extent, const char* name, int channels, float value) {
    Term t(type, domain, extent);
    t.addPlane<float>(name, channels)[0] = value;
    return t.content();
  };
  const std::vector<Hash128> all = {make("a", Domain::Pixel, {4, 2, 1}, "x", 1, 1),      make("b", Domain::Pixel, {4, 2, 1}, "x", 1, 1),
                                    make("a", Domain::ViewSample, {4, 2, 1}, "x", 1, 1), make("a", Domain::Pixel, {2, 4, 1}, "x", 1, 1),
                                    make("a", Domain::Pixel, {4, 1, 2}, "x", 1, 1),      make("a", Domain::Pixel, {4, 2, 1}, "y", 1, 1),
                                    make("a", Domain::Pixel, {2, 2, 1}, "x", 2, 1),      make("a", Domain::Pixel, {4, 2, 1}, "x", 1, 2),
                                    make("a", Domain::Pixel, {4, 2, 1}, "x", 1, -0.0f),  make("a", Domain::Pixel, {4, 2, 1}, "x", 1, 0.0f)};
  EXPECT_EQ(std::set<Hash128>(all.begin(), all.end()).size(), all.size());
  EXPECT_EQ(make("a", Domain::Pixel, {4, 2, 1}, "x", 1, 1), all[0]);
  // The same bytes as another scalar type, or split into planes elsewhere, are another value.
  Term u("a", Domain::Pixel, {4, 2, 1}), v("a", Domain::Pixel, {4, 2, 1}), w("a", Domain::Pixel, {4, 2, 1});
  u.addPlane<uint32_t>("x")[0] = 0x3f800000u;
  EXPECT_NE(u.content(), all[0]);
  v.addPlane<float>("x"), v.addPlane<float>("y")[0] = 1;
  w.addPlane<float>("x")[0] = 1, w.addPlane<float>("y");
  EXPECT_NE(v.content(), w.content());
}

TEST(Term, ContentDigestSeesEveryBit) {
  const Term& base = sample();
  std::set<Hash128> seen{base.content()};
  for (size_t plane = 0; plane < base.planes().size(); ++plane)
    for (size_t at = 0; at < base.planes()[plane].bytes.size(); at += 13) {
      Term t("gbuffer", Domain::ViewSample, {4, 3, 2});
      for (const Plane& p : base.planes()) t.addRaw(p.name, p.format, p.channels).bytes = p.bytes;
      const_cast<Plane&>(t.planes()[plane]).bytes[at] ^= 0x10;
      EXPECT_TRUE(seen.insert(t.content()).second) << plane << " " << at;
    }
}

TEST(Term, SpansStayValidWhileMorePlanesAreAdded) {
  Term term("t", Domain::List, {100, 1, 1});
  auto first = term.addPlane<float>("p0");
  for (int i = 1; i < 40; ++i) term.addPlane<float>("p" + std::to_string(i));
  for (float& v : first) v = 7;
  EXPECT_EQ(term.floats("p0")[99], 7);
}

TEST(TermFile, LayoutIsWhatTheDocumentSays) {
  Term term("ab", Domain::List, {3, 1, 1});
  auto v = term.addPlane<uint8_t>("xyz", 1);
  v[0] = 1, v[1] = 2, v[2] = 3;
  auto bytes = serializeTerm(term, kKey);
  const std::vector<uint8_t> expected = {'G', 'O', 'B', 'O', 'T', 'R', 'M', '2', 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 2, 0,
                                         0,   0,   'a', 'b', 4,   0,   0,   0,   3, 0, 0, 0, 1, 0, 0, 0, 1, 0,  0,  0,  1,  0,  0,  0,  3, 0,
                                         0,   0,   'x', 'y', 'z', 3,   0,   0,   0, 1, 0, 0, 0, 3, 0, 0, 0, 0,  0,  0,  0,  1,  2,  3};
  ASSERT_EQ(bytes.size(), expected.size() + 16);
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), bytes.begin()));
  auto signedAgain = bytes;
  sign(signedAgain);
  EXPECT_EQ(signedAgain, bytes);
}

TEST(TermFile, ManyPlanesAndEmptyExtentsRoundTrip) {
  Term many("many", Domain::Table, {5, 1, 1});
  for (int i = 0; i < 200; ++i) many.addPlane<float>("g" + std::to_string(i))[2] = float(i);
  expectSound(many);
  expectSound(Term("none", Domain::Pixel, {0, 0, 0}));
  Term empty("empty", Domain::List, {0, 1, 1});
  empty.addPlane<double>("x", 4);
  expectSound(empty);
}

TEST(TermFile, EveryTruncationAndEveryFlippedBitIsRefused) {
  const auto good = serializeTerm(sample(), kKey);
  for (size_t n = 0; n < good.size(); ++n) EXPECT_EQ(parseTerm(good.data(), n, kKey), nullptr) << n;
  for (size_t at = 0; at < good.size(); ++at)
    for (int bit = 0; bit < 8; ++bit) {
      auto bytes = good;
      bytes[at] ^= uint8_t(1 << bit);
      EXPECT_EQ(parseTerm(bytes.data(), bytes.size(), kKey), nullptr) << at;
    }
}

TEST(TermFile, IsOfOneKeyOnly) {
  uint64_t random = 99;
  const auto draw = [&] {
    const uint64_t lo = next(random);
    return Hash128{lo, next(random)};
  };
  for (int n = 0; n < 2000; ++n) {
    Hash128 key = draw(), other = n % 2 ? draw() : key;
    if (n % 2 == 0) (n % 4 ? other.lo : other.hi) ^= 1ull << (next(random) % 64);  // one bit beside it
    const auto bytes = serializeTerm(sample(), key);
    const auto back = parseTerm(bytes.data(), bytes.size(), key);
    ASSERT_NE(back, nullptr);
    ASSERT_EQ(back->content(), sample().content());
    ASSERT_EQ(parseTerm(bytes.data(), bytes.size(), other), nullptr) << key.hex() << " " << other.hex();
    auto renamed = bytes;  // the key is inside the digest
    std::memcpy(renamed.data() + 8, &other, 16);
    ASSERT_EQ(parseTerm(renamed.data(), renamed.size(), other), nullptr);
  }
}

TEST(TermFile, OtherVersionsAreToldFromDamage) {
  auto bytes = serializeTerm(sample(), kKey);
  EXPECT_FALSE(isOtherTermVersion(bytes.data(), bytes.size()));
  for (const char version : {'1', '3'}) {
    bytes[7] = uint8_t(version);
    sign(bytes);
    EXPECT_TRUE(isOtherTermVersion(bytes.data(), bytes.size()));
    EXPECT_EQ(parseTerm(bytes.data(), bytes.size(), kKey), nullptr);
  }
  EXPECT_FALSE(isOtherTermVersion(bytes.data(), 7));
  bytes[30] ^= 1;
  EXPECT_FALSE(isOtherTermVersion(bytes.data(), bytes.size()));  // damaged as well
  bytes[30] ^= 1;
  bytes[0] = 'X';
  EXPECT_FALSE(isOtherTermVersion(bytes.data(), bytes.size()));
}

TEST(TermFile, RandomBytesAreRefusedOrSound) {
  uint64_t random = 12345;
  for (int n = 0; n < 20000; ++n) {
    std::vector<uint8_t> bytes(40 + next(random) % 120);
    for (auto& b : bytes) b = uint8_t(next(random) & (n % 2 ? 0xff : 0x03));  // small numbers reach further into the parser
    std::memcpy(bytes.data(), "GOBOTRM2", 8);
    std::memcpy(bytes.data() + 8, &kKey, 16);
    sign(bytes);
    if (const auto term = parseTerm(bytes.data(), bytes.size(), kKey)) expectSound(*term);
  }
}

TEST(TermFile, SignedMutationsAreRefusedOrSound) {
  // With a right digest every check behind it has to hold by itself: no CHECK, no overflow, no huge allocation.
  const auto good = serializeTerm(sample(), kKey);
  uint64_t random = 777;
  int parsed = 0;
  static const uint32_t odd[] = {0, 1, 2, 3, 4, 5, 0x7fffffff, 0x80000000u, 0xffffffffu, 0x10000, 0x40000000, 65537};
  for (int n = 0; n < 60000; ++n) {
    auto bytes = good;
    for (int k = 0; k < 1 + int(next(random) % 3); ++k) {
      const size_t at = 24 + next(random) % (bytes.size() - 44);
      switch (next(random) % 4) {
        case 0: bytes[at] = uint8_t(next(random)); break;
        case 1: std::memcpy(bytes.data() + at, &odd[next(random) % 12], 4); break;
        case 2: bytes.erase(bytes.begin() + long(at)); break;
        default: bytes.insert(bytes.begin() + long(at), uint8_t(next(random)));
      }
    }
    sign(bytes);
    if (const auto term = parseTerm(bytes.data(), bytes.size(), kKey)) {
      ++parsed;
      expectSound(*term);
    }
  }
  EXPECT_GT(parsed, 1000);  // changed values are fine
  EXPECT_LT(parsed, 59000);
}

TEST(TermFile, ForgedHeadersThatWouldTripLaterCodeAreRefused) {
  const auto header = [](uint32_t domain, int32_t w, int32_t h, int32_t l, uint32_t planes, std::initializer_list<const char*> names, uint32_t format = 3,
                         int32_t channels = 1, uint64_t length = 0) {
    std::vector<uint8_t> b;
    const auto put = [&](const void* p, size_t n) { b.insert(b.end(), static_cast<const uint8_t*>(p), static_cast<const uint8_t*>(p) + n); };
    const uint32_t one = 1;
    put("GOBOTRM2", 8), put(&kKey, 16), put(&one, 4), put("t", 1), put(&domain, 4), put(&w, 4), put(&h, 4), put(&l, 4), put(&planes, 4);
    for (const char* name : names) put(&one, 4), put(name, 1), put(&format, 4), put(&channels, 4), put(&length, 8);
    b.resize(b.size() + 16);
    sign(b);
    return parseTerm(b.data(), b.size(), kKey);
  };
  EXPECT_NE(header(0, 0, 1, 1, 1, {"a"}), nullptr);       // the builder itself is right
  EXPECT_EQ(header(0, 0, 1, 1, 2, {"a", "a"}), nullptr);  // a name twice would trip addRaw's CHECK
  EXPECT_EQ(header(6, 0, 1, 1, 1, {"a"}), nullptr);       // no such domain
  EXPECT_EQ(header(256, 0, 1, 1, 1, {"a"}), nullptr);     // nor one that fits after truncation to a byte
  EXPECT_EQ(header(0, 0, 1, 1, 1, {"a"}, 259), nullptr);  // the same for the format
  EXPECT_EQ(header(0, 0, 1, 1, 1, {"a"}, 3, 0), nullptr);
  EXPECT_EQ(header(0, 0, 1, 1, 1, {"a"}, 3, -1), nullptr);
  EXPECT_EQ(header(0, 1 << 30, 1 << 30, 16, 1, {"a"}), nullptr);  // 2^64 elements: wraps to 0, which the length would match
  EXPECT_EQ(header(0, 1 << 30, 1 << 30, 16, 0, {}), nullptr);     // also where no plane shows it
  EXPECT_EQ(header(0, 1 << 20, 1 << 20, 1, 1, {"a"}, 1, 1 << 21), nullptr);
  EXPECT_EQ(header(0, -1, 1, 1, 0, {}), nullptr);
  EXPECT_EQ(header(0, 0, 1, 1, 0xffffffffu, {}), nullptr);
}

TEST(Scratch, MovesAndTakesWhatWasGivenBack) {
  Scratch<int> a(10);
  a[3] = 7;
  const Scratch<int> b = std::move(a);
  EXPECT_EQ(b.size(), 10u);
  EXPECT_EQ(b[3], 7);
  const size_t large = size_t(3) << 20;
  float* before = nullptr;
  {
    const Scratch<float> held(large);
    before = held.get();
    EXPECT_EQ(held.values().size(), large);
  }
  const Scratch<float> again(large);
  EXPECT_EQ(again.get(), before) << "fresh from the system, where a block of its size was free";
}
}  // namespace
}  // namespace gobo
