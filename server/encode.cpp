// SPDX-License-Identifier: Apache-2.0
#include "server/encode.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include <openssl/evp.h>

#include "base/check.h"
#include "base/halves.h"
#include "base/hash.h"
#include "base/image_io.h"
#include "base/sobol.h"
#include "plan/display_transforms.h"
#include "plan/outputs.h"
#include "request/request.h"

namespace gobo {
inline namespace server {
namespace {

/// Distances of this size are to nothing, or a mean with such (shadow_distance).
constexpr float kNowhere = 1e27f;

// (v - low) / (high - low) of one channel over its finite values, and 0 for the rest; `flip`: near is bright.
void normaliseChannel(const Image& in, int channel, bool flip, bool positiveOnly, Image& out, int outChannel) {
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  const auto counts = [&](float v) { return std::fabs(v) < kNowhere && (!positiveOnly || v > 0); };
  for (size_t i = 0; i < in.pixels(); ++i) {
    const float v = in.data[i * in.channels + channel];
    if (counts(v)) low = std::min(low, v), high = std::max(high, v);
  }
  const float range = high > low ? high - low : 1.0f;
  for (size_t i = 0; i < in.pixels(); ++i) {
    const float v = in.data[i * in.channels + channel];
    float t = 0;
    if (counts(v)) t = flip ? (high > low ? (high - v) / range : 1.0f) : (v - low) / range;
    out.data[i * out.channels + outChannel] = t;
  }
}

/// The colour of an id, none of it dark.
void addColour(uint64_t hash, float share, float* to) {
  for (int c = 0; c < 3; ++c) to[c] += share * (56.0f + float(hash >> (16 * c) & 0xffff) * (199.0f / 65535.0f)) / 255.0f;
}

/// A format without alpha shows what lies on black.
void layOnBlack(Image& image) {
  for (size_t i = 0; i < image.pixels(); ++i)
    for (int c = 0; c < 3; ++c) image.data[4 * i + size_t(c)] *= image.data[4 * i + 3];
}

std::vector<std::string> channelNames(const std::vector<std::string>& given, int channels) {
  if (int(given.size()) == channels) return given;
  if (channels == 1) return {"Y"};
  std::vector<std::string> names = {"R", "G", "B", "A"};
  for (int c = 4; c < channels; ++c) names.push_back("C" + std::to_string(c));
  names.resize(size_t(channels));
  return names;
}

}  // namespace

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  GOBO_CHECK(context_ != nullptr);
  GOBO_CHECK_EQ(EVP_DigestInit_ex(static_cast<EVP_MD_CTX*>(context_), EVP_sha256(), nullptr), 1);
}
Sha256::~Sha256() { EVP_MD_CTX_free(static_cast<EVP_MD_CTX*>(context_)); }
void Sha256::add(const void* data, size_t size) { EVP_DigestUpdate(static_cast<EVP_MD_CTX*>(context_), data, size); }
std::string Sha256::hex() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned n = 0;
  EVP_DigestFinal_ex(static_cast<EVP_MD_CTX*>(context_), digest, &n);
  static const char* digits = "0123456789abcdef";
  std::string text;
  for (unsigned i = 0; i < n; ++i) {
    text += digits[digest[i] >> 4];
    text += digits[digest[i] & 15];
  }
  return text;
}

std::string sha256Hex(const void* data, size_t size) {
  Sha256 sha;
  sha.add(data, size);
  return sha.hex();
}

bool isRadiance(const std::string& output) {
  const OutputInfo* info = findOutput(output);
  return info && info->kind == OutputKind::Radiance;
}

DisplayImage displayImage(const std::string& output, const Image& image, const v1::ToneMap& settings) {
  const OutputInfo* info = findOutput(output);
  const OutputKind kind = info ? info->kind : OutputKind::Colour;
  if (kind == OutputKind::Radiance) return {toneMapped(image, settings), false};
  const bool wide = image.channels == 2 || image.channels == 3 || kind == OutputKind::Id || kind == OutputKind::Matte;
  const int channels = wide ? 3 : image.channels > 3 ? 4 : 1;
  Image out(image.width, image.height, channels);
  const bool isDepth = output == "depth" || output == "z_depth";
  if (kind == OutputKind::Range) {
    for (int c = 0; c < channels; ++c) normaliseChannel(image, c, isDepth, isDepth || output == "variance", out, c);
    return {std::move(out), true};
  }
  float scale = 1.0f;  // of vectors
  if (output == "motion") {
    scale = 0.0f;
    for (const float v : image.data) scale = std::isfinite(v) ? std::max(scale, std::fabs(v)) : scale;
    scale = scale > 0 ? 1.0f / scale : 1.0f;
  }
  for (size_t i = 0; i < image.pixels(); ++i) {
    float* to = out.data.data() + i * channels;
    const float* from = image.data.data() + i * image.channels;
    if (kind == OutputKind::Id) {
      if (from[0] >= 0 && from[0] < 0x1p63f)  // not what no integer holds
        addColour(mix64(uint64_t(from[0]) + 1), 1.0f, to);
      continue;
    }
    if (kind == OutputKind::Matte) {
      for (int c = 0; c + 1 < image.channels; c += 2)
        if (from[c + 1] > 0.0f) addColour(mix64(std::bit_cast<uint32_t>(from[c])), from[c + 1], to);
      for (int c = 0; c < 3; ++c) to[c] = std::min(to[c], 1.0f);
      continue;
    }
    for (int c = 0; c < std::min(channels, image.channels); ++c) {
      float v = std::isfinite(from[c]) ? from[c] : 0.0f;
      if (kind == OutputKind::Vector) v = 0.5f + 0.5f * v * scale;
      to[c] = std::clamp(v, 0.0f, 1.0f);
    }
  }
  return {std::move(out), kind != OutputKind::Colour && kind != OutputKind::Plain ? true : output == "alpha"};
}

PictureBytes rawBytes(std::span<const float> pixels, bool half) {
  static_assert(std::endian::native == std::endian::little);
  PictureBytes bytes(pixels.size() * (half ? 2 : 4));
  if (half) toHalves(pixels, reinterpret_cast<uint16_t*>(bytes.data()));
  else if (!pixels.empty()) std::memcpy(bytes.data(), pixels.data(), bytes.size());
  return bytes;
}

ExrCompression exrCompressionOf(v1::Encoding::Compression c) {
  switch (c) {
    case v1::Encoding::NONE: return ExrCompression::None;
    case v1::Encoding::RLE: return ExrCompression::Rle;
    case v1::Encoding::ZIPS: return ExrCompression::Zips;
    case v1::Encoding::PIZ: return ExrCompression::Piz;
    case v1::Encoding::DWAA: return ExrCompression::Dwaa;
    case v1::Encoding::DWAB: return ExrCompression::Dwab;
    default: return ExrCompression::Zip;
  }
}

namespace {

/// {"node":..., "samples":..., "device":...} of each node, without what differs between a cold and a warm store.
std::string planSummary(const v1::RenderReply& reply) {
  v1::RenderReply kept;  // by the schema's own JSON names
  std::set<std::string> seen;
  for (const v1::NodeReport& n : reply.plan()) {
    const bool pruned = n.state() == v1::NodeReport::PRUNED;
    if (!seen.insert(n.node() + (pruned ? "/pruned" : "")).second) continue;
    v1::NodeReport& row = *kept.add_plan();
    row.set_node(n.node());
    row.set_samples(n.samples());
    row.set_device(n.device());
    row.set_approximate(n.approximate());
    if (!pruned) continue;
    row.set_state(n.state());
    row.set_reason(n.reason());
  }
  *kept.mutable_path_classes_missing() = reply.path_classes_missing();
  *kept.mutable_warnings() = reply.warnings();
  return messageToJson(kept, false);
}

ExrOptions exrOptions(const RenderResult& result) {
  const v1::RenderReply& reply = result.reply;
  const v1::Encoding& encoding = reply.resolved().encoding();
  v1::RenderRequest request = reply.resolved();
  request.clear_scheduling();
  ExrOptions exr;
  exr.half = encoding.half();
  exr.compression = exrCompressionOf(encoding.compression());
  if (encoding.has_dwa_level()) exr.dwaLevel = float(encoding.dwa_level());
  exr.metadata = result.tables;
  exr.metadata["gobo:request"] = messageToJson(request, false);
  exr.metadata["gobo:request_hash"] = reply.request_hash();
  exr.metadata["gobo:scene_hash"] = request.scene_hash();
  exr.metadata["gobo:seed"] = std::to_string(reply.seed());
  exr.metadata["gobo:build"] = reply.build();
  exr.metadata["gobo:plan"] = planSummary(reply);
  if (reply.has_certificate()) {
    v1::Certificate certificate = reply.certificate();
    certificate.clear_ms();
    exr.metadata["gobo:certificate"] = messageToJson(certificate, false);
  }
  exr.matrices = result.matrices;
  if (request.has_window()) exr.place = {int(request.window().x()), int(request.window().y()), int(request.width()), int(request.height())};
  return exr;
}

bool isMatte(const std::string& output) {
  const OutputInfo* info = findOutput(output);
  return info && info->kind == OutputKind::Matte;
}

ExrLayer layerOf(const RenderedImage& rendered, const RenderResult& result) {
  const OutputInfo* info = findOutput(rendered.output);
  ExrLayer layer;
  layer.channels = channelNames(rendered.names(), rendered.channels());
  layer.pixels = rendered.pixels();
  layer.float32 = info && info->float32;
  layer.lossless = !info || info->lossless();
  if (const auto own = result.attributes.find(rendered.output); own != result.attributes.end()) layer.metadata = own->second;
  return layer;
}

void describe(EncodedImage& one, const std::string& output, int width, int height, const std::vector<std::string>& channels, v1::Encoding::Format format,
              v1::RenderReply& reply) {
  one.descriptor.set_output(output);
  one.descriptor.set_width(uint32_t(width));
  one.descriptor.set_height(uint32_t(height));
  for (const std::string& name : channels) one.descriptor.add_channels(name);
  one.descriptor.set_format(format);
  one.descriptor.set_bytes(one.bytes.size());
  one.descriptor.set_digest(hashBytes(one.bytes.data(), one.bytes.size()).hex());
  *reply.add_images() = one.descriptor;
}

/// Says how many values of each output the encoding's halves do not hold.
void warnOfClamping(RenderResult& result, v1::Encoding::Format format) {
  const v1::Encoding& encoding = result.reply.resolved().encoding();
  const bool dwa = encoding.compression() == v1::Encoding::DWAA || encoding.compression() == v1::Encoding::DWAB;
  std::set<std::string> seen;
  for (const RenderedImage& rendered : result.images) {
    const ExrLayer layer = layerOf(rendered, result);
    const bool half = format == v1::Encoding::RAW_HALF || (format == v1::Encoding::EXR && ((encoding.half() && !layer.float32) || (dwa && !layer.lossless)));
    if (!half || !seen.insert(rendered.output).second) continue;
    const size_t beyond = beyondHalves(layer.pixels);
    if (beyond > 0)
      result.reply.add_warnings(rendered.output + ": " + std::to_string(beyond) + " of " + std::to_string(layer.pixels.size()) +
                                " values are beyond what the encoding's 16-bit floats hold and were clamped to 65504 (request.encoding)");
  }
}

Result<std::vector<EncodedImage>> encodeLayers(RenderResult& result) {
  ExrOptions exr = exrOptions(result);
  std::vector<ExrLayer> layers;
  std::vector<std::string> channels, named;
  std::set<std::string> outputs, names;
  for (const RenderedImage& rendered : result.images) {
    if (!outputs.insert(rendered.output).second) continue;
    ExrLayer layer = layerOf(rendered, result);
    if (rendered.output != "beauty") {
      const std::string plain = exrLayerName(rendered.output);
      if (isMatte(rendered.output)) {  // its channels have their layers' names
        std::set<std::string> own;
        for (const std::string& c : layer.channels) own.insert(c.substr(0, c.rfind('.')));
        for (const std::string& name : own) named.insert(named.end(), {name, rendered.output});
      } else {
        layer.name = plain;
        for (int k = 2; !names.insert(layer.name).second; ++k) layer.name = plain + "_" + std::to_string(k);  // "group:a.b" and "group:a_b"
        named.insert(named.end(), {layer.name, rendered.output});
      }
    }
    for (const std::string& c : layer.channels) channels.push_back(layer.name.empty() ? c : layer.name + "." + c);
    layers.push_back(std::move(layer));
  }
  exr.metadata["gobo:layers"] = jsonObject(named);
  if (layers.empty()) return std::vector<EncodedImage>{};
  const int width = result.images[0].width(), height = result.images[0].height();
  if (showsMap(result.images[0].output)) exr.place = {};
  std::vector<EncodedImage> encoded(1);
  GOBO_ASSIGN(encoded[0].bytes, encodeExr(width, height, layers, exr));
  describe(encoded[0], "layers", width, height, channels, v1::Encoding::EXR, result.reply);
  return encoded;
}

}  // namespace

bool showsMap(const std::string& output) { return output.starts_with("shadow_basis:"); }

Result<std::vector<EncodedImage>> encodeImages(RenderResult& result) {
  const v1::RenderRequest& request = result.reply.resolved();
  const v1::Encoding& encoding = request.encoding();
  v1::Encoding::Format format = encoding.format();
  if (format == v1::Encoding::FORMAT_UNSPECIFIED) format = v1::Encoding::EXR;
  result.reply.clear_images();
  warnOfClamping(result, format);
  if (format == v1::Encoding::EXR && encoding.layers()) return encodeLayers(result);
  ExrOptions exr;
  if (format == v1::Encoding::EXR) exr = exrOptions(result);
  PixelOptions pixels;
  if (encoding.has_png_bits()) pixels.bits = int(encoding.png_bits());
  if (encoding.has_jpeg_quality()) pixels.quality = int(encoding.jpeg_quality());
  pixels.transfer = encoding.transfer() == v1::Encoding::REC709   ? Transfer::Rec709
                    : encoding.transfer() == v1::Encoding::LINEAR ? Transfer::Linear
                                                                  : Transfer::Srgb;
  std::vector<EncodedImage> encoded;
  for (const RenderedImage& rendered : result.images) {
    EncodedImage one;
    std::vector<std::string> channels = channelNames(rendered.names(), rendered.channels());
    Result<std::vector<uint8_t>> made = std::vector<uint8_t>();
    switch (format) {
      case v1::Encoding::EXR: {
        exr.metadata["gobo:output"] = rendered.output;
        const ExrLayer layer = layerOf(rendered, result);
        ExrOptions own = exr;
        if (showsMap(rendered.output)) own.place = {};
        made = encodeExr(rendered.width(), rendered.height(), std::span(&layer, 1), own);
        break;
      }
      case v1::Encoding::PNG:
      case v1::Encoding::JPEG: {
        DisplayImage shown;
        if (result.view && isRadiance(rendered.output)) {
          GOBO_ASSIGN(shown.image, shownByView(rendered.image(), request.tone_map().exposure(), *result.view, format == v1::Encoding::JPEG));
          shown.data = true;
        } else {
          shown = displayImage(rendered.output, rendered.image(), request.tone_map());
        }
        if (format == v1::Encoding::JPEG && shown.image.channels == 4 && isRadiance(rendered.output)) layOnBlack(shown.image);
        pixels.data = shown.data;
        made = format == v1::Encoding::PNG ? encodePng(shown.image, pixels) : encodeJpeg(shown.image, pixels);
        channels = channelNames(shown.image.names, shown.image.channels);
        if (format == v1::Encoding::JPEG && channels.size() > 3) channels.resize(3);  // it has no alpha
        break;
      }
      case v1::Encoding::RAW_FLOAT: one.bytes = rawBytes(rendered.pixels(), false); break;
      case v1::Encoding::RAW_HALF: one.bytes = rawBytes(rendered.pixels(), true); break;
      default: return invalidArgument("encoding.format = " + std::to_string(int(format)) + " is not known", "request.encoding.format");
    }
    if (!made.ok()) return made.status().at("output " + rendered.output);
    if (!made->empty()) one.bytes = std::move(made).value();
    describe(one, rendered.output, rendered.width(), rendered.height(), channels, format, result.reply);
    encoded.push_back(std::move(one));
  }
  return encoded;
}

}  // namespace server
}  // namespace gobo
