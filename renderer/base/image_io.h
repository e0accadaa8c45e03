// SPDX-License-Identifier: Apache-2.0
// Reading and writing pictures: EXR by OpenEXR, PNG and JPEG written by libpng and libjpeg, everything else read by OpenImageIO. Errors name the file.
// Writing is atomic: a temporary file in the same folder, then rename; a failed write leaves nothing behind.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/image.h"
#include "base/status.h"
#include "base/stop.h"
#include "base/transfer.h"

namespace gobo {
inline namespace base {

struct ReadLimits {
  int maxDimension = 16384;         ///< pixels a side
  uint64_t maxPixels = 1ull << 27;  ///< decompression bombs are refused before their pixels are allocated
  StopToken stop;                   ///< polled between rows: Cancelled (what a library decodes before it has rows to give is not left early)
};

/// Any readable picture, as floats. Integer formats are scaled to 0..1 and kept in the file's transfer curve
/// (sRGB decoding is the texture's business). HDR and EXR are linear already.
Result<Image> readImage(const std::string& path, const ReadLimits& limits = {});
/// The same from bytes in memory; `name` is used in errors and to guess the format by its extension.
Result<Image> readImageFromMemory(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits = {});

/// One layer of an EXR file alone: its channels without the layer's name, R G B A (X Y Z) first. `layer` is the part of the channel
/// names before the last dot, or the name of a part; "" is the nameless layer of the first part (all of its channels if it has none).
/// Errors: as readImageFromMemory; NotFound lists the layers that the file has.
Result<Image> readExrLayer(const uint8_t* bytes, size_t size, const std::string& name, const std::string& layer, const ReadLimits& limits = {});
/// Layers in the order of the file, "" among them.
Result<std::vector<std::string>> exrLayers(const uint8_t* bytes, size_t size, const std::string& name);
/// The string attributes of the first part.
Result<std::map<std::string, std::string>> exrMetadata(const uint8_t* bytes, size_t size, const std::string& name);
/// "FILE" or "FILE.exr:LAYER" (a layer, or the name of an output: characters that layer names lack are compared as '_'). A multi-layer
/// file without LAYER gives its nameless layer. Linear: what a PNG or JPEG holds is decoded from sRGB (srgb_values.h).
Result<Image> readPicture(const std::string& fileAndLayer, const ReadLimits& limits = {});
/// The layer name of an output: letters, digits, '-' and '_' stay, everything else becomes '_' (Nuke takes nothing else, and dots nest).
std::string exrLayerName(std::string_view output);

enum class ExrCompression : uint8_t { None, Rle, Zips, Zip, Piz, Dwaa, Dwab };
/// Where the pixels lie in a larger picture, as a data window within a display window.
struct ExrPlace {
  int x = 0, y = 0, width = 0, height = 0;  ///< of no width: they are the picture
};
struct ExrOptions {
  bool half = false;  ///< 16-bit channels but for layers of `float32`
  ExrCompression compression = ExrCompression::Zip;
  float dwaLevel = 45.0f;
  std::map<std::string, std::string> metadata;  ///< string attributes, e.g. {"gobo:request", json}
  std::map<std::string, Mat4> matrices;         ///< matrices for column vectors, written as OpenEXR's (for row vectors)
  ExrPlace place;
};
struct ExrLayer {
  std::string name;                                  ///< "" for the nameless layer: R, G, B
  std::vector<std::string> channels;                 ///< without the layer's name
  std::span<const float> pixels;                     ///< width * height * channels, interleaved
  bool float32 = false;                              ///< 32 bits whatever the options say (ids, positions)
  bool lossless = true;                              ///< false: DWA may lose some of R, G, B
  std::map<std::string, std::string> metadata = {};  ///< string attributes of the part that it is in, and of the first
};
/// Scan-line EXR. One part; with DWAA or DWAB and both kinds of layers two: "color" (DWA) and "data" (ZIP), because DWA takes every
/// channel called Y for luma and would lose some of normal.Y and position.Y too. Values beyond half's range are clamped to +-65504 in
/// halves and in lossy channels. The bytes do not depend on threads. Cost: one core, 20 ns a float with ZIP.
Result<std::vector<uint8_t>> encodeExr(int width, int height, std::span<const ExrLayer> layers, const ExrOptions& options = {});
/// The image's named channels as one part (lossless unless the options say DWA and the channels are colours).
Result<std::vector<uint8_t>> encodeExr(const Image& image, const ExrOptions& options = {});

struct PixelOptions {
  Transfer transfer = Transfer::Srgb;  ///< of the colour channels; alpha is never curved
  bool data = false;                   ///< code values already: written as they are, the header claims no transfer function
  int bits = 8;                        ///< PNG: 8 or 16
  int quality = 90;                    ///< JPEG
};
/// PNG or JPEG of an image that is display-referred and linear in 0..1 (values outside are clamped). PNG says sRGB or gamma 1
/// in its header; nothing for Rec709.
Result<std::vector<uint8_t>> encodePng(const Image& image, const PixelOptions& options = {});
Result<std::vector<uint8_t>> encodeJpeg(const Image& image, const PixelOptions& options = {});

/// Writes bytes atomically (temporary + fsync + rename).
Status writeFileAtomic(const std::string& path, const void* data, size_t size);
inline constexpr uint64_t kMostFileBytes = 1ull << 32;
/// Errors: also Cancelled; `stop` is polled every few MB.
Result<std::vector<uint8_t>> readFile(const std::string& path, uint64_t maxBytes = kMostFileBytes, const StopToken& stop = {});
/// The pieces of readFile. openRegular does not wait for a FIFO's writer; the descriptor is the caller's.
Result<int> openRegular(const std::string& path);
/// `fd` if it is a regular file; else closes it. InvalidArgument.
Result<int> regularOrClose(int fd, const std::string& name);
/// Everything from the descriptor's position on, at most maxBytes (ResourceExhausted above); closes it.
Result<std::vector<uint8_t>> readAndClose(int fd, const std::string& name, uint64_t maxBytes, const StopToken& stop = {});
/// `what` and errno's text, with the code that fits errno.
Status ioError(const std::string& what, const std::string& path);

}  // namespace base
}  // namespace gobo
