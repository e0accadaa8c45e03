// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdlib>
#include <iostream>

#include "base/utf8.h"
#include "fuzz/properties.h"
#include "scene/blob_codec.h"
#include "tests/support/blob_bytes.h"

namespace gobo::fuzz {
namespace {

/// Every field of a scene, by the blob's own field lists.
struct Values {
  std::string broken, place;

  void wrong(const std::string& what) {
    if (broken.empty()) broken = place + " " + what;
  }
  template <typename F>
  void number(const F* p, size_t n) {
    for (size_t i = 0; i < n; ++i)
      if (!std::isfinite(p[i])) return wrong("is not finite at " + std::to_string(i));
  }
  template <typename T>
  void get(const T& item) {
    if constexpr (std::is_same_v<T, float>) number(&item, 1);
    else if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T> || std::is_same_v<T, Hash128>) {
    } else if constexpr (std::is_same_v<T, DVec3> || std::is_same_v<T, DMat4>) number(reinterpret_cast<const double*>(&item), sizeof item / 8);
    else if constexpr (blob::isPlain<T>) number(reinterpret_cast<const float*>(&item), sizeof item / 4);
    else if constexpr (std::is_same_v<T, std::string>) {
      if (!isUtf8(item)) wrong("is not UTF-8");
    } else if constexpr (blob::IsArray<T>::value) {
      using E = typename T::value_type;
      if constexpr (std::is_same_v<E, float> || blob::isPlain<E>) number(reinterpret_cast<const float*>(item.data()), item.size() * sizeof(E) / 4);
    } else if constexpr (blob::IsVector<T>::value || blob::IsFixed<T>::value) {
      for (const auto& e : item) get(e);
    } else if constexpr (blob::IsShared<T>::value) {
      if (item) get(*item);
    } else blob::visitStruct(item, *this);
  }
  template <typename T>
  void operator()(const char* name, const T& item) {
    place = name;
    get(item);
  }
};

}  // namespace

void demand(const Outcome& outcome) {
  if (outcome.broken.empty()) return;
  std::cerr << "property broken: " << outcome.broken << std::endl;
  std::abort();
}

std::string brokenStatus(const Status& s, std::string_view place) {
  const std::string shown = s.toString();
  if (s.ok()) return "an error is OK";
  if (s.code() == Code::Unknown || s.code() == Code::Internal) return "blames itself: " + shown;
  if (s.message().empty()) return "says nothing: " + shown;
  if (s.location().empty() || s.location().compare(0, place.size(), place) != 0) return "does not say where: " + shown;
  if (!isUtf8(s.message()) || !isUtf8(s.location())) return "is not UTF-8: " + cleanUtf8(shown);
  return {};
}

std::string brokenValues(const Scene& scene) {
  Values v;
  v.get(scene);
  return v.broken;
}

std::string brokenBlob(const Scene& scene) {
  const BlobBytes first = blobOf(scene);
  if (first.bytes.empty()) return "no blob could be written";
  const auto back = first.scene(BlobTrust::Foreign);
  if (!back.ok()) return "its blob is refused: " + back.status().toString();
  if ((*back)->hash() != scene.hash()) return "its blob has another hash";
  if (blobOf(**back).bytes != first.bytes) return "its blob, read and written again, is another";
  if (const auto own = first.scene(BlobTrust::Own); !own.ok() || (*own)->hash() != scene.hash()) return "its blob is refused as our own";
  return {};
}

std::string brokenPoses(const ScenePtr& scene) {
  const auto check = [](const Result<ScenePtr>& posed, const std::string& what) -> std::string {
    if (!posed.ok()) return posed.status().code() == Code::Internal || posed.status().message().empty() ? what + ": " + posed.status().toString() : "";
    const std::string broken = brokenValues(**posed);
    return broken.empty() ? "" : what + ": " + broken;
  };
  if (scene->rig)
    for (size_t i = 0; i < scene->rig->animations.size() && i < 4; ++i) {
      const RigAnimation& a = scene->rig->animations[i];
      for (const double t : {double(a.start), 0.4 * a.start + 0.6 * a.end, double(a.end)})
        if (std::string s = check(posedScene(scene, a.name, t), "animation at " + std::to_string(t)); !s.empty()) return s;
    }
  for (size_t i = 0; i < scene->variants.names.size() && i < 4; ++i)
    if (std::string s = check(withVariant(scene, scene->variants.names[i]), "variant"); !s.empty()) return s;
  return {};
}

}  // namespace gobo::fuzz
