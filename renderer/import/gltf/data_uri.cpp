// SPDX-License-Identifier: Apache-2.0
#include <tiny_gltf.h>

#include <cstring>

#include "import/gltf/container.h"

namespace gobo::gltf {
namespace {

int hexDigit(char c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1; }

bool isBase64(char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '+' || c == '/'; }

}  // namespace

std::string percentDecode(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (size_t i = 0; i < text.size(); ++i) {
    const int high = text[i] == '%' && i + 2 < text.size() ? hexDigit(text[i + 1]) : -1, low = high >= 0 ? hexDigit(text[i + 2]) : -1;
    if (low < 0) {
      out += text[i];
      continue;
    }
    out += char(high * 16 + low);
    i += 2;
  }
  return out;
}

bool isDataUri(const std::string& uri) { return uri.compare(0, 5, "data:") == 0; }

Result<DataUri> decodeDataUri(const std::string& uri) {
  const size_t comma = uri.find(',');
  if (comma == std::string::npos) return invalidArgument("data URI has no comma");
  const std::string head = uri.substr(5, comma - 5);
  const bool base64 = head.size() >= 7 && head.compare(head.size() - 7, 7, ";base64") == 0;
  DataUri out;
  out.kind = head.substr(0, head.find(';'));
  std::string_view body = std::string_view(uri).substr(comma + 1);
  std::string plain;
  if (body.find('%') != std::string_view::npos) body = plain = percentDecode(body);
  if (!base64) {
    out.bytes.assign(body.begin(), body.end());
    return out;
  }
  size_t digits = body.size();
  while (digits > 0 && body.size() - digits < 2 && body[digits - 1] == '=') --digits;
  for (size_t i = 0; i < digits; ++i)
    if (!isBase64(body[i])) return invalidArgument("data URI is not base64: byte " + std::to_string(uint8_t(body[i])) + " at " + std::to_string(i));
  if (digits % 4 == 1 || (digits != body.size() && body.size() % 4 != 0))
    return invalidArgument("data URI is not base64: " + std::to_string(body.size()) + " digits are no whole bytes");
  if (digits == 0) return out;
  // The library knows few media types: it gets one of them, whatever stood there.
  std::string canonical = "data:application/octet-stream;base64,";
  canonical.append(body.substr(0, digits)).append((4 - digits % 4) % 4, '=');
  std::string mime;
  if (!tinygltf::DecodeDataURI(&out.bytes, mime, canonical, 0, false)) return invalidArgument("data URI cannot be decoded");
  return out;
}

std::string pictureKind(const std::vector<uint8_t>& b) {
  const auto starts = [&](std::string_view magic, size_t at = 0) {
    return b.size() >= at + magic.size() && std::memcmp(b.data() + at, magic.data(), magic.size()) == 0;
  };
  if (starts("\x89PNG\r\n\x1a\n")) return "image/png";
  if (starts("\xff\xd8\xff")) return "image/jpeg";
  if (starts("RIFF") && starts("WEBP", 8)) return "image/webp";
  if (starts("\xabKTX 20\xbb")) return "image/ktx2";
  if (starts("\xabKTX 11\xbb")) return "image/ktx";
  if (starts("sB")) return "image/basis";
  if (starts("DDS ")) return "image/vnd-ms.dds";
  if (starts("GIF8")) return "image/gif";
  if (starts("BM")) return "image/bmp";
  if (starts("II*") || starts("MM")) return "image/tiff";
  if (starts("#?")) return "image/vnd.radiance";
  if (starts("\x76\x2f\x31\x01")) return "image/x-exr";
  return {};
}

}  // namespace gobo::gltf
