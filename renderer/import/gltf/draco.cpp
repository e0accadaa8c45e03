// SPDX-License-Identifier: Apache-2.0
// KHR_draco_mesh_compression. The stream's own counts are read from its header and compared with the accessors' (whose memory
// is accounted) before the library allocates by them; what it decodes is compared again.
#include <draco/compression/decode.h>

#include <cstring>

#include "import/gltf/document.h"

namespace gobo::gltf {
namespace {

/// Faces and points (vertices before attribute seams split them) of the header; false when it is too odd to tell.
bool headerCounts(const uint8_t* data, size_t size, uint64_t& faces, uint64_t& points) {
  if (size < 11 || std::memcmp(data, "DRACO", 5) != 0) return false;
  const uint8_t major = data[5], minor = data[6], method = data[8];
  const bool metadata = (data[10] & 0x80) != 0;
  if (metadata || major != 2 || minor < 2) return false;
  size_t at = 11;
  auto varint = [&](uint64_t& v) {
    v = 0;
    for (int shift = 0; shift < 63 && at < size; shift += 7) {
      v |= uint64_t(data[at] & 0x7f) << shift;
      if (!(data[at++] & 0x80)) return true;
    }
    return false;
  };
  if (method == 1) {
    ++at;
    return varint(points) && varint(faces);
  }                                        // edgebreaker: kind of traversal, vertices, faces
  return varint(faces) && varint(points);  // sequential
}

bool refuse(const Cursor& at, const std::string& why) {
  at.fail("Draco: " + why);
  return false;
}

}  // namespace

bool decodeDraco(Document& d, const Cursor& primitive, DracoData& out) {
  const Cursor at = primitive.extension("KHR_draco_mesh_compression"), ids = at["attributes"], attributes = primitive["attributes"];
  const int view = at["bufferView"].index("bufferViews"), corners = primitive["indices"].index("accessors"),
            positions = attributes["POSITION"].index("accessors");
  if (!ids.exists() || !ids.json->is_object()) ids.fail("attributes are missing");
  if (d.ok() && view < 0) at["bufferView"].fail("is missing");
  if (!d.ok()) return false;
  ViewBytes bytes;
  if (!viewBytes(d, view, bytes)) return false;
  const size_t vertices = positions < 0 ? 0 : accessorCount(d, positions), indices = corners < 0 ? 0 : accessorCount(d, corners);
  if (!d.account(uint64_t(vertices) * 64 + uint64_t(indices) * 16, at)) return false;  // about what the decoder holds while it works
  uint64_t faces = 0, points = 0;
  if (headerCounts(bytes.data, bytes.size, faces, points) && (faces * 3 > std::max<uint64_t>(indices, 3) || points > std::max<uint64_t>(vertices, 1)))
    return refuse(at, "the stream holds " + std::to_string(faces) + " faces and " + std::to_string(points) + " vertices, its accessors " +
                          std::to_string(indices / 3) + " and " + std::to_string(vertices));
  std::unique_ptr<draco::Mesh> mesh;
  try {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(bytes.data), bytes.size);
    draco::Decoder decoder;
    auto result = decoder.DecodeMeshFromBuffer(&buffer);
    if (!result.ok()) return refuse(at, result.status().error_msg_string());
    mesh = std::move(result).value();
  } catch (const std::bad_alloc&) { return refuse(at, "the decoder ran out of memory"); } catch (const std::exception& e) {
    return refuse(at, e.what());
  }
  if (!mesh || mesh->num_points() != vertices || (corners >= 0 && uint64_t(mesh->num_faces()) * 3 != indices))
    return refuse(at, "decoded " + std::to_string(mesh ? mesh->num_points() : 0) + " vertices and " + std::to_string(mesh ? mesh->num_faces() : 0) +
                          " faces, the accessors say " + std::to_string(vertices) + " and " + std::to_string(indices / 3));
  out.corners.resize(size_t(mesh->num_faces()) * 3);
  for (uint32_t f = 0; f < mesh->num_faces(); ++f)
    for (int k = 0; k < 3; ++k) out.corners[size_t(f) * 3 + k] = mesh->face(draco::FaceIndex(f))[k].value();
  for (const auto& [name, id] : ids.json->items()) {
    const int accessor = attributes[name.c_str()].index("accessors");
    if (accessor < 0 || !d.ok()) {
      if (d.ok()) d.warn(ids.pointer + "/" + name, "attribute is not one of the primitive's");
      continue;
    }
    const draco::PointAttribute* a =
        id.is_number_unsigned() && id.get<uint64_t>() < 1u << 30 ? mesh->GetAttributeByUniqueId(uint32_t(id.get<uint64_t>())) : nullptr;
    if (!a) return refuse(ids[name.c_str()], "no attribute has this id");
    const int components = accessorComponents(d, accessor);
    if (components < 1 || components > 4 || a->num_components() != components)
      return refuse(ids[name.c_str()], "has " + std::to_string(a->num_components()) + " components, its accessor " + std::to_string(components));
    if (!d.account(uint64_t(vertices) * size_t(components) * 4, at)) return false;
    // Whether integers stand for 0..1 is for the accessor to say.
    float scale = 1.0f;
    if (d.item("accessors", accessor)["normalized"].boolean(false) && !a->normalized())
      scale = a->data_type() == draco::DT_INT8     ? 127.0f
              : a->data_type() == draco::DT_UINT8  ? 255.0f
              : a->data_type() == draco::DT_INT16  ? 32767.0f
              : a->data_type() == draco::DT_UINT16 ? 65535.0f
                                                   : 1.0f;
    std::vector<float>& values = out.attributes[name];
    values.resize(vertices * size_t(components));
    for (uint32_t p = 0; p < vertices; ++p) {
      const draco::AttributeValueIndex value = a->mapped_index(draco::PointIndex(p));
      if (value.value() >= a->size() || !a->ConvertValue<float>(value, int8_t(components), values.data() + size_t(p) * size_t(components)))
        return refuse(ids[name.c_str()], "value of vertex " + std::to_string(p) + " cannot be read");
    }
    if (scale != 1.0f)
      for (float& v : values) v = std::fmax(v / scale, -1.0f);
  }
  return d.ok();
}

}  // namespace gobo::gltf
