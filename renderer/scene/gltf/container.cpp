// SPDX-License-Identifier: Apache-2.0
// From a path to a Document: GLB header checks in 64 bits, JSON with bounded nesting, required extensions, URIs, bytes.
#include <cstring>
#include <map>

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include "base/image_io.h"
#include "scene/gltf/document.h"
#include "scene/gltf/schema.h"

namespace gobo::gltf {
namespace {

constexpr int kMaxNesting = 64;  // tinygltf walks extras by recursion

const std::set<std::string> kSupported = {
    "KHR_lights_punctual", "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission", "KHR_materials_dispersion",
    "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_iridescence", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_sheen",
    "KHR_materials_specular", "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_variants", "KHR_materials_volume",
    "KHR_materials_volume_scatter", "KHR_mesh_quantization", "KHR_texture_transform", "KHR_draco_mesh_compression", "EXT_meshopt_compression",
    "EXT_mesh_gpu_instancing", "EXT_texture_webp"};

using Files = std::map<std::string, std::vector<uint8_t>>;  // decoded URI -> bytes: all that tinygltf may see of the disk

uint32_t word(const std::vector<uint8_t>& b, size_t at) { uint32_t v; std::memcpy(&v, b.data() + at, 4); return v; }

bool nestingFits(std::string_view text) {
  int depth = 0;
  bool quoted = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) { if (c == '\\') ++i; else if (c == '"') quoted = false; }
    else if (c == '"') quoted = true;
    else if (c == '{' || c == '[') { if (++depth > kMaxNesting) return false; }
    else if (c == '}' || c == ']') --depth;
  }
  return true;
}

/// The JSON chunk of a GLB, or the whole file. Chunk lengths are checked against the file before tinygltf sees them.
Status jsonText(const std::string& path, const std::vector<uint8_t>& file, bool& binary, std::string_view& text) {
  binary = file.size() >= 4 && std::memcmp(file.data(), "glTF", 4) == 0;
  if (!binary) {
    text = {reinterpret_cast<const char*>(file.data()), file.size()};
    return {};
  }
  if (file.size() < 20) return invalidArgument("GLB header is cut short", path);
  const uint64_t total = word(file, 8), length = word(file, 12);
  if (word(file, 4) != 2) return invalidArgument("GLB version " + std::to_string(word(file, 4)) + " is not 2", path);
  if (total < 20 || total > file.size()) return invalidArgument("GLB length " + std::to_string(total) + " but the file has " + std::to_string(file.size()) + " bytes", path);
  if (word(file, 16) != 0x4e4f534au || length > total - 20) return invalidArgument("GLB JSON chunk of " + std::to_string(length) + " bytes does not fit the file", path);
  text = {reinterpret_cast<const char*>(file.data()) + 20, size_t(length)};
  const uint64_t next = 20 + length;
  if (next < total && (total - next < 8 || word(file, size_t(next)) > total - next - 8)) return invalidArgument("GLB binary chunk does not fit the file", path);
  return {};
}

bool isDataUri(const std::string& uri) { return uri.compare(0, 5, "data:") == 0; }

std::string percentDecode(const std::string& uri) {
  std::string out;
  for (size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] == '%' && i + 2 < uri.size() && std::isxdigit(uint8_t(uri[i + 1])) && std::isxdigit(uint8_t(uri[i + 2]))) {
      out += char(std::stoi(uri.substr(i + 1, 2), nullptr, 16));
      i += 2;
    } else out += uri[i];
  }
  return out;
}

/// Reads the file that `uri` names beside the glTF. NotFound is told apart from refusals, which are InvalidArgument.
Result<std::vector<uint8_t>> readBeside(const Document& d, const std::string& uri) {
  const std::string name = percentDecode(uri);
  GOBO_TRY(checkSideName(name, uri));
  return d.files->beside(name, d.options.maxBytes);
}

Status checkExtensions(Document& d) {
  const Cursor required = d.list("extensionsRequired"), used = d.list("extensionsUsed");
  for (size_t i = 0; i < required.size(); ++i) {
    const std::string name = required.at(i).text();
    if (d.ok() && !kSupported.count(name)) required.at(i).fail("required extension " + name + " is not supported");
  }
  for (size_t i = 0; i < used.size(); ++i) {
    const std::string name = used.at(i).text();
    if (d.ok() && !kSupported.count(name)) d.warn(used.at(i).pointer, "extension " + name + " is ignored");
  }
  return d.status;
}

/// Every file of the document, and the references that tinygltf follows by itself (bufferView of images, indices).
Status gatherFiles(Document& d, bool binary, Files& files) {
  const Cursor buffers = d.list("buffers"), images = d.list("images"), views = d.list("bufferViews"), accessors = d.list("accessors");
  for (size_t i = 0; i < buffers.size() && d.ok(); ++i) {
    const Cursor uri = buffers.at(i)["uri"], length = buffers.at(i)["byteLength"];
    if (!length.exists()) length.fail("byteLength is missing");
    const int64_t bytes = length.integer(0, 1, int64_t(1) << 48);
    const std::string text = uri.text();
    if (!d.ok() || !uri.exists() || isDataUri(text)) continue;
    auto read = readBeside(d, text);
    if (!read.ok()) return read.status().at(d.path + "#" + uri.pointer);
    if (read->size() < uint64_t(bytes)) length.fail("byteLength " + std::to_string(bytes) + " but \"" + text + "\" has " + std::to_string(read->size()) + " bytes");
    if (!d.account(read->size(), uri)) return d.status;
    files[percentDecode(text)] = std::move(*read);
  }
  d.images.resize(images.size());
  for (size_t i = 0; i < images.size() && d.ok(); ++i) {
    const Cursor image = images.at(i), uri = image["uri"];
    d.images[i].name = image["name"].text();
    image["bufferView"].index("bufferViews");
    const std::string text = uri.text();
    if (!uri.exists() || isDataUri(text)) continue;
    if (d.images[i].name.empty()) d.images[i].name = text;
    auto read = readBeside(d, text);
    // A missing picture leaves a scene that can be shown; a path that leads outside is an attack or a mistake.
    if (read.ok()) { d.images[i].bytes = std::move(*read); if (!d.account(d.images[i].bytes.size(), uri)) return d.status; }
    else if (read.status().code() == Code::InvalidArgument) return read.status().at(d.path + "#" + uri.pointer);
    else d.images[i].problem = read.status().message();
  }
  for (size_t i = 0; i < views.size() && d.ok(); ++i) views.at(i)["buffer"].index("buffers");
  for (size_t i = 0; i < accessors.size() && d.ok(); ++i) accessors.at(i)["bufferView"].index("bufferViews");
  const Cursor meshes = d.list("meshes");
  for (size_t i = 0; i < meshes.size() && d.ok(); ++i) {
    const Cursor primitives = meshes.at(i)["primitives"];
    for (size_t k = 0; k < primitives.size() && d.ok(); ++k) primitives.at(k)["indices"].index("accessors");
  }
  return d.status;
}

/// A buffer without a uri outside a GLB is legal as long as nothing reads it: it has no bytes here.
bool hasBytes(const Json& buffer, size_t i, bool binary) { return buffer.contains("uri") || (binary && i == 0); }

/// What tinygltf is given to parse: buffers only. The rest is read from the JSON by Cursor.
Json reduced(const Json& full, bool binary) {
  Json out = Json::object();
  out["asset"] = {{"version", "2.0"}};
  if (full.contains("buffers")) {
    out["buffers"] = Json::array();
    for (const Json& b : full["buffers"]) {
      Json copy = {{"byteLength", b["byteLength"]}};
      if (b.contains("uri")) copy["uri"] = b["uri"];
      if (!hasBytes(b, out["buffers"].size(), binary)) copy = {{"byteLength", 1}, {"uri", "data:application/octet-stream;base64,AA=="}};
      out["buffers"].push_back(copy);
    }
  }
  return out;
}

bool fileExists(const std::string& name, void* user) { return static_cast<Files*>(user)->count(name) > 0; }
std::string samePath(const std::string& name, void*) { return name; }
bool readWhole(std::vector<unsigned char>* out, std::string* err, const std::string& name, void* user) {
  const auto& files = *static_cast<Files*>(user);
  const auto it = files.find(name);
  if (it == files.end()) { if (err) *err += "file not offered: " + name; return false; }
  *out = it->second;
  return true;
}
bool refuseWrite(std::string*, const std::string&, const std::vector<unsigned char>&, void*) { return false; }

Status decodeBuffers(Document& d, const std::vector<uint8_t>& file, bool binary, Files& files) {
  const Json small = reduced(d.json, binary);
  tinygltf::TinyGLTF parser;
  tinygltf::FsCallbacks fs{};
  fs.FileExists = fileExists;
  fs.ExpandFilePath = samePath;  // the library's own expands by the shell: CVE-2022-3008
  fs.ReadWholeFile = readWhole;
  fs.WriteWholeFile = refuseWrite;
  fs.user_data = &files;
  parser.SetFsCallbacks(fs);
  tinygltf::Model model;
  std::string err, warn, text = small.dump();
  bool ok = false;
  if (binary) {
    // The same GLB with the reduced JSON: header, JSON chunk, and the binary chunk as it is.
    while (text.size() % 4) text += ' ';
    std::vector<uint8_t> glb(file.begin(), file.begin() + 20);
    glb.insert(glb.end(), text.begin(), text.end());
    const uint32_t length = uint32_t(text.size()), next = 20 + word(file, 12), end = word(file, 8);
    std::memcpy(glb.data() + 12, &length, 4);
    if (end >= next + 8) {
      const uint32_t chunk = word(file, next);  // the binary chunk alone: trailing chunks are none of ours
      glb.insert(glb.end(), file.begin() + next, file.begin() + next + 8 + chunk);
      while (glb.size() % 4) glb.push_back(0);
    }
    const uint32_t total = uint32_t(glb.size());
    std::memcpy(glb.data() + 8, &total, 4);
    ok = parser.LoadBinaryFromMemory(&model, &err, &warn, glb.data(), total, "");
  } else {
    ok = parser.LoadASCIIFromString(&model, &err, &warn, text.c_str(), unsigned(text.size()), "");
  }
  if (!ok) {
    while (!err.empty() && std::isspace(uint8_t(err.back()))) err.pop_back();
    return invalidArgument("buffers cannot be read: " + (err.empty() ? std::string("unknown reason") : err), d.path + "#/buffers");
  }
  for (tinygltf::Buffer& b : model.buffers) {
    if (d.json.contains("buffers") && d.buffers.size() < d.json["buffers"].size() && !hasBytes(d.json["buffers"][d.buffers.size()], d.buffers.size(), binary))
      b.data.clear();
    d.buffers.push_back(std::move(b.data));
  }
  return {};
}

/// Images inside the document: data URIs and buffer views.
Status decodeImages(Document& d) {
  const Cursor images = d.list("images");
  for (size_t i = 0; i < images.size(); ++i) {
    Document::EncodedImage& image = d.images[i];
    const Cursor uri = images.at(i)["uri"];
    const int view = images.at(i)["bufferView"].index("bufferViews");
    if (!image.bytes.empty() || !image.problem.empty()) continue;
    if (uri.exists()) {
      const std::string text = uri.text();
      std::string mime;
      // A data URI of an unknown kind is not decoded by the library: treated as a picture that cannot be read.
      if (!tinygltf::DecodeDataURI(&image.bytes, mime, text, 0, false) || image.bytes.empty()) image.problem = "data URI cannot be decoded";
    } else if (view >= 0) {
      const Cursor v = d.item("bufferViews", view);
      const int buffer = v["buffer"].index("buffers");
      const int64_t offset = v["byteOffset"].integer(0, 0, int64_t(1) << 48), length = v["byteLength"].integer(0, 1, int64_t(1) << 48);
      if (!d.ok()) return d.status;
      if (buffer >= 0 && d.buffers[buffer].empty()) { image.problem = "its buffer has no bytes"; continue; }
      if (buffer < 0 || uint64_t(offset) + uint64_t(length) > d.buffers[buffer].size()) { v.fail("buffer view is outside its buffer"); return d.status; }
      image.bytes.assign(d.buffers[buffer].begin() + offset, d.buffers[buffer].begin() + offset + length);
    } else image.problem = "image has neither uri nor bufferView";
  }
  return d.status;
}

}  // namespace

bool supported(const std::string& extension) { return kSupported.count(extension) > 0; }

Status openDocument(const std::string& path, const LoadOptions& options, Document& d) {
  d.path = path;
  d.options = options;
  DiskFiles disk(path);
  d.files = options.files ? options.files : &disk;
  GOBO_ASSIGN(const std::vector<uint8_t> file, d.files->main(std::min<uint64_t>(options.maxBytes, 0xffffffffu)));
  bool binary = false;
  std::string_view text;
  GOBO_TRY(jsonText(path, file, binary, text));
  if (binary && word(file, 12) % 4) d.warn("(file)", "GLB chunk length " + std::to_string(word(file, 12)) + " is no multiple of 4");
  if (text.substr(0, 3) == "\xef\xbb\xbf") { d.warn("(file)", "the JSON begins with a byte order mark"); text.remove_prefix(3); }
  if (!nestingFits(text)) return invalidArgument("JSON is nested more than " + std::to_string(kMaxNesting) + " deep", path);
  try {
    d.json = Json::parse(text.begin(), text.end());
    if (!d.json.is_object()) return invalidArgument("the document is not a JSON object", path + "#");
    const std::string version = d.root()["asset"]["version"].text();
    if (!d.ok()) return d.status;
    if (version.compare(0, 2, "2.") != 0) return invalidArgument("glTF version \"" + version + "\" is not 2.x", path + "#/asset/version");
    const std::string least = d.root()["asset"]["minVersion"].text("2.0");
    if (least.compare(0, 2, "2.") != 0 || least.find_first_not_of('0', 2) != std::string::npos) return invalidArgument("the file needs glTF " + least + "; 2.0 is read", path + "#/asset/minVersion");
    checkSchema(d);
    if (!d.ok()) return d.status;
    Files files;
    GOBO_TRY(checkExtensions(d));
    GOBO_TRY(gatherFiles(d, binary, files));
    GOBO_TRY(decodeBuffers(d, file, binary, files));
    if (d.buffers.size() != d.list("buffers").size()) return internalError("buffers were lost in parsing", path + "#/buffers");
    return decodeImages(d);
  } catch (const Json::parse_error& e) {
    return invalidArgument(std::string("JSON cannot be parsed: ") + e.what(), path + "#");
  } catch (const std::exception& e) {
    return invalidArgument(std::string("document cannot be read: ") + e.what(), path + "#");
  }
}

}  // namespace gobo::gltf
