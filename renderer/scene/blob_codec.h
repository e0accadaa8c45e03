// SPDX-License-Identifier: Apache-2.0
// Internal to the scene blob: the three visitors that walk field lists. Writer: records and the list of arrays. Reader: the
// reverse, checked. Format: the digest of the lists themselves. What each does with a type is side by side here:
//   bool, numbers, enumerations   their bytes; bool 0 or 1, enumerators up to lastOf<E>
//   vectors, matrices, Hash128    their bytes
//   std::string                   u32 length, bytes
//   Array<T>                      u64 offset from the first array, u64 count
//   std::vector<T>                u32 count, elements
//   std::array<T, n>              n elements
//   std::shared_ptr<const T>      u8 present, T
//   struct                        its field list; Material and Camera with their name, Rig with its digest first
#pragma once

#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "base/utf8.h"
#include "scene/blob_fields.h"

namespace gobo::blob {

/// Structs whose field list does not name all their members (blob_format.cpp); empty when every list is complete.
std::string forgottenFields();

template <typename E>
inline constexpr E lastOf = E(0);
template <>
inline constexpr Wrap lastOf<Wrap> = Wrap::Mirror;
template <>
inline constexpr AlphaMode lastOf<AlphaMode> = AlphaMode::Blend;
template <>
inline constexpr LightKind lastOf<LightKind> = LightKind::Environment;
template <>
inline constexpr ProfileKind lastOf<ProfileKind> = ProfileKind::Photometry;
template <>
inline constexpr RigKind lastOf<RigKind> = RigKind::Light;
template <>
inline constexpr RigPath lastOf<RigPath> = RigPath::Weights;
template <>
inline constexpr RigInterpolation lastOf<RigInterpolation> = RigInterpolation::CubicSpline;

template <typename T>
struct IsVector : std::false_type {};
template <typename T>
struct IsVector<std::vector<T>> : std::true_type {};
template <typename T>
struct IsArray : std::false_type {};
template <typename T>
struct IsArray<Array<T>> : std::true_type {};
template <typename T>
struct IsFixed : std::false_type {};
template <typename T, size_t n>
struct IsFixed<std::array<T, n>> : std::true_type {};
template <typename T>
struct IsShared : std::false_type {};
template <typename T>
struct IsShared<std::shared_ptr<const T>> : std::true_type {};
/// A GLM vector or matrix or a digest: stored as it lies in memory.
template <typename T>
inline constexpr bool isPlain = std::is_same_v<T, Hash128> || std::is_same_v<T, Vec2> || std::is_same_v<T, Vec3> || std::is_same_v<T, Vec4> ||
                                std::is_same_v<T, Mat4> || std::is_same_v<T, DVec3> || std::is_same_v<T, DMat4>;

template <typename T, typename V>
void visitStruct(T& item, V&& v) {
  if constexpr (Same<T, Material> || Same<T, Camera>) visitNamed(item, v);
  else if constexpr (Same<T, Rig>) visitSealed(item, v);
  else visitFields(item, v);
}

struct Format {
  Hasher hash{"scene-blob"};
  template <typename T>
  void type() {
    if constexpr (std::is_arithmetic_v<T>)
      hash.add(std::is_floating_point_v<T> ? "f" : std::is_same_v<T, bool> ? "b" : std::is_signed_v<T> ? "i" : "u").add(uint32_t(sizeof(T)));
    else if constexpr (std::is_enum_v<T>) hash.add("e").add(uint32_t(sizeof(T))).add(uint32_t(lastOf<T>));
    else if constexpr (isPlain<T>) hash.add("p").add(uint32_t(sizeof(T)));
    else if constexpr (std::is_same_v<T, std::string>) hash.add("s");
    else if constexpr (IsVector<T>::value || IsArray<T>::value) {
      hash.add(IsArray<T>::value ? "A" : "v");
      type<typename T::value_type>();
    } else if constexpr (IsFixed<T>::value) {
      hash.add("x").add(uint32_t(std::tuple_size_v<T>));
      type<typename T::value_type>();
    } else if constexpr (IsShared<T>::value) {
      hash.add("?");
      type<std::remove_const_t<typename T::element_type>>();
    } else {
      T item;
      hash.add("{");
      visitStruct(item, *this);
      hash.add("}");
    }
  }
  template <typename T>
  void operator()(const char* name, const T&) {
    hash.add(name);
    type<std::remove_cvref_t<T>>();
  }
};

struct Writer {
  std::vector<uint8_t> records;
  struct Piece {
    const void* data;
    uint64_t bytes, offset;
  };
  std::vector<Piece> pieces;
  uint64_t arrayBytes = 0;
  std::map<std::pair<const void*, uint64_t>, uint64_t> known;  // arrays that copies share are written once

  void raw(const void* data, size_t bytes) {
    const auto* p = static_cast<const uint8_t*>(data);
    records.insert(records.end(), p, p + bytes);
  }
  template <typename T>
  void put(const T& item) {
    if constexpr (std::is_same_v<T, bool>) {
      const uint8_t b = item ? 1 : 0;
      raw(&b, 1);
    } else if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T> || isPlain<T>) raw(&item, sizeof item);
    else if constexpr (std::is_same_v<T, std::string>) {
      put(uint32_t(item.size()));
      raw(item.data(), item.size());
    } else if constexpr (IsArray<T>::value) {
      const uint64_t bytes = uint64_t(item.size()) * sizeof(typename T::value_type);
      uint64_t at = 0;
      if (bytes > 0) {
        const auto [it, fresh] = known.try_emplace({item.data(), bytes}, arrayBytes);
        at = it->second;
        if (fresh) {
          pieces.push_back({item.data(), bytes, at});
          arrayBytes = (at + bytes + 63) & ~uint64_t(63);
        }
      }
      put(at);
      put(uint64_t(item.size()));
    } else if constexpr (IsVector<T>::value) {
      put(uint32_t(item.size()));
      for (const auto& e : item) put(e);
    } else if constexpr (IsFixed<T>::value) {
      for (const auto& e : item) put(e);
    } else if constexpr (IsShared<T>::value) {
      put(item != nullptr);
      if (item) put(*item);
    } else visitStruct(item, *this);
  }
  template <typename T>
  void operator()(const char*, const T& item) {
    put(item);
  }
};

struct Reader {
  std::shared_ptr<const void> owner;
  std::span<const uint8_t> records, arrays;
  size_t at = 0;
  std::string problem;  ///< the first one; every read after it gives zeroes
  std::string place;    ///< name of the field being read

  bool fail(const std::string& what) {
    if (problem.empty()) problem = place + ": " + what;
    at = records.size();
    return false;
  }
  bool raw(void* to, size_t bytes) {
    if (bytes > records.size() - at || !problem.empty()) return fail("records are cut short");
    std::memcpy(to, records.data() + at, bytes);
    at += bytes;
    return true;
  }
  template <typename T>
  void get(T& item) {
    if constexpr (std::is_same_v<T, bool>) {
      uint8_t b = 0;
      if (raw(&b, 1) && b > 1) fail("bool is " + std::to_string(b));
      item = b == 1;
    } else if constexpr (std::is_enum_v<T>) {
      static_assert(lastOf<T> != T(0), "say which enumerator is the last");
      std::underlying_type_t<T> v = 0;
      if (raw(&v, sizeof v) && (v < 0 || v > std::underlying_type_t<T>(lastOf<T>))) {
        fail("enumerator is " + std::to_string(v));
        v = 0;
      }
      item = T(v);
    } else if constexpr (std::is_arithmetic_v<T> || isPlain<T>) {
      if (!raw(&item, sizeof item)) item = T();
    } else if constexpr (std::is_same_v<T, std::string>) {
      uint32_t n = 0;
      get(n);
      if (n > records.size() - at) {
        fail("string of " + std::to_string(n) + " bytes does not fit");
        return;
      }
      item.assign(reinterpret_cast<const char*>(records.data() + at), n);
      at += n;
      if (!isUtf8(item)) fail("string is not UTF-8");
    } else if constexpr (IsArray<T>::value) {
      using E = typename T::value_type;
      uint64_t offset = 0, count = 0;
      get(offset);
      get(count);
      if (count == 0) {
        item.clear();
        return;
      }
      if (offset % 64 != 0 || offset > arrays.size() || count > (arrays.size() - offset) / sizeof(E)) {
        fail("array of " + std::to_string(count) + " at " + std::to_string(offset) + " does not fit " + std::to_string(arrays.size()) + " bytes");
        return;
      }
      item = T(owner, std::span<const E>(reinterpret_cast<const E*>(arrays.data() + offset), size_t(count)));
    } else if constexpr (IsVector<T>::value) {
      uint32_t n = 0;
      get(n);
      if (n > records.size() - at) {
        fail("list of " + std::to_string(n) + " does not fit");
        return;
      }  // an element is a byte at least
      item.clear();
      for (uint32_t i = 0; i < n && problem.empty(); ++i) {
        item.emplace_back();
        get(item.back());
        if constexpr (IsShared<typename T::value_type>::value) {
          if (!item.back()) fail("element " + std::to_string(i) + " is missing");
        }
      }
    } else if constexpr (IsFixed<T>::value) {
      for (auto& e : item) get(e);
    } else if constexpr (IsShared<T>::value) {
      bool present = false;
      get(present);
      item = nullptr;
      if (!present) return;
      auto made = std::make_shared<std::remove_const_t<typename T::element_type>>();
      get(*made);
      item = std::move(made);
    } else visitStruct(item, *this);
  }
  template <typename T>
  void operator()(const char* name, T& item) {
    place = name;
    get(item);
  }
};

}  // namespace gobo::blob
