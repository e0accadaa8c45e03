// SPDX-License-Identifier: Apache-2.0
// The GLB container: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, chapter 4. Lengths are added in 64 bits.
#include <cstring>

#include "import/gltf/container.h"

namespace gobo::gltf {
namespace {

constexpr uint32_t kJson = 0x4e4f534au, kBin = 0x004e4942u;

uint32_t word(const std::vector<uint8_t>& b, uint64_t at) {
  uint32_t v;
  std::memcpy(&v, b.data() + at, 4);
  return v;
}

std::string kindOf(uint32_t type) {
  if (type == kJson) return "JSON";
  if (type == kBin) return "BIN";
  char text[16];
  std::snprintf(text, sizeof text, "0x%08x", type);
  return text;
}

}  // namespace

Status splitContainer(Document& d, const std::vector<uint8_t>& file, Container& out) {
  out.binary = file.size() >= 4 && std::memcmp(file.data(), "glTF", 4) == 0;
  if (!out.binary) {
    out.text = {reinterpret_cast<const char*>(file.data()), file.size()};
    return {};
  }
  const auto refuse = [&](const std::string& why) { return invalidArgument("GLB " + why, d.path); };
  if (file.size() < 20) return refuse("header is cut short");
  const uint64_t total = word(file, 8);
  if (word(file, 4) != 2) return refuse("version " + std::to_string(word(file, 4)) + " is not 2");
  if (total < 20 || total > file.size()) return refuse("length " + std::to_string(total) + " but the file has " + std::to_string(file.size()) + " bytes");
  if (total < file.size()) d.warn("(file)", std::to_string(file.size() - total) + " bytes after the end of the GLB are ignored");
  size_t n = 0;
  for (uint64_t at = 12; at < total; ++n) {
    if (total - at < 8) return refuse("chunk " + std::to_string(n) + ": its header is cut short");
    const uint64_t length = word(file, at);
    const uint32_t type = word(file, at + 4);
    const std::string name = kindOf(type) + " chunk";
    if (n == 0 && type != kJson) return refuse("begins with a " + name + ", not with JSON");
    if (length > total - at - 8) return refuse(name + " of " + std::to_string(length) + " bytes does not fit the file");
    const std::string_view bytes(reinterpret_cast<const char*>(file.data()) + at + 8, size_t(length));
    if (type == kJson && n > 0) return refuse("has a second JSON chunk");
    if (type == kBin && out.hasChunk) return refuse("has a second BIN chunk");
    if (type == kBin && n != 1) return refuse("BIN chunk is not the second chunk");
    if (length % 4) d.warn("(file)", "GLB chunk length " + std::to_string(length) + " is no multiple of 4");
    if (type == kJson) out.text = bytes;
    else if (type == kBin) {
      out.chunk = bytes;
      out.hasChunk = true;
    } else d.warn("(file)", "GLB chunk of the unknown type " + kindOf(type) + " is ignored");
    at += 8 + length;
  }
  return {};
}

}  // namespace gobo::gltf
