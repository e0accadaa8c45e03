// SPDX-License-Identifier: Apache-2.0
// MurmurHash3_x86_32 against published vectors: those that libraries of many languages share, and manifests of Cryptomatte's sample pictures.
#include <gtest/gtest.h>

#include <string>

#include "base/murmur3.h"

namespace gobo {
namespace {

using namespace std::string_literals;

TEST(Murmur3, PublishedVectors) {
  struct Vector {
    std::string bytes;
    uint32_t seed, hash;
  };
  const Vector vectors[] = {{"", 0, 0},
                            {"", 1, 0x514e28b7},
                            {"", 0xffffffff, 0x81f16f39},
                            {"\xff\xff\xff\xff", 0, 0x76293b50},
                            {"\x21\x43\x65\x87", 0, 0xf55b516b},
                            {"\x21\x43\x65\x87", 0x5082edee, 0x2362f9de},
                            {"\x21\x43\x65", 0, 0x7e4a8634},
                            {"\x21\x43", 0, 0xa0f7b07a},
                            {"\x21", 0, 0x72661cf4},
                            {"\0\0\0\0"s, 0, 0x2362f9de},
                            {"\0\0\0"s, 0, 0x85f0b427},
                            {"\0\0"s, 0, 0x30f4c306},
                            {"\0"s, 0, 0x514e28b7},
                            {"aaaa", 0x9747b28c, 0x5a97808a},
                            {"Hello, world!", 0x9747b28c, 0x24884cba},
                            {"The quick brown fox jumps over the lazy dog", 0x9747b28c, 0x2fa826cd},
                            {"hello", 0, 0x248bfa47},
                            {"bunny", 0, 0x13851a76},
                            {"default", 0, 0x42c9679f},
                            {"bunny_porcelain_mat", 0, 0xb24b26d4}};
  for (const Vector& v : vectors) EXPECT_EQ(murmurHash3(v.bytes, v.seed), v.hash) << '"' << v.bytes << "\" " << v.seed;
}

}  // namespace
}  // namespace gobo
