// SPDX-License-Identifier: Apache-2.0
// Mattes of objects and materials after the Cryptomatte Specification 1.2.0 (Friedman, Jones 2015): of each pixel the ids that it shows, by how much of it
// they cover. Term "pixels", f32 planes "object" and "material" (those that are asked for) of 12 channels: kCryptomatteRanks pairs (id, coverage), largest
// coverage first, equal ones by id; pairs without an id are (0, 0).
//   id        the name's hash as the bits of a float: never compare or average it as a number
//   coverage  share of the pixel's rays, of the box filter: together the share that hits anything. What has no rank left is in none: then they are less
// The rays are the path tracer's first ones (same numbers of the same sequence), so that edges are those of the beauty, with depth of field and pixel filter;
// what they hit is what the G-buffer sees. Lamps without geometry are not there.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/sampler_kind.h"
#include "terms/gbuffer.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace terms {

inline constexpr int kCryptomatteRanks = 6;
inline constexpr int kCryptomatteChannels = 2 * kCryptomatteRanks;
inline constexpr int kMostCryptomatteSamples = 256;

/// The id of a name (UTF-8), as bits: MurmurHash3_x86_32 with seed 0, bit 23 flipped where the float would be zero, denormal, infinite or no number.
uint32_t cryptomatteId(std::string_view name);
/// 8 lower-case hex digits of it, as manifests have them.
std::string cryptomatteHex(uint32_t id);

struct CryptomatteSettings {
  GBufferSettings view;      ///< camera, size and place; its view samples and parts do not matter
  int samples = 64;          ///< rays a pixel, 1 .. kMostCryptomatteSamples
  SequenceShare share = {};  ///< of the pixel's sequence
  int viewSamples = 0;       ///< 0: the box filter; S: sample i is view sample i mod S (PathTracerSettings::viewSamples)
  SamplerKind sampler = SamplerKind::Sobol;
  uint64_t seed = 0;
  std::vector<uint32_t> objects, materials;     ///< id of each instance; empty: no such plane, unless it is asked for
  bool ofObjects = false, ofMaterials = false;  ///< asked for, also where the scene has no instance
};

/// Source. 40 to 100 ns a ray. Errors of run(): Internal if there are not as many ids as instances.
NodePtr makeCryptomatteNode(CryptomatteSettings settings);

}  // namespace terms
}  // namespace gobo
