// SPDX-License-Identifier: Apache-2.0
// Internal to the glTF reader: bytes into a JSON document and buffers. Everything here is checked before it is believed.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "import/gltf/document.h"

namespace gobo::gltf {

/// The parts of a file. `binary`: it is a GLB; `chunk` is its BIN chunk (empty when it has none).
struct Container {
  bool binary = false, hasChunk = false;
  std::string_view text, chunk;
};

/// Splits a GLB (all chunks are checked: order, kinds, lengths, alignment) or takes the whole file as JSON. What can be read in
/// spite of a fault is a warning at "(file)".
Status splitContainer(Document& d, const std::vector<uint8_t>& file, Container& out);

/// Parses JSON: nesting of at most 64, UTF-8, and no key twice in one object (its place is in the error).
Status parseJson(const std::string& path, std::string_view text, Json& out);

std::string percentDecode(std::string_view text);
bool isDataUri(const std::string& uri);
/// RFC 2397: "data:" [media type] [";base64"] "," data. Base64 is strict (alphabet, padding); without it bytes are percent-encoded.
struct DataUri {
  std::string kind;
  std::vector<uint8_t> bytes;
};
Result<DataUri> decodeDataUri(const std::string& uri);

/// Bytes of the file beside the document that `uri` names, while that is being opened. Errors name the place.
Status readNamed(Document& d, const Cursor& uri, std::vector<uint8_t>& out);
/// IES files of lights, into Document::photometry (photometry.cpp).
Status readPhotometry(Document& d);

/// Media type of a picture by its first bytes; empty when it is none that is known. What the format allows is png and jpeg,
/// and by extension webp and ktx2.
std::string pictureKind(const std::vector<uint8_t>& bytes);

}  // namespace gobo::gltf
