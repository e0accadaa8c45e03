// SPDX-License-Identifier: Apache-2.0
// Term: an immutable typed value of a node: named planes over a domain. What a plan's edges carry and what the store keeps.
// Layout: a plane holds extent.elements() * channels scalars, channels interleaved. View-sample domains are layer-major:
// element = (layer * height + y) * width + x, so that each layer is an image. Thread-safe to read.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/check.h"
#include "base/hash.h"

namespace gobo {
inline namespace terms {

enum class Domain : uint8_t { Pixel, ViewSample, LightTexel, SparsePixel, List, Table };
enum class Format : uint8_t { F32, F64, U32, U8 };
size_t formatSize(Format format);
template <typename T>
constexpr Format formatOf();
template <>
constexpr Format formatOf<float>() {
  return Format::F32;
}
template <>
constexpr Format formatOf<double>() {
  return Format::F64;
}
template <>
constexpr Format formatOf<uint32_t>() {
  return Format::U32;
}
template <>
constexpr Format formatOf<uint8_t>() {
  return Format::U8;
}

struct Extent {
  int width = 0, height = 1, layers = 1;
  size_t elements() const { return size_t(width) * height * layers; }
  bool operator==(const Extent&) const = default;
};

/// Zeroed memory whose pages the system hands out on first touch: a term of hundreds of MB costs nothing until the threads
/// that fill it do so, in parallel and between polls of the stop flag (a memset up front held the cores for half a second). From 4 MB on
/// in huge pages where the system gives them (faults of 4 KiB took longer than a whole pass over a term), and from a pool of blocks
/// given back before: the system clears pages more slowly than any node fills them.
class ZeroedBytes {
 public:
  ZeroedBytes() = default;
  explicit ZeroedBytes(size_t size, bool zeroed = true);  ///< throws std::bad_alloc, which the executor turns into ResourceExhausted
  ZeroedBytes(const ZeroedBytes& other);
  ZeroedBytes(ZeroedBytes&&) = default;
  ZeroedBytes& operator=(ZeroedBytes other) {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(fresh_, other.fresh_);
    return *this;
  }
  bool operator==(const ZeroedBytes& other) const { return size_ == other.size_ && std::equal(begin(), end(), other.begin()); }
  uint8_t* data() { return data_.get(); }
  const uint8_t* data() const { return data_.get(); }
  size_t size() const { return size_; }
  bool fresh() const { return fresh_; }  ///< mapped for this, so that whoever filled it waited for the system; else from the pool, or small
  uint8_t& operator[](size_t i) { return data()[i]; }
  uint8_t operator[](size_t i) const { return data()[i]; }
  uint8_t* begin() { return data(); }
  const uint8_t* begin() const { return data(); }
  const uint8_t* end() const { return data() + size_; }

 private:
  struct Free {
    size_t mapped;  ///< bytes to unmap; 0: from calloc
    Free() : mapped(0) {}
    explicit Free(size_t bytes) : mapped(bytes) {}
    void operator()(uint8_t* p) const;
  };
  std::unique_ptr<uint8_t, Free> data_;
  size_t size_ = 0;
  bool fresh_ = false;
};

/// What Term::bytes() counts beside the planes' values: of a plane, and of a term of up to 16 planes.
inline constexpr size_t kPlaneBytes = 64, kTermBytes = 256 + 16 * kPlaneBytes;

struct Plane {
  std::string name;  ///< "P", "N", "V", "sum", ...
  Format format = Format::F32;
  int channels = 1;
  ZeroedBytes bytes;
};

class Term {
 public:
  Term(std::string type, Domain domain, Extent extent) : type_(std::move(type)), domain_(domain), extent_(extent) {}

  const std::string& type() const { return type_; }
  Domain domain() const { return domain_; }
  const Extent& extent() const { return extent_; }
  size_t bytes() const;
  size_t freshBytes() const;  ///< of its large planes those whose memory was not used before
  const std::vector<Plane>& planes() const { return planes_; }
  bool hasPlane(std::string_view name) const { return find(name) != nullptr; }
  int channels(std::string_view name) const { return need(name).channels; }

  /// Read a plane; CHECKs name and scalar type.
  template <typename T>
  std::span<const T> plane(std::string_view name) const {
    const Plane& p = need(name);
    GOBO_CHECK(p.format == formatOf<T>());
    return {reinterpret_cast<const T*>(p.bytes.data()), p.bytes.size() / sizeof(T)};
  }
  std::span<const float> floats(std::string_view name) const { return plane<float>(name); }

  /// Building side (before the term is shared): adds a zeroed plane and returns it for writing.
  template <typename T>
  std::span<T> addPlane(std::string name, int channels = 1) {
    Plane& p = addRaw(std::move(name), formatOf<T>(), channels);
    return {reinterpret_cast<T*>(p.bytes.data()), p.bytes.size() / sizeof(T)};
  }
  /// The same with whatever was in memory before: for nodes that write every element, some 10 ms a 100 MB faster.
  template <typename T>
  std::span<T> addUnsetPlane(std::string name, int channels = 1) {
    Plane& p = addRaw(std::move(name), formatOf<T>(), channels, /*zeroed=*/false);
    return {reinterpret_cast<T*>(p.bytes.data()), p.bytes.size() / sizeof(T)};
  }
  template <typename T>
  std::span<T> writable(std::string_view name) {
    Plane& p = const_cast<Plane&>(need(name));
    GOBO_CHECK(p.format == formatOf<T>());
    return {reinterpret_cast<T*>(p.bytes.data()), p.bytes.size() / sizeof(T)};
  }
  /// Of a plane of any format; CHECKs the name.
  uint8_t* bytesOf(std::string_view name) { return const_cast<Plane&>(need(name)).bytes.data(); }
  Plane& addRaw(std::string name, Format format, int channels, bool zeroed = true);

  /// Digest of type, extent and every plane; computed once, on first use.
  Hash128 content() const;

 private:
  const Plane* find(std::string_view name) const;
  const Plane& need(std::string_view name) const;
  std::string type_;
  Domain domain_;
  Extent extent_;
  std::vector<Plane> planes_;
  mutable std::once_flag once_;
  mutable Hash128 content_;
};
using TermPtr = std::shared_ptr<const Term>;

}  // namespace terms
}  // namespace gobo
