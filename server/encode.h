// SPDX-License-Identifier: Apache-2.0
// Pictures as bytes in the format that a request asks for. EXR and raw keep scene-linear values; PNG and JPEG are for
// looking at: radiance goes through the tone curve, other outputs through the mapping in displayImage's comment.
// Cost for 640 x 480 x 3 float on one core: raw and digest as printed by bench/socket_bench; EXR (ZIP) tens of ms.
// Pure functions; thread-safe.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "plan/engine.h"

namespace gobo {

struct EncodedImage {
  v1::ImageDescriptor descriptor;
  std::vector<uint8_t> bytes;
};

/// 64 lower-case hex digits.
std::string sha256Hex(const void* data, size_t size);

/// SHA-256 of a stream of pieces.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  void add(const void* data, size_t size);
  std::string hex();   ///< call once, last

 private:
  void* context_;
};

/// True for outputs that are radiance (beauty, direct, indirect, emission, unoccluded:*, group:*).
bool isRadiance(const std::string& output);
/// The picture that PNG and JPEG show, linear 0..1, 1, 3 or 4 channels (the encoders apply sRGB):
/// radiance: tone mapped; albedo, visibility: clamped; alpha, normal (0.5 + n/2): stored as they are, without the curve;
/// depth: (far - d) / (far - near) over finite positive depths, nothing = 0; position: each axis over its own range.
Image displayImage(const std::string& output, const Image& image, const v1::ToneMap& settings);

/// Row-major interleaved little-endian floats, or halves (clamped to +-65504, rounded to nearest even).
std::vector<uint8_t> rawBytes(std::span<const float> pixels, bool half);

/// Encodes every image of a result and fills result.reply.images. The EXR header holds gobo:request (resolved, JSON),
/// gobo:request_hash, gobo:output, gobo:seed and gobo:build.
/// Errors: Internal when the encoder fails; InvalidArgument naming encoding.format for an unknown format.
Result<std::vector<EncodedImage>> encodeImages(RenderResult& result);

}  // namespace gobo
