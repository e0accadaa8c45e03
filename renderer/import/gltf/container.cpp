// SPDX-License-Identifier: Apache-2.0
// From a path to a Document: container, JSON, structure, required extensions, then the bytes of buffers and pictures.
#include "import/gltf/container.h"

#include "base/image_io.h"
#include "import/gltf/schema.h"

namespace gobo::gltf {
namespace {

const std::set<std::string> kSupported = {"KHR_lights_punctual",
                                          "KHR_materials_anisotropy",
                                          "KHR_materials_clearcoat",
                                          "KHR_materials_diffuse_transmission",
                                          "KHR_materials_dispersion",
                                          "KHR_materials_emissive_strength",
                                          "KHR_materials_ior",
                                          "KHR_materials_iridescence",
                                          "KHR_materials_pbrSpecularGlossiness",
                                          "KHR_materials_sheen",
                                          "KHR_materials_specular",
                                          "KHR_materials_transmission",
                                          "KHR_materials_unlit",
                                          "KHR_materials_variants",
                                          "KHR_materials_volume",
                                          "KHR_materials_volume_scatter",
                                          "KHR_mesh_quantization",
                                          "KHR_texture_transform",
                                          "KHR_draco_mesh_compression",
                                          "EXT_lights_ies",
                                          "EXT_meshopt_compression",
                                          "EXT_mesh_gpu_instancing",
                                          "EXT_texture_webp"};

/// Before the structure, which another version may change. What is no text is left to the structure's check.
Status checkVersion(const Document& d) {
  const Json* asset = d.json.contains("asset") ? &d.json["asset"] : nullptr;
  const auto text = [&](const char* key, const char* otherwise) {
    return asset && asset->is_object() && asset->contains(key) && (*asset)[key].is_string() ? (*asset)[key].get<std::string>() : std::string(otherwise);
  };
  const std::string version = text("version", "2.0"), least = text("minVersion", "2.0");
  if (version.compare(0, 2, "2.") != 0 || version.size() < 3 || version.find_first_not_of("0123456789", 2) != std::string::npos)
    return invalidArgument("glTF version \"" + version + "\" is not 2.x", d.path + "#/asset/version");
  if (least.compare(0, 2, "2.") != 0 || least.find_first_not_of('0', 2) != std::string::npos)
    return invalidArgument("the file needs glTF " + least + "; 2.0 is read", d.path + "#/asset/minVersion");
  return {};
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

/// Bytes of one buffer: a data URI, a file, or the BIN chunk. A buffer that has none is legal as long as nothing reads it.
Status readBuffer(Document& d, const Container& container, size_t i) {
  const Cursor buffer = d.list("buffers").at(i), uri = buffer["uri"], length = buffer["byteLength"];
  std::vector<uint8_t>& bytes = d.buffers.emplace_back();
  const uint64_t stated = uint64_t(length.integer(0, 1, int64_t(1) << 48));
  const std::string text = uri.text();
  std::string from = "\"" + text + "\"";
  if (uri.exists() && isDataUri(text)) {
    auto data = decodeDataUri(text);
    if (!data.ok()) return data.status().at(d.path + "#" + uri.pointer);
    if (data->kind != "application/octet-stream" && data->kind != "application/gltf-buffer")
      d.warn(uri.pointer, "\"" + data->kind.substr(0, 60) + "\" is not a media type of buffers");
    bytes = std::move(data->bytes);
    from = "the data URI";
  } else if (uri.exists()) {
    auto read = readBeside(d, text);
    if (!read.ok()) return read.status().at(d.path + "#" + uri.pointer);
    bytes = std::move(*read);
  } else if (i == 0 && container.hasChunk) {
    bytes.assign(container.chunk.begin(), container.chunk.end());
    from = "the GLB chunk";
    if (bytes.size() > stated + 3) d.warn(length.pointer, "the GLB chunk has " + std::to_string(bytes.size() - stated) + " bytes more than byteLength says");
  } else {
    if (i == 0 && container.binary) d.warn(buffer.pointer, "has no uri, and the GLB has no BIN chunk: there are no bytes");
    return {};
  }
  if (bytes.size() < stated) length.fail("byteLength " + std::to_string(stated) + " but " + from + " has " + std::to_string(bytes.size()) + " bytes");
  bytes.resize(std::min<uint64_t>(bytes.size(), stated));  // views are proved inside what the file states
  if (d.ok()) d.account(bytes.size(), uri.exists() ? uri : buffer);
  return d.status;
}

/// Bytes of one picture. A missing one leaves a scene that can be shown; a path that leads outside is an attack or a mistake.
Status readImage(Document& d, size_t i) {
  const Cursor image = d.list("images").at(i), uri = image["uri"], view = image["bufferView"];
  Document::EncodedImage& out = d.images[i];
  out.name = image["name"].text();
  const auto leaveOut = [&](const std::string& why) {
    out.problem = why;
    d.warn(uri.exists() ? uri.pointer : image.pointer, "picture \"" + out.name + "\" is left out: " + why);
    return Status();
  };
  if (uri.exists()) {
    const std::string text = uri.text();
    if (!isDataUri(text)) {
      if (out.name.empty()) out.name = text;
      auto read = readBeside(d, text);
      if (!read.ok()) return read.status().code() == Code::InvalidArgument ? read.status().at(d.path + "#" + uri.pointer) : leaveOut(read.status().message());
      out.bytes = std::move(*read);
    } else {
      auto data = decodeDataUri(text);
      if (!data.ok()) return leaveOut(data.status().message());
      if (data->bytes.empty()) return leaveOut("data URI holds nothing");
      out.bytes = std::move(data->bytes);
    }
    d.account(out.bytes.size(), uri);
    return d.status;
  }
  if (!view.exists()) return leaveOut("image has neither uri nor bufferView");
  const Cursor v = d.item("bufferViews", view.index("bufferViews"));
  const int buffer = v["buffer"].index("buffers");
  const int64_t offset = v["byteOffset"].integer(0, 0, int64_t(1) << 48), length = v["byteLength"].integer(0, 1, int64_t(1) << 48);
  if (!d.ok()) return d.status;
  if (buffer >= 0 && d.buffers[buffer].empty()) return leaveOut("its buffer has no bytes");
  if (buffer < 0 || uint64_t(offset) + uint64_t(length) > d.buffers[buffer].size()) {
    v.fail("buffer view is outside its buffer");
    return d.status;
  }
  out.bytes.assign(d.buffers[buffer].begin() + offset, d.buffers[buffer].begin() + offset + length);
  return d.status;
}

}  // namespace

Status readNamed(Document& d, const Cursor& uri, std::vector<uint8_t>& out) {
  auto read = readBeside(d, uri.text());
  if (!read.ok()) return read.status().at(d.path + "#" + uri.pointer);
  out = std::move(*read);
  return {};
}

bool supported(const std::string& extension) { return kSupported.count(extension) > 0; }

Status openDocument(const std::string& path, const LoadOptions& options, Document& d) {
  d.path = path;
  d.options = options;
  DiskFiles disk(path);
  d.files = options.files ? options.files : &disk;
  GOBO_ASSIGN(const std::vector<uint8_t> file, d.files->main(std::min<uint64_t>(options.maxBytes, 0xffffffffu)));
  d.files->parsing("");
  Container container;
  GOBO_TRY(splitContainer(d, file, container));
  std::string_view text = container.text;
  if (text.substr(0, 3) == "\xef\xbb\xbf") {
    d.warn("(file)", "the JSON begins with a byte order mark");
    text.remove_prefix(3);
  }
  try {
    GOBO_TRY(parseJson(path, text, d.json));
    GOBO_TRY(checkVersion(d));
    checkSchema(d);
    if (!d.ok()) return d.status;
    GOBO_TRY(checkExtensions(d));
    for (size_t i = 0; i < d.list("buffers").size(); ++i) GOBO_TRY(readBuffer(d, container, i));
    d.images.resize(d.list("images").size());
    for (size_t i = 0; i < d.images.size(); ++i) GOBO_TRY(readImage(d, i));
    GOBO_TRY(readPhotometry(d));
    return d.status;
  } catch (const std::exception& e) { return invalidArgument(std::string("document cannot be read: ") + e.what(), path + "#"); }
}

}  // namespace gobo::gltf
