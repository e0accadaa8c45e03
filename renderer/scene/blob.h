// SPDX-License-Identifier: Apache-2.0
// Scene blob: a sealed scene (or one environment map) as one flat file that is mapped, not parsed: small records in the order of
// the field lists (fields.h, blob_fields.h) and 64-byte aligned arrays that the scene's Array<T>s look at. docs/scene_blob.md
// has the bytes. Little endian; files of another format hash, version or byte order are refused, not converted.
// Reading checks every offset, count and size in 64 bits against the file, every enumerator and bool for its range, and ends
// in Scene::seal(). Two levels of trust:
//   Foreign  made by a process that may have been taken over: digests of meshes, textures, maps and rig are computed again and
//            compared, and every float that shading reads is checked to be finite. Reads every byte (about 5 GB/s).
//   Own      from a folder that only this user's daemons write, and only after Foreign had passed: stored digests are taken over;
//            header and records are still checked by their digests. The arrays are believed: whoever maps a file calls
//            checkBlobArrays() before the first use (BlobCache::find does).
// Functions are thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "base/hash.h"
#include "base/status.h"
#include "base/stop.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {

using BlobKey = std::array<uint8_t, 32>;  ///< SHA-256 of what the blob was made from; zero: not known
enum class BlobTrust { Foreign, Own };
// 2: points and lines are geometry: what the importer makes of a file is part of the format; 3: Texture::lowest, Camera::cullBackFaces; 4: digest of
// the arrays; 5: LightShape::angularSize, skyRectangle; 6: Scene::profiles, LightShape::profile, profileRotation; 7: Scene::origin, Rig::origin,
// RigNode in double.
inline constexpr uint32_t kBlobVersion = 7;
inline constexpr size_t kBlobHeaderBytes = 144;

/// Digest of all field lists with names and types: what decides whether a blob can be read by this build.
Hash128 blobFormatHash();

/// Called with the file's bytes in order. Errors end the writing.
using BlobSink = std::function<Status(const void* data, size_t bytes)>;
/// `scene` must be sealed. Arrays are written from where they are: no second copy in memory.
Status writeBlob(const Scene& scene, const BlobSink& sink, const BlobKey& key = {});
Status writeBlob(const Environment& map, const BlobSink& sink, const BlobKey& key = {});

/// The header bytes with another key: how the parent puts in the key that the child does not know. The span holds a header.
std::array<uint8_t, kBlobHeaderBytes> withBlobKey(std::span<const uint8_t> header, const BlobKey& key);

/// Why a file that begins so is a blob of another build and none of this one's: version found and supported. Empty if it is not.
std::string otherBlobFormat(std::span<const uint8_t> header);

/// That header and arrays have their digests: reads every byte of the arrays once (about 10 GB/s from memory), 4 MiB between two looks
/// at `stop`. Errors: DataLoss that says what is damaged, Cancelled.
Status checkBlobArrays(std::span<const uint8_t> bytes, const StopToken& stop = {});

/// The result's arrays look at `bytes`, which `owner` keeps mapped and unchanged. With `key`, a blob of another key is refused.
/// Errors: DataLoss that says what is wrong ("scene blob: ...").
Result<ScenePtr> readSceneBlob(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key = nullptr);
Result<EnvironmentPtr> readEnvironmentBlob(std::shared_ptr<const void> owner, std::span<const uint8_t> bytes, BlobTrust trust, const BlobKey* key = nullptr);
/// The same of a mapped file, which the result names (Scene::file, Environment::file). DataLoss, too, when the file is not intact after the reading.
Result<ScenePtr> readSceneBlob(const std::shared_ptr<const MappedFile>& file, BlobTrust trust, const BlobKey* key = nullptr);
Result<EnvironmentPtr> readEnvironmentBlob(const std::shared_ptr<const MappedFile>& file, BlobTrust trust, const BlobKey* key = nullptr);

}  // namespace scene
}  // namespace gobo
