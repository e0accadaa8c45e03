// SPDX-License-Identifier: Apache-2.0
// What must hold for any bytes from outside, one function an entrance. The fuzz targets feed them what libFuzzer invents, the tests
// (tests/fuzz/properties) every seed of ../shared/data and every regression. Crashes, sanitizer reports and CHECKs end the process;
// everything else that is wrong is told in Outcome::broken. Nothing touches the disk. Deterministic; thread-safe.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "base/status.h"
#include "scene/scene.h"

namespace gobo::fuzz {

struct Outcome {
  bool accepted = false;
  std::string said;    ///< the error, when refused
  std::string broken;  ///< the property that does not hold; empty: all is well
};
using Bytes = std::span<const uint8_t>;

/// .gltf or .glb, through the code of the ingest child, without files beside it. Accepted: sealed, every number finite, all text UTF-8,
/// its blob is accepted as foreign and gives the same hash, and it can be posed.
Outcome tryGltf(Bytes bytes);
/// A picture as a texture's pixels and as an environment map. Sizes agree with the pixels; the map's texels are finite and >= 0, its
/// blob is accepted.
Outcome tryImage(Bytes bytes);
/// First byte: 0 the rest is a blob; 1 edits of bytes of a good blob (u16 place, u8 value) ...; 2 edits of fields of a good scene
/// (u16 field, u8 how, u32 value) ... . Digests of header and records are made right, or nothing would get past them.
/// Accepted: finite, written again it has the same hash, it can be posed and sampled.
Outcome tryBlob(Bytes bytes);
/// "{...": JSON of a RenderRequest; otherwise lines of path=value. Accepted: resolving again changes nothing, JSON and back is the same
/// message and hash, and its effective scene is finite or refused with the field named.
Outcome tryRequestText(Bytes bytes);
/// First byte: 0 RenderRequest, 1 RelightRequest, 2 PatchSceneRequest, 3 JobSpec; then the message's wire bytes.
Outcome tryRequestBytes(Bytes bytes);

/// For targets: prints what is broken and aborts.
void demand(const Outcome& outcome);

// Shared by the properties.
/// Why this is not an error as errors must be: a code that blames the input, a message, a location that starts with `place`, all UTF-8.
std::string brokenStatus(const Status& status, std::string_view place);
/// The first number of the scene that is not finite, or text that is not UTF-8.
std::string brokenValues(const Scene& scene);
/// The scene's blob is accepted as foreign, gives the same hash and, written again, the same bytes.
std::string brokenBlob(const Scene& scene);
/// Every animation at its start, middle and end, every variant.
std::string brokenPoses(const ScenePtr& scene);
/// The file of richScene(), whole in itself.
std::string richGltf();
/// A small scene with everything in it: skin, morph targets, animation, variants, texture, environment, lights, camera.
ScenePtr richScene();

}  // namespace gobo::fuzz
