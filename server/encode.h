// SPDX-License-Identifier: Apache-2.0
// Pictures as bytes in the format that a request asks for. EXR and raw keep scene-linear values; PNG and JPEG are for
// looking at: radiance goes through the tone curve or a view of a display
// (RenderResult.view), other outputs through the mapping in displayImage's comment.
// What each output is comes from plan/outputs.h, transfer functions from base/transfer.h.
// Cost for 640 x 480 x 3 float on one core: raw and digest as printed by bench/socket_bench; EXR (ZIP) tens of ms.
// Pure functions; thread-safe.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/image_io.h"
#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "plan/engine.h"
#include "terms/scratch.h"

namespace gobo {
inline namespace server {

/// Of an encoder, or of a picture's size and to be filled: then from the pool of terms, since fresh memory costs more than writing it.
class PictureBytes {
 public:
  PictureBytes() = default;
  PictureBytes(std::vector<uint8_t> made) : made_(std::move(made)) {}
  explicit PictureBytes(size_t size) : raw_(size) {}
  uint8_t* data() { return raw_.size() > 0 ? raw_.get() : made_.data(); }
  const uint8_t* data() const { return raw_.size() > 0 ? raw_.get() : made_.data(); }
  size_t size() const { return raw_.size() > 0 ? raw_.size() : made_.size(); }
  const uint8_t* begin() const { return data(); }
  const uint8_t* end() const { return data() + size(); }
  std::vector<uint8_t> copy() const { return {data(), data() + size()}; }

 private:
  std::vector<uint8_t> made_;
  Scratch<uint8_t> raw_;
};

struct EncodedImage {
  v1::ImageDescriptor descriptor;
  PictureBytes bytes;
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
  std::string hex();  ///< call once, last

 private:
  void* context_;
};

/// True for outputs that are radiance (plan/outputs.h: OutputKind::Radiance).
bool isRadiance(const std::string& output);
/// The picture that PNG and JPEG show, 0..1, 1, 3 or 4 channels. `data`: code values, for the file as they are; otherwise linear light,
/// which the encoder gives its transfer function.
struct DisplayImage {
  Image image;
  bool data = false;
};
/// Radiance: tone mapped; albedo, visibility: clamped. As data: alpha; normal (0.5 + n/2); motion (0.5 + m / (2 largest |m|), blue 0);
/// depth: (far - d) / (far - near) over finite positive depths, nothing = 0; position, sample_count, variance: each channel over its own
/// range; ids: a colour each (by a hash of the number), nothing black; mattes: the mean of their ids' colours by coverage.
DisplayImage displayImage(const std::string& output, const Image& image, const v1::ToneMap& settings);

/// Row-major interleaved little-endian floats, or halves (clamped to +-65504, rounded to nearest even).
PictureBytes rawBytes(std::span<const float> pixels, bool half);

/// ZIP unless it says otherwise.
ExrCompression exrCompressionOf(v1::Encoding::Compression compression);
/// Encodes every image of a result and fills result.reply.images; with encoding.layers (EXR) all of them as one image called "layers":
/// the beauty in the nameless layer, the others under exrLayerName(output), an output asked for twice once. What the header holds:
/// docs/protocol.md, "Outputs". Values beyond what the encoding's halves hold are clamped and counted in a warning. Equal pictures of equal requests give equal
/// bytes: nothing that a clock or a cache says is in them. Errors: Internal when the encoder fails; InvalidArgument naming encoding.format for an unknown
/// format.
Result<std::vector<EncodedImage>> encodeImages(RenderResult& result);
/// Of an output: it shows a light's map, not the view, and has its size; no window is a part of it.
bool showsMap(const std::string& output);

}  // namespace server
}  // namespace gobo
