// SPDX-License-Identifier: Apache-2.0
// Accessors: every read is proved inside its view and the view inside its buffer, in 64-bit arithmetic, before it happens.
#include <cstring>

#include "import/gltf/document.h"

namespace gobo::gltf {
namespace {

struct Span {
  const uint8_t* data = nullptr;
  size_t stride = 0;
};

struct Accessor {
  Cursor at;
  size_t count = 0;
  int component = 0, components = 0;
  size_t rows = 0, column = 0;  // matrices with padded columns: numbers a column, bytes a column; else 0
  bool normalised = false;
  Span dense;  // data null: zeros
  size_t sparseCount = 0;
  int sparseComponent = 0;
  Span sparseIndices, sparseValues;
};

size_t componentSize(int64_t type) {
  switch (type) {
    case 5120:
    case 5121: return 1;
    case 5122:
    case 5123: return 2;
    case 5125:
    case 5126: return 4;
    default: return 0;
  }
}

int componentsOf(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "VEC4" || type == "MAT2") return 4;
  if (type == "MAT3") return 9;
  if (type == "MAT4") return 16;
  return 0;
}

constexpr int64_t kMaxOffset = int64_t(1) << 48;

/// `count` elements of `size` bytes from `offset` of the view that `view` names.
Span range(Document& d, const Cursor& view, int64_t offset, uint64_t count, size_t size, bool strided) {
  const int index = view.index("bufferViews");
  if (index < 0) {
    if (!view.exists()) view.fail("bufferView is missing");
    return {};
  }
  ViewBytes bytes;
  if (!viewBytes(d, index, bytes)) return {};
  const Cursor v = d.item("bufferViews", index);
  const uint64_t stride = strided && bytes.stride ? bytes.stride : size;
  if (stride < size) {
    v["byteStride"].fail("stride " + std::to_string(stride) + " is less than an element of " + std::to_string(size) + " bytes");
    return {};
  }
  // offset < 2^48, count <= 2^32, stride <= 2^20: the sum stays below 2^53.
  const uint64_t need = count == 0 ? 0 : uint64_t(offset) + (count - 1) * stride + size;
  if (need > bytes.size) {
    view.fail("accessor needs " + std::to_string(need) + " bytes but bufferView " + std::to_string(index) + " has " + std::to_string(bytes.size));
    return {};
  }
  return {bytes.data + offset, size_t(stride)};
}

/// Bytes from one column of a matrix to the next: columns of 1- and 2-byte components start at multiples of 4.
size_t columnStride(const std::string& type, size_t unit) {
  if (type == "MAT2") return std::max<size_t>(2 * unit, unit == 1 ? 4 : 0);
  if (type == "MAT3") return unit == 4 ? 12 : unit == 2 ? 8 : 4;
  return 0;
}

bool open(Document& d, int index, Accessor& a) {
  a.at = d.item("accessors", index);
  const Cursor type = a.at["type"], component = a.at["componentType"], count = a.at["count"];
  for (const Cursor* c : {&type, &component, &count})
    if (!c->exists()) c->fail("is missing");
  a.component = int(component.integer(0, 0, 1 << 20));
  a.components = componentsOf(type.text());
  a.count = size_t(count.integer(1, 1, int64_t(1) << 32));
  a.normalised = a.at["normalized"].boolean(false);
  const int64_t offset = a.at["byteOffset"].integer(0, 0, kMaxOffset);
  const size_t unit = componentSize(a.component);
  if (unit == 0) component.fail("componentType " + std::to_string(a.component) + " is unknown");
  if (a.components == 0) type.fail("type is unknown");
  if (!d.ok()) return false;
  a.column = columnStride(type.text(), unit);
  a.rows = type.text() == "MAT2" ? 2 : 3;
  if (a.column == a.rows * unit) a.column = 0;
  // The last column of a padded matrix need not be padded.
  const size_t size = a.column ? a.column * (a.components / a.rows - 1) + a.rows * unit : unit * size_t(a.components);
  const Cursor view = a.at["bufferView"], sparse = a.at["sparse"];
  if (view.exists()) a.dense = range(d, view, offset, a.count, size, true);
  else if (a.count > (1u << 24)) count.fail("an accessor without bytes has more than 2^24 elements");
  if (sparse.exists() && d.ok()) {
    a.sparseCount = size_t(sparse["count"].integer(0, 1, int64_t(a.count)));
    const Cursor indices = sparse["indices"], values = sparse["values"];
    a.sparseComponent = int(indices["componentType"].integer(0, 0, 1 << 20));
    if (a.sparseComponent != 5121 && a.sparseComponent != 5123 && a.sparseComponent != 5125) indices["componentType"].fail("is not an unsigned integer type");
    if (!d.ok()) return false;
    a.sparseIndices = range(d, indices["bufferView"], indices["byteOffset"].integer(0, 0, kMaxOffset), a.sparseCount, componentSize(a.sparseComponent), false);
    a.sparseValues = range(d, values["bufferView"], values["byteOffset"].integer(0, 0, kMaxOffset), a.sparseCount, size, false);
  }
  return d.ok();
}

template <typename T>
T load(const uint8_t* p) {
  T v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

uint32_t loadIndex(const uint8_t* p, int component) { return component == 5121 ? *p : component == 5123 ? load<uint16_t>(p) : load<uint32_t>(p); }

float loadFloat(const uint8_t* p, int component, bool normalised) {
  switch (component) {
    case 5120: {
      const float v = load<int8_t>(p);
      return normalised ? std::fmax(v / 127.0f, -1.0f) : v;
    }
    case 5121: {
      const float v = *p;
      return normalised ? v / 255.0f : v;
    }
    case 5122: {
      const float v = load<int16_t>(p);
      return normalised ? std::fmax(v / 32767.0f, -1.0f) : v;
    }
    case 5123: {
      const float v = load<uint16_t>(p);
      return normalised ? v / 65535.0f : v;
    }
    case 5125: return float(load<uint32_t>(p));
    default: return load<float>(p);
  }
}

/// Calls put(element, bytes) for the dense part, then for the sparse replacements.
template <typename Put>
bool forEach(Document& d, const Accessor& a, Put put) {
  if (a.dense.data)
    for (size_t i = 0; i < a.count; ++i) put(i, a.dense.data + i * a.dense.stride);
  uint32_t before = 0;
  for (size_t k = 0; k < a.sparseCount; ++k) {
    const uint32_t i = loadIndex(a.sparseIndices.data + k * a.sparseIndices.stride, a.sparseComponent);
    if (k && i <= before)
      d.warnOnce(a.at["sparse"]["indices"].pointer,
                 "sparse index " + std::to_string(i) + " at " + std::to_string(k) + " does not follow " + std::to_string(before) + "; the last value counts");
    before = i;
    if (i >= a.count) {
      a.at["sparse"]["indices"].fail("sparse index " + std::to_string(i) + " of " + std::to_string(a.count) + " elements is out of range");
      return false;
    }
    put(i, a.sparseValues.data + k * a.sparseValues.stride);
  }
  return d.ok();
}

/// Compares the accessor's stated bounds with its data, as the format demands; loaders trust the data.
struct BoundsCheck {
  BoundsCheck(Document& d, int index, const Accessor& a) : at(a.at), components(size_t(a.components)) {
    if (!d.boundsSeen.insert(index).second || components > 4 || (!a.dense.data && a.sparseCount == 0)) {
      components = 0;
      return;
    }
    for (size_t c = 0; c < components; ++c) {
      lo[c] = std::numeric_limits<float>::infinity();
      hi[c] = -lo[c];
    }
  }
  void see(const float* v) {
    for (size_t c = 0; c < components; ++c) {
      lo[c] = std::fmin(lo[c], v[c]);
      hi[c] = std::fmax(hi[c], v[c]);
    }
  }  // NaN is said elsewhere
  void finish(Document& d, float scale) const {
    for (const auto& [name, seen] : {std::pair{"min", lo}, std::pair{"max", hi}}) {
      const Cursor stated = at[name];
      if (components == 0 || !stated.exists()) continue;
      if (!stated.json->is_array() || stated.json->size() != components) {
        d.warn(stated.pointer, "is not an array of " + std::to_string(components) + " numbers");
        continue;
      }
      for (size_t c = 0; c < components; ++c) {
        const Json& value = (*stated.json)[c];
        const float said = value.is_number() ? float(value.get<double>()) : seen[c];
        if (said == seen[c] || (std::isfinite(seen[c]) && std::fabs(said - seen[c]) <= 1e-6f * std::fabs(seen[c]) * scale)) continue;
        d.warn(stated.pointer + "/" + std::to_string(c), "says " + value.dump() + " but the data have " + std::to_string(seen[c]) + "; the data count");
      }
    }
  }
  Cursor at;
  size_t components;
  float lo[4] = {}, hi[4] = {};
};

/// Vertex data that the format aligns to 4 bytes, and indices that may not be strided.
void warnLayout(Document& d, const Accessor& a, size_t unit) {
  const Cursor view = a.at["bufferView"];
  if (!view.exists()) return;
  const int64_t offset = a.at["byteOffset"].integer(0, 0, kMaxOffset),
                start = d.item("bufferViews", view.index("bufferViews"))["byteOffset"].integer(0, 0, kMaxOffset);
  if (offset % int64_t(unit))
    d.warn(a.at["byteOffset"].pointer, "offset " + std::to_string(offset) + " is no multiple of a component's " + std::to_string(unit) + " bytes");
  else if ((start + offset) % int64_t(unit))
    d.warn(a.at.pointer, "data begin at byte " + std::to_string(start + offset) + ", no multiple of a component's " + std::to_string(unit) + " bytes");
}

template <typename Out>
bool readUnsigned(Document& d, int index, int components, std::vector<Out>& out) {
  Accessor a;
  if (!open(d, index, a)) return false;
  if (a.components != components) {
    a.at["type"].fail(components == 1 ? "indices are not SCALAR"
                                      : "accessor has " + std::to_string(a.components) + " components, not " + std::to_string(components));
    return false;
  }
  if (a.component != 5121 && a.component != 5123 && a.component != 5125) {
    a.at["componentType"].fail("indices are not of an unsigned integer type");
    return false;
  }
  if (!d.account(uint64_t(a.count) * size_t(components) * 4, a.at)) return false;
  out.assign(a.count * size_t(components), 0);
  const size_t unit = componentSize(a.component);
  warnLayout(d, a, unit);
  BoundsCheck bounds(d, index, a);
  float raw[4];
  const bool done = forEach(d, a, [&](size_t i, const uint8_t* p) {
    for (int c = 0; c < components; ++c) out[i * size_t(components) + c] = loadIndex(p + c * unit, a.component);
  });
  for (size_t i = 0; i < a.count && components <= 4; ++i) {
    for (int c = 0; c < components; ++c) raw[c] = float(out[i * size_t(components) + c]);
    bounds.see(raw);
  }
  if (done) bounds.finish(d, 1.0f);
  return done;
}

}  // namespace

bool viewBytes(Document& d, int index, ViewBytes& out) {
  const Cursor v = d.item("bufferViews", index);
  if (!v["buffer"].exists()) v["buffer"].fail("buffer is missing");
  if (!v["byteLength"].exists()) v["byteLength"].fail("byteLength is missing");
  const int buffer = v["buffer"].index("buffers");
  const uint64_t start = uint64_t(v["byteOffset"].integer(0, 0, kMaxOffset)), length = uint64_t(v["byteLength"].integer(0, 0, kMaxOffset));
  out.stride = uint64_t(v["byteStride"].integer(0, 1, 1 << 20));
  if (!d.ok() || buffer < 0) return false;
  if (v["extensions"].exists() && v.extension("EXT_meshopt_compression").exists()) {
    const auto known = d.unpacked.find(index);
    if (known == d.unpacked.end() && !unpackView(d, v.extension("EXT_meshopt_compression"), length, d.unpacked[index])) return false;
    out.data = d.unpacked[index].data();
    out.size = d.unpacked[index].size();
    return true;
  }
  const uint64_t available = d.buffers[buffer].size();
  if (start + length > available) {
    v.fail("bytes " + std::to_string(start) + " + " + std::to_string(length) + " are outside buffer " + std::to_string(buffer) + " of " +
           std::to_string(available) + " bytes");
    return false;
  }
  out.data = d.buffers[buffer].data() + start;
  out.size = length;
  return true;
}

bool readFloats(Document& d, int index, int components, std::vector<float>& out) {
  Accessor a;
  if (!open(d, index, a)) return false;
  if (a.components != components) {
    a.at["type"].fail("accessor has " + std::to_string(a.components) + " components, not " + std::to_string(components));
    return false;
  }
  if (!d.account(uint64_t(a.count) * components * sizeof(float), a.at)) return false;
  out.assign(a.count * size_t(components), 0.0f);
  const size_t unit = componentSize(a.component);
  warnLayout(d, a, unit);
  const bool done = forEach(d, a, [&](size_t i, const uint8_t* p) {
    for (int c = 0; c < components; ++c) {
      const size_t at = a.column ? size_t(c) / a.rows * a.column + size_t(c) % a.rows * unit : size_t(c) * unit;
      out[i * size_t(components) + c] = loadFloat(p + at, a.component, a.normalised);
    }
  });
  if (done && a.component == 5126 && !d.boundsSeen.count(index))
    for (size_t k = 0; k < out.size(); ++k)
      if (!std::isfinite(out[k])) {
        d.warn(a.at.pointer, "number " + std::to_string(k) + " of the accessor is " + (std::isnan(out[k]) ? "NaN" : "infinite"));
        break;
      }
  BoundsCheck bounds(d, index, a);
  if (!done || bounds.components == 0 || !(a.at["min"].exists() || a.at["max"].exists())) return done;
  // Bounds are those of the stored numbers, before normalisation.
  const float scale = !a.normalised         ? 1.0f
                      : a.component == 5120 ? 127.0f
                      : a.component == 5121 ? 255.0f
                      : a.component == 5122 ? 32767.0f
                      : a.component == 5123 ? 65535.0f
                                            : 1.0f;
  float raw[4];
  for (size_t i = 0; i < a.count; ++i) {
    for (int c = 0; c < components; ++c) raw[c] = scale == 1.0f ? out[i * size_t(components) + c] : std::round(out[i * size_t(components) + c] * scale);
    bounds.see(raw);
  }
  bounds.finish(d, scale == 1.0f ? 1.0f : 1e6f);
  return done;
}

bool readIndices(Document& d, int index, std::vector<uint32_t>& out) { return readUnsigned(d, index, 1, out); }
bool readIntegers(Document& d, int index, int components, std::vector<uint32_t>& out) { return readUnsigned(d, index, components, out); }

size_t accessorCount(Document& d, int index) { return size_t(d.item("accessors", index)["count"].integer(0, 0, int64_t(1) << 32)); }
int accessorComponents(Document& d, int index) { return componentsOf(d.item("accessors", index)["type"].text()); }

void auditBounds(Document& d) {
  const Cursor list = d.list("accessors");
  uint64_t seen = 0;
  for (size_t i = 0; i < list.size() && d.ok() && seen < (64u << 20); ++i) {  // accessors may overlap: the work is bounded, not only the memory
    if (d.boundsSeen.count(int(i))) continue;
    std::vector<float> values;
    const int components = accessorComponents(d, int(i));
    const uint64_t before = d.bytesUsed;
    if (components && readFloats(d, int(i), components, values)) seen += values.size() * 4;
    d.bytesUsed = before;  // nothing is kept
    if (d.ok()) continue;  // nothing reads it: no reason to refuse the file
    d.warn(list.at(i).pointer, d.status.message() + " (nothing uses it)");
    d.status = Status();
  }
}

}  // namespace gobo::gltf
