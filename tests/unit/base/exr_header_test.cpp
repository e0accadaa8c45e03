// SPDX-License-Identifier: Apache-2.0
// Tiny EXR files whose headers ask for gigabytes are refused before OpenEXR allocates: read in a process whose address space has no
// room for what they ask.
#include "base/exr_header.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <fstream>

#include "base/image_exr.h"
#include "base/image_io.h"

namespace gobo::exr_header_test {
namespace {

struct Bytes {
  std::string s;
  Bytes& word(uint32_t v) {
    s.append(reinterpret_cast<const char*>(&v), 4);
    return *this;
  }
  Bytes& text(const std::string& t) {
    s += t;
    s.push_back('\0');
    return *this;
  }
};
std::string box(int w, int h) { return Bytes().word(0).word(0).word(uint32_t(w - 1)).word(uint32_t(h - 1)).s; }
std::string channels(int n) {
  Bytes b;
  for (int i = 0; i < n; ++i) b.text("c" + std::to_string(100 + i)).word(2).word(0).word(1).word(1);
  b.s.push_back('\0');
  return b.s;
}
std::string tiles(uint32_t w, uint32_t h) { return Bytes().word(w).word(h).s + std::string(1, '\0'); }

struct File {
  uint8_t flags = 0;
  std::vector<std::pair<std::string, std::string>> attributes;  // "name type", contents
  std::string tail = std::string(64, '\0');

  File& put(const std::string& nameAndType, const std::string& value) {
    attributes.emplace_back(nameAndType, value);
    return *this;
  }
  /// `size` may lie.
  static void attribute(Bytes& b, const std::string& nameAndType, const std::string& value, uint32_t size) {
    const size_t space = nameAndType.find(' ');
    b.text(nameAndType.substr(0, space)).text(nameAndType.substr(space + 1)).word(size);
    b.s += value;
  }
  std::string bytes(const std::string& liar = {}) const {
    Bytes b;
    b.s = std::string("\x76\x2f\x31\x01\x02", 5) + char(flags) + std::string(2, '\0') + liar;
    for (const auto& [name, value] : attributes) attribute(b, name, value, uint32_t(value.size()));
    b.s.push_back('\0');
    return b.s + tail;
  }
};
File plain(int w, int h, int channelCount, char compression) {
  File f;
  f.put("channels chlist", channels(channelCount)).put("compression compression", std::string(1, compression)).put("dataWindow box2i", box(w, h));
  f.put("displayWindow box2i", box(w, h)).put("lineOrder lineOrder", std::string(1, '\0')).put("pixelAspectRatio float", Bytes().word(0x3f800000).s);
  return f.put("screenWindowCenter v2f", Bytes().word(0).word(0).s).put("screenWindowWidth float", Bytes().word(0x3f800000).s);
}
std::string lie(const std::string& nameAndType, const std::string& value, uint32_t size) {
  Bytes b;
  File::attribute(b, nameAndType, value, size);
  return b.s;
}

struct Answer {
  bool left = false;
  std::string message;
};

/// Read with 96 MiB of address space beyond what the process has.
Answer readSmall(const std::string& file) {
  int out[2];
  if (::pipe(out) != 0) return {};
  const pid_t pid = ::fork();
  if (pid == 0) {
    std::ifstream statm("/proc/self/statm");
    uint64_t pages = 0;
    statm >> pages;
    const rlim_t bytes = pages * uint64_t(::sysconf(_SC_PAGESIZE)) + (96ull << 20);
    const rlimit limit{bytes, bytes};
    std::string said = "no limit";
    if (::setrlimit(RLIMIT_AS, &limit) == 0) {
      const auto* p = reinterpret_cast<const uint8_t*>(file.data());
      const auto image = readImageFromMemory(p, file.size(), "tiny.exr");
      const auto layers = exrLayers(p, file.size(), "tiny.exr");
      const auto words = exrMetadata(p, file.size(), "tiny.exr");
      said = (image.ok() ? "read" : image.status().toString()) + "\n" + (layers.ok() ? "read" : layers.status().toString()) + "\n" +
             (words.ok() ? "read" : words.status().toString());
    }
    (void)!::write(out[1], said.data(), said.size());
    ::_exit(0);
  }
  ::close(out[1]);
  Answer answer;
  char text[4096];
  for (ssize_t n; (n = ::read(out[0], text, sizeof text)) > 0;) answer.message.append(text, size_t(n));
  ::close(out[0]);
  int status = 0;
  ::waitpid(pid, &status, 0);
  answer.left = WIFEXITED(status) && WEXITSTATUS(status) == 0;
  return answer;
}

TEST(ExrHeader, TinyFilesCannotAskForGigabytes) {
#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
  GTEST_SKIP() << "a sanitizer's shadow memory takes more address space than any limit leaves";
#endif
  const std::string huge = lie("z blob", "", 0x70000000);
  File wide = plain(16384, 1, 64, 9), tile = plain(64, 64, 4, 3), grains = plain(16384, 8000, 4, 3);
  tile.flags = grains.flags = 2;
  tile.put("tiles tiledesc", tiles(4096, 8192));
  tile.tail = std::string(8192, '\0');
  grains.put("tiles tiledesc", tiles(1, 1));
  grains.tail = std::string(8192, '\0');
  File parts = plain(64, 64, 4, 3);
  parts.flags = 0x10;
  parts.put("name string", "a").put("type string", "scanlineimage").put("chunkCount int", Bytes().word(0x7ffffff0).s);
  const std::map<std::string, std::pair<std::string, std::string>> cases{
      // what it does: file, what the error says
      {"attribute longer than the file", {plain(64, 64, 4, 3).bytes(huge), "does not fit the file"}},
      {"int that hides it",
       {plain(64, 64, 4, 3).bytes(lie("a int", std::string(4, '\0') + huge + std::string(64, '\0'), uint32_t(68 + huge.size()))), "should have 4"}},
      {"int that is too short", {plain(64, 64, 4, 3).bytes(lie("a int", std::string(1, '\0'), 1)), "should have 4"}},
      {"channels that hide it",
       {plain(64, 64, 4, 3).bytes(lie("a chlist", std::string(1, '\0') + huge + std::string(64, '\0'), uint32_t(65 + huge.size()))), "length of its contents"}},
      {"preview", {plain(64, 64, 4, 3).bytes(lie("p preview", Bytes().word(20000).word(20000).s, 8)), "length of its contents"}},
      {"list of texts", {plain(64, 64, 4, 3).bytes(lie("t stringvector", Bytes().word(0x70000000).s, 4)), "length of its contents"}},
      {"lines of a chunk", {wide.bytes(), "more than it can hold"}},
      {"tile", {tile.bytes(), "more than it can hold"}},
      {"tiles of one pixel", {grains.bytes(), "chunk table"}},
      {"count of chunks", {parts.bytes() + std::string(1, '\0'), "chunk table"}}};
  for (const auto& [what, row] : cases) {
    const Answer a = readSmall(row.first);
    EXPECT_TRUE(a.left) << what << ": the process crashed";
    EXPECT_LT(row.first.size(), 16384u) << what;
    EXPECT_NE(a.message.find("INVALID_ARGUMENT"), std::string::npos) << what << ": " << a.message;
    EXPECT_NE(a.message.find(row.second), std::string::npos) << what << ": " << a.message;
    EXPECT_EQ(a.message.find("bad_alloc"), std::string::npos) << what << ": " << a.message;
  }
}

TEST(ExrHeader, PartsAreBounded) {
  const auto file = [](int n) {
    Bytes b;
    b.s = std::string("\x76\x2f\x31\x01\x02\x10\0\0", 8);
    for (int i = 0; i < n; ++i) b.s += lie("a int", std::string(4, '\0'), 4) + std::string(1, '\0');
    b.s += std::string(1, '\0');
    return b.s;
  };
  const auto check = [](const std::string& s) { return checkExrHeaders(reinterpret_cast<const uint8_t*>(s.data()), s.size(), "parts.exr"); };
  EXPECT_TRUE(check(file(kMaxExrParts - 1)).ok()) << check(file(kMaxExrParts - 1)).toString();
  EXPECT_EQ(check(file(kMaxExrParts + 1)).code(), Code::InvalidArgument);
  EXPECT_EQ(check(file(3).substr(0, 30)).location(), "parts.exr");
}

// What OpenEXR writes passes, with every compression and in two parts.
TEST(ExrHeader, GoodFilesPass) {
  Image image(300, 70, 4);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i % 97) * 0.01f;
  for (const ExrCompression c : {ExrCompression::None, ExrCompression::Zip, ExrCompression::Piz, ExrCompression::Dwaa, ExrCompression::Dwab}) {
    ExrOptions options;
    options.compression = c;
    options.metadata["note"] = "text";
    const auto bytes = encodeExr(image, options);
    ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
    EXPECT_TRUE(checkExrHeaders(bytes->data(), bytes->size(), "good.exr").ok());
    EXPECT_TRUE(readImageFromMemory(bytes->data(), bytes->size(), "good.exr").ok());
  }
}

}  // namespace
}  // namespace gobo::exr_header_test
