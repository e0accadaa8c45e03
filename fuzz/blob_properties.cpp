// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>
#include <limits>

#include "base/utf8.h"
#include "fuzz/properties.h"
#include "scene/blob_codec.h"
#include "tests/support/blob_bytes.h"

namespace gobo::fuzz {
namespace {

/// Changes the `target`-th field of a scene, counted through the blob's own field lists; with `target` = -1 it only counts.
struct Editor {
  int64_t target = -1, count = 0;
  uint8_t how = 0;
  uint32_t value = 0;

  bool here() { return count++ == target; }
  template <typename T>
  void number(T& item) {
    if constexpr (std::is_floating_point_v<T>) {
      const float odd[] = {0,
                           -0.0f,
                           -1,
                           1e-40f,
                           3.4e38f,
                           std::numeric_limits<float>::infinity(),
                           -std::numeric_limits<float>::infinity(),
                           std::numeric_limits<float>::quiet_NaN()};
      float bits;
      std::memcpy(&bits, &value, 4);
      item = how % 2 ? odd[value % 8] : bits;
    } else {
      const uint64_t odd[] = {0, 1, 2, 3, ~0ull, 0x7fffffff, 0x80000000, 65536};
      item = T(how % 2 ? odd[value % 8] : value);
    }
  }
  template <typename T>
  void get(T& item) {
    if constexpr (std::is_same_v<T, bool>) {
      if (here()) item = !item;
    } else if constexpr (std::is_enum_v<T>) {
      if (here()) item = T(value);
    } else if constexpr (std::is_arithmetic_v<T>) {
      if (here()) number(item);
    } else if constexpr (std::is_same_v<T, Hash128>) {
      if (here()) std::memcpy(static_cast<void*>(&item), &value, 4);
    } else if constexpr (blob::isPlain<T>) {
      if (here()) number(reinterpret_cast<float*>(&item)[(how / 2) % (sizeof item / 4)]);
    } else if constexpr (std::is_same_v<T, std::string>) {
      if (here()) item = how % 4 == 0 ? "" : how % 4 == 1 ? "\xff" : std::string(value % 300, char(how));
    } else if constexpr (blob::IsArray<T>::value) {
      if (!here()) return;
      using E = typename T::value_type;
      if (how % 8 == 0) item.resize(value % 64);
      else if (how % 8 == 1) item.clear();
      else if (!item.empty()) {
        E& e = item[(how / 8) % item.size()];
        if constexpr (blob::isPlain<E>) number(reinterpret_cast<float*>(&e)[value % (sizeof e / 4)]);
        else number(e);
      }
    } else if constexpr (blob::IsVector<T>::value) {
      if (here()) {
        if (how % 3 == 0 || item.empty()) item.resize(value % 5);
        else if (how % 3 == 1) item.push_back(item[value % item.size()]);
        else item.erase(item.begin() + value % item.size());
      }
      for (auto& e : item) get(e);
    } else if constexpr (blob::IsFixed<T>::value) {
      for (auto& e : item) get(e);
    } else if constexpr (blob::IsShared<T>::value) {
      if (here()) item = nullptr;
      if (!item) return;
      const int64_t from = count;
      auto copy = std::make_shared<std::remove_const_t<typename T::element_type>>(*item);
      get(*copy);
      if (target >= from && target < count) item = std::move(copy);
    } else blob::visitStruct(item, *this);
  }
  template <typename T>
  void operator()(const char*, T& item) {
    get(item);
  }
};

/// Digests as a child would fill them in, where the fields allow it at all.
void reseal(Scene& s) {
  for (auto& mesh : s.meshes)
    if (mesh) {
      auto m = std::make_shared<Mesh>(*mesh);
      sealMesh(*m);
      mesh = m;
    }
  for (auto& texture : s.textures) {
    if (!texture) continue;
    auto t = std::make_shared<Texture>(*texture);
    const bool shape = t->width > 0 && t->height > 0 && t->width < 4096 && t->height < 4096 && t->levels >= 1 && t->levels <= kMaxTextureLevels &&
                       t->tile >= 0 && t->tile <= kMaxTextureTile;
    if (shape && t->texels8.size() + t->texelsF.size() == textureTexels(t->width, t->height, t->levels, t->tile) * 4) sealTexture(*t);
    texture = t;
  }
  if (s.environment) {
    auto e = std::make_shared<Environment>(*s.environment);
    e->content = environmentDigest(*e);
    s.environment = e;
  }
}

uint32_t word(const uint8_t* p, int bytes) {
  uint32_t v = 0;
  std::memcpy(&v, p, size_t(bytes));
  return v;
}

BlobBytes editedScene(Bytes edits, std::string& broken) {
  auto scene = std::make_shared<Scene>(*richScene());
  Editor counter;
  counter.get(*scene);
  for (size_t i = 0; i + 7 <= edits.size() && i < 7 * 12; i += 7) {
    Editor e;
    e.target = int64_t(word(&edits[i], 2)) % counter.count;
    e.how = edits[i + 2];
    e.value = word(&edits[i + 3], 4);
    e.get(*scene);
  }
  reseal(*scene);
  bool whole = true;  // the loaders' side never makes these; seal() may ask for digests
  for (const auto& m : scene->meshes) whole &= m != nullptr;
  for (const auto& t : scene->textures) whole &= t && !t->content.isZero();
  if (whole) {
    const Status sealed = scene->seal();
    if (!sealed.ok()) broken = brokenStatus(cleanUtf8(sealed), "");  // no loader lets such a name in
    else if (scene->rig) {
      auto rig = std::make_shared<Rig>(*scene->rig);
      const Status s = sealRig(*rig, *scene);
      if (s.ok()) {
        scene->rig = rig;
        (void)scene->seal();
      } else broken = brokenStatus(cleanUtf8(s), "");
    }
  }
  return blobOf(*scene);
}

}  // namespace

Outcome tryBlob(Bytes bytes) {
  Outcome out;
  if (bytes.empty()) return out;
  const Bytes rest = bytes.subspan(1);
  BlobBytes blob;
  if (bytes[0] % 3 == 0) blob.bytes.assign(rest.begin(), rest.end());
  else if (bytes[0] % 3 == 1) {
    static const BlobBytes good = blobOf(*richScene());
    blob = good;
    for (size_t i = 0; i + 3 <= rest.size() && i < 3 * 40; i += 3) blob.bytes[word(&rest[i], 2) % blob.bytes.size()] = rest[i + 2];
  } else blob = editedScene(rest, out.broken);
  if (!out.broken.empty()) return out;
  blob.mend();
  const auto scene = blob.scene(BlobTrust::Foreign);
  const auto own = blob.scene(BlobTrust::Own);
  if (!scene.ok()) {
    out.said = scene.status().toString();
    if (scene.status().code() != Code::DataLoss || scene.status().message().empty()) out.broken = "refused blob is no DataLoss: " + out.said;
    return out;
  }
  out.accepted = true;
  if (!own.ok() || (*own)->hash() != (*scene)->hash()) {
    out.broken = "accepted as foreign but not as own";
    return out;
  }
  out.broken = brokenValues(**scene);
  if (out.broken.empty()) out.broken = brokenPoses(*scene);
  if (out.broken.empty()) {
    BlobBytes again = blobOf(**scene);
    const auto back = again.scene(BlobTrust::Foreign);
    if (!back.ok() || (*back)->hash() != (*scene)->hash()) out.broken = "written again it is another scene";
  }
  for (const auto& t : (*scene)->textures)
    for (int level = 0; level < t->levels; ++level)
      for (const Vec2 uv : {Vec2(0, 0), Vec2(0.999f, 0.5f), Vec2(-1e30f, 1e30f), Vec2(0.5f, 1)}) {
        const Vec4 v = t->sampleLevel(uv, level);
        if (!std::isfinite(v.x + v.y + v.z + v.w)) out.broken = "a texture look-up is not finite";
      }
  return out;
}

}  // namespace gobo::fuzz
