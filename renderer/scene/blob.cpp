// SPDX-License-Identifier: Apache-2.0
// Header, and what a foreign blob is checked for beyond its records. See blob.h and docs/scene_blob.md.
#include "scene/blob.h"

#include <algorithm>

#include "base/check.h"
#include "base/mapped_file.h"
#include "scene/blob_codec.h"
#include "scene/texture_seal.h"

namespace gobo {
inline namespace scene {
namespace {

enum class Kind : uint32_t { Scene = 1, Environment = 2 };

struct Header {
  char magic[8];
  uint32_t version, endian, kind, headerBytes;
  uint64_t total;
  Hash128 format;
  BlobKey key;
  uint64_t recordBytes, arrayStart;
  Hash128 records, arrays, self;  // self: digest of the bytes before it
};
static_assert(sizeof(Header) == kBlobHeaderBytes && std::is_trivially_copyable_v<Header>);
constexpr char kMagic[8] = {'G', 'O', 'B', 'O', 'B', 'L', 'O', 'B'};
constexpr uint32_t kEndian = 0x01020304;
constexpr const char* kOtherFields = "made by a build with other fields";
constexpr size_t kSelfAt = kBlobHeaderBytes - sizeof(Hash128);

constexpr size_t kSlice = size_t(4) << 20;  // of the arrays; each has a digest, and theirs is the one in the header

/// Digest of arrays that come in pieces of any size.
class SliceDigest {
 public:
  void add(const void* data, size_t bytes) {
    const auto* p = static_cast<const uint8_t*>(data);
    while (bytes > 0) {
      const size_t n = std::min(bytes, kSlice - slice_.size());
      slice_.insert(slice_.end(), p, p + n);
      p += n;
      bytes -= n;
      if (slice_.size() == kSlice) close();
    }
  }
  Hash128 digest() {
    if (!slice_.empty()) close();
    return hashBytes(digests_.data(), digests_.size() * sizeof(Hash128));
  }

 private:
  void close() {
    digests_.push_back(hashBytes(slice_.data(), slice_.size()));
    slice_.clear();
  }
  std::vector<uint8_t> slice_;
  std::vector<Hash128> digests_;
};

std::string otherVersion(uint32_t found) { return "version " + std::to_string(found) + ", this build reads version " + std::to_string(kBlobVersion); }

Status bad(const std::string& what) { return Status(Code::DataLoss, "scene blob: " + what); }

template <typename T>
Status write(const T& item, Kind kind, const BlobSink& sink, const BlobKey& key) {
  blob::Writer w;
  w.put(item);
  if constexpr (std::is_same_v<T, Scene>) w.put(item.hash());
  Header h{};
  std::memcpy(h.magic, kMagic, sizeof kMagic);
  h.version = kBlobVersion;
  h.endian = kEndian;
  h.kind = uint32_t(kind);
  h.headerBytes = kBlobHeaderBytes;
  h.format = blobFormatHash();
  h.key = key;
  h.recordBytes = w.records.size();
  h.arrayStart = (kBlobHeaderBytes + h.recordBytes + 63) & ~uint64_t(63);
  h.total = h.arrayStart + w.arrayBytes;
  h.records = hashBytes(w.records.data(), w.records.size());
  static constexpr char zeroes[64] = {};
  SliceDigest arrays;
  for (const auto& piece : w.pieces) {
    arrays.add(piece.data, size_t(piece.bytes));
    arrays.add(zeroes, size_t((64 - piece.bytes % 64) % 64));
  }
  h.arrays = arrays.digest();
  h.self = hashBytes(&h, kSelfAt);
  GOBO_TRY(sink(&h, sizeof h));
  GOBO_TRY(sink(w.records.data(), w.records.size()));
  GOBO_TRY(sink(zeroes, size_t(h.arrayStart - kBlobHeaderBytes - h.recordBytes)));
  for (const auto& piece : w.pieces) {
    GOBO_TRY(sink(piece.data, size_t(piece.bytes)));
    GOBO_TRY(sink(zeroes, size_t((64 - piece.bytes % 64) % 64)));
  }
  return {};
}

Status checkHeader(std::span<const uint8_t> bytes, Header& h) {
  if (bytes.size() < sizeof h) return bad("file of " + std::to_string(bytes.size()) + " bytes is shorter than the header");
  std::memcpy(&h, bytes.data(), sizeof h);
  if (std::memcmp(h.magic, kMagic, sizeof kMagic) != 0) return bad("this is no scene blob");
  if (h.version != kBlobVersion) return bad(otherVersion(h.version));
  if (h.endian != kEndian) return bad("another byte order");
  if (h.self != hashBytes(&h, kSelfAt)) return bad("header is damaged");
  if (h.format != blobFormatHash()) return bad(kOtherFields);
  if (h.headerBytes != kBlobHeaderBytes) return bad("header of " + std::to_string(h.headerBytes) + " bytes");
  if (h.total != bytes.size()) return bad("has " + std::to_string(bytes.size()) + " bytes of " + std::to_string(h.total));
  if (h.recordBytes > h.total - sizeof h || h.total % 64 != 0 || h.arrayStart % 64 != 0 || h.arrayStart < sizeof h + h.recordBytes || h.arrayStart > h.total)
    return bad("sections do not fit the file");
  return {};
}

/// A reader over the checked parts of a file.
Status open(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, Kind kind, BlobTrust trust, const BlobKey* key, blob::Reader& reader) {
  Header h;
  GOBO_TRY(checkHeader(bytes, h));
  if (h.kind != uint32_t(kind)) return bad("kind " + std::to_string(h.kind) + " is not " + std::to_string(uint32_t(kind)));
  if (trust == BlobTrust::Foreign) GOBO_TRY(checkBlobArrays(bytes));  // a blob that is kept must pass this later
  if (key && h.key != *key) return bad("made from something else");
  reader.owner = std::move(owner);
  reader.records = bytes.subspan(sizeof h, size_t(h.recordBytes));
  reader.arrays = bytes.subspan(size_t(h.arrayStart));
  if (reinterpret_cast<uintptr_t>(bytes.data()) % 64 != 0) return bad("is not mapped at a multiple of 64 bytes");
  if (h.records != hashBytes(reader.records.data(), reader.records.size())) return bad("records are damaged");
  return {};
}

/// Array<float> and arrays of float vectors.
template <typename T>
bool allFinite(const Array<T>& values) {
  const float* p = reinterpret_cast<const float*>(values.data());
  const size_t n = values.size() * (sizeof(T) / sizeof(float));
  uint32_t worst = 0;  // exponent all ones: Inf or NaN; integer maximum vectorises
  for (size_t i = 0; i < n; ++i) {
    uint32_t bits;
    std::memcpy(&bits, p + i, 4);
    worst = std::max(worst, bits & 0x7fffffffu);
  }
  return worst < 0x7f800000u;
}

Status checkMesh(const Mesh& mesh, size_t i) {
  const std::string name = "mesh " + std::to_string(i);
  if (!allFinite(mesh.positions) || !allFinite(mesh.normals) || !allFinite(mesh.tangents) || !allFinite(mesh.colours) ||
      !std::all_of(mesh.uv.begin(), mesh.uv.end(), [](const Array<Vec2>& set) { return allFinite(set); }))
    return bad(name + ": a vertex value is not finite");
  Mesh again = mesh;  // shares the arrays
  sealMesh(again);
  if (again.topologyHash != mesh.topologyHash || again.positionsHash != mesh.positionsHash || again.shadingHash != mesh.shadingHash)
    return bad(name + ": digest is not that of its arrays");
  return {};
}

/// What sealTexture would CHECK, and the ranges that sampling relies on.
Status checkTextureShape(const Texture& t, size_t i) {
  const std::string name = "texture " + std::to_string(i);
  if (t.width <= 0 || t.height <= 0 || t.width > (1 << 24) || t.height > (1 << 24))
    return bad(name + ": size " + std::to_string(t.width) + " x " + std::to_string(t.height));
  if (t.levels < 1 || t.levels > kMaxTextureLevels || t.tile < 0 || t.tile > kMaxTextureTile || t.channels != 4) return bad(name + ": layout is out of range");
  const uint64_t texels = textureTexels(t.width, t.height, t.levels, t.tile);
  if ((t.texels8.empty() == t.texelsF.empty()) || uint64_t(t.texels8.size()) + t.texelsF.size() != texels * 4)
    return bad(name + ": has not the texels of its size");
  if (t.content.isZero()) return bad(name + ": has no digest");
  return {};
}

Status checkMap(const Environment& map, BlobTrust trust) {
  if (map.width <= 0 || map.height <= 0 || map.texels.size() != uint64_t(map.width) * uint64_t(map.height) || map.content.isZero())
    return bad("environment: has not the texels of its size");
  if (trust == BlobTrust::Own) return {};
  if (!allFinite(map.texels) || !std::isfinite(map.rotation)) return bad("environment: a texel is not finite");
  for (const Vec3& t : map.texels)
    if (t.x < 0 || t.y < 0 || t.z < 0) return bad("environment: a texel is negative");
  if (environmentDigest(map) != map.content) return bad("environment: digest is not that of its texels");
  return {};
}

}  // namespace

Hash128 blobFormatHash() {
  static const Hash128 hash = [] {
    blob::Format f;
    f.type<Scene>();
    f.type<Environment>();
    return f.hash.add(kBlobVersion).digest();
  }();
  return hash;
}

Status writeBlob(const Scene& scene, const BlobSink& sink, const BlobKey& key) { return write(scene, Kind::Scene, sink, key); }
Status writeBlob(const Environment& map, const BlobSink& sink, const BlobKey& key) { return write(map, Kind::Environment, sink, key); }

std::array<uint8_t, kBlobHeaderBytes> withBlobKey(std::span<const uint8_t> header, const BlobKey& key) {
  GOBO_CHECK(header.size() >= kBlobHeaderBytes);
  Header h;
  std::memcpy(&h, header.data(), sizeof h);
  h.key = key;
  h.self = hashBytes(&h, kSelfAt);
  std::array<uint8_t, kBlobHeaderBytes> out;
  std::memcpy(out.data(), &h, sizeof h);
  return out;
}

std::string otherBlobFormat(std::span<const uint8_t> header) {
  Header h{};
  if (header.size() < sizeof h) return {};
  std::memcpy(&h, header.data(), sizeof h);
  if (std::memcmp(h.magic, kMagic, sizeof kMagic) != 0) return {};
  if (h.version != kBlobVersion) return otherVersion(h.version);
  return h.format == blobFormatHash() ? "" : kOtherFields;
}

Status checkBlobArrays(std::span<const uint8_t> bytes, const StopToken& stop) {
  Header h;
  GOBO_TRY(checkHeader(bytes, h));
  const std::span<const uint8_t> arrays = bytes.subspan(size_t(h.arrayStart));
  std::vector<Hash128> digests;
  digests.reserve(arrays.size() / kSlice + 1);
  for (size_t at = 0; at < arrays.size(); at += kSlice) {
    if (stop.stopRequested()) return {Code::Cancelled, "scene blob: stopped while its arrays were checked"};
    digests.push_back(hashBytes(arrays.data() + at, std::min(kSlice, arrays.size() - at)));
  }
  if (hashBytes(digests.data(), digests.size() * sizeof(Hash128)) != h.arrays) return bad("arrays are damaged");
  return {};
}

static Result<std::shared_ptr<Scene>> readScene(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key) {
  blob::Reader r;
  GOBO_TRY(open(std::move(owner), bytes, Kind::Scene, trust, key, r));
  auto scene = std::make_shared<Scene>();
  Hash128 stored;
  r.get(*scene);
  r("hash", stored);
  if (!r.problem.empty()) return bad(r.problem);
  if (r.at != r.records.size()) return bad("records have " + std::to_string(r.records.size() - r.at) + " bytes too many");
  for (size_t i = 0; i < scene->meshes.size(); ++i) {
    if (!scene->meshes[i]) return bad("mesh " + std::to_string(i) + " is missing");
    const Mesh& mesh = *scene->meshes[i];
    if (trust == BlobTrust::Foreign) GOBO_TRY(checkMesh(mesh, i));
    else if (mesh.topologyHash.isZero()) return bad("mesh " + std::to_string(i) + " has no digest");
  }
  TextureSealer sealer;
  for (size_t i = 0; i < scene->textures.size(); ++i) {
    if (!scene->textures[i]) return bad("texture " + std::to_string(i) + " is missing");
    const Texture& t = *scene->textures[i];
    GOBO_TRY(checkTextureShape(t, i));
    if (trust == BlobTrust::Own) continue;
    Texture again = t;
    if (sealer.seal(again) && !allFinite(t.texelsF)) return bad("texture " + std::to_string(i) + ": a texel is not finite");
    if (again.content != t.content) return bad("texture " + std::to_string(i) + ": digest is not that of its texels");
    if (again.lowest != t.lowest) return bad("texture " + std::to_string(i) + ": lowest values are not those of its texels");
  }
  if (trust == BlobTrust::Foreign)
    for (size_t i = 0; i < scene->profiles.size(); ++i) {
      LightProfile again = *scene->profiles[i];
      if (const Status sealed = sealProfile(again); !sealed.ok()) return bad("profile " + std::to_string(i) + ": " + sealed.message());
      if (again.content != scene->profiles[i]->content) return bad("profile " + std::to_string(i) + ": digest is not that of its values");
    }
  if (scene->environment) GOBO_TRY(checkMap(*scene->environment, trust));
  if (scene->rig && scene->rig->content.isZero()) return bad("rig has no digest");
  if (const Status sealed = scene->seal(); !sealed.ok()) return bad(sealed.toString());
  if (scene->rig && trust == BlobTrust::Foreign) {
    for (size_t i = 0; i < scene->rig->meshes.size(); ++i) GOBO_TRY(checkMesh(*scene->rig->meshes[i], i));
    for (const RigSource& source : scene->rig->sources)
      for (const RigTarget& t : source.targets)
        if (!allFinite(t.positions) || !allFinite(t.normals) || !allFinite(t.tangents) || !allFinite(t.colours) ||
            !std::all_of(t.uv.begin(), t.uv.end(), [](const Array<Vec2>& set) { return allFinite(set); }))
          return bad("rig: a displacement is not finite");
    Rig again = *scene->rig;
    if (const Status sealed = sealRig(again, *scene); !sealed.ok()) return bad("rig: " + sealed.toString());
    if (again.content != scene->rig->content) return bad("rig: digest is not that of its fields");
  }
  if (scene->hash() != stored) return bad("hash " + scene->hash().hex() + " is not the stored " + stored.hex());
  return scene;
}

static Result<std::shared_ptr<Environment>> readMap(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key) {
  blob::Reader r;
  GOBO_TRY(open(std::move(owner), bytes, Kind::Environment, trust, key, r));
  auto map = std::make_shared<Environment>();
  r.get(*map);
  if (!r.problem.empty()) return bad(r.problem);
  if (r.at != r.records.size()) return bad("records have " + std::to_string(r.records.size() - r.at) + " bytes too many");
  GOBO_TRY(checkMap(*map, trust));
  return map;
}

Result<ScenePtr> readSceneBlob(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key) {
  GOBO_ASSIGN(ScenePtr scene, readScene(std::move(owner), bytes, trust, key));
  return scene;
}

Result<EnvironmentPtr> readEnvironmentBlob(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key) {
  GOBO_ASSIGN(EnvironmentPtr map, readMap(std::move(owner), bytes, trust, key));
  return map;
}

Result<ScenePtr> readSceneBlob(const std::shared_ptr<const MappedFile>& file, BlobTrust trust, const BlobKey* key) {
  const auto scene = readScene(file, file->bytes(), trust, key);
  if (!file->intact()) return file->lost();  // whatever the reading made of the zeroes
  if (!scene.ok()) return scene.status();
  (*scene)->file = file;
  return ScenePtr(*scene);
}

Result<EnvironmentPtr> readEnvironmentBlob(const std::shared_ptr<const MappedFile>& file, BlobTrust trust, const BlobKey* key) {
  const auto map = readMap(file, file->bytes(), trust, key);
  if (!file->intact()) return file->lost();
  if (!map.ok()) return map.status();
  (*map)->file = file;
  return EnvironmentPtr(*map);
}

}  // namespace scene
}  // namespace gobo
