// SPDX-License-Identifier: Apache-2.0
#include "server/encode.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <Imath/half.h>
#include <openssl/evp.h>

#include "base/check.h"
#include "base/hash.h"
#include "base/image_io.h"
#include "plan/request.h"

namespace gobo {
namespace {

// The encoders apply the sRGB curve; data that must reach the file as it is goes through its inverse first.
float srgbToLinear(float v) {
  v = std::clamp(v, 0.0f, 1.0f);
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}

bool startsWith(const std::string& text, const char* prefix) { return text.rfind(prefix, 0) == 0; }

// (v - low) / (high - low) of one channel over its finite values, and 0 for the rest; `flip`: near is bright.
void normaliseChannel(const Image& in, int channel, bool flip, bool positiveOnly, Image& out, int outChannel) {
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  const auto counts = [&](float v) { return std::isfinite(v) && (!positiveOnly || v > 0); };
  for (size_t i = 0; i < in.pixels(); ++i) {
    const float v = in.data[i * in.channels + channel];
    if (counts(v)) low = std::min(low, v), high = std::max(high, v);
  }
  const float range = high > low ? high - low : 1.0f;
  for (size_t i = 0; i < in.pixels(); ++i) {
    const float v = in.data[i * in.channels + channel];
    float t = 0;
    if (counts(v)) t = flip ? (high > low ? (high - v) / range : 1.0f) : (v - low) / range;
    out.data[i * out.channels + outChannel] = srgbToLinear(t);
  }
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
  return output == "beauty" || output == "direct" || output == "indirect" || output == "emission" ||
         startsWith(output, "unoccluded:") || startsWith(output, "group:");
}

Image displayImage(const std::string& output, const Image& image, const v1::ToneMap& settings) {
  if (isRadiance(output)) return toneMapped(image, settings);
  const int channels = image.channels >= 3 ? (image.channels == 3 ? 3 : 4) : 1;
  Image out(image.width, image.height, channels);
  if (output == "depth" || output == "position") {
    for (int c = 0; c < channels; ++c) normaliseChannel(image, c, output == "depth", output == "depth", out, c);
    return out;
  }
  const bool asIs = output == "normal" || output == "alpha";
  for (size_t i = 0; i < image.pixels(); ++i)
    for (int c = 0; c < channels; ++c) {
      float v = image.data[i * image.channels + c];
      if (!std::isfinite(v)) v = 0;
      if (output == "normal") v = 0.5f + 0.5f * v;
      out.data[i * channels + c] = asIs ? srgbToLinear(v) : std::clamp(v, 0.0f, 1.0f);
    }
  return out;
}

std::vector<uint8_t> rawBytes(std::span<const float> pixels, bool half) {
  static_assert(std::endian::native == std::endian::little);
  const size_t n = pixels.size();
  std::vector<uint8_t> bytes(n * (half ? 2 : 4));
  if (!half) {
    std::memcpy(bytes.data(), pixels.data(), bytes.size());
    return bytes;
  }
  for (size_t i = 0; i < n; ++i) {
    const float v = std::clamp(pixels[i], -65504.0f, 65504.0f);   // overflow to infinity would leave the picture
    const uint16_t bits = Imath::half(v).bits();
    std::memcpy(bytes.data() + 2 * i, &bits, 2);
  }
  return bytes;
}

Result<std::vector<EncodedImage>> encodeImages(RenderResult& result) {
  const v1::RenderRequest& request = result.reply.resolved();
  const v1::Encoding& encoding = request.encoding();
  v1::Encoding::Format format = encoding.format();
  if (format == v1::Encoding::FORMAT_UNSPECIFIED) format = v1::Encoding::EXR;
  ExrOptions exr;
  if (format == v1::Encoding::EXR) {
    exr.half = encoding.half();
    exr.metadata = {{"gobo:request", messageToJson(request, false)},
                    {"gobo:request_hash", result.reply.request_hash()},
                    {"gobo:seed", std::to_string(result.reply.seed())},
                    {"gobo:build", result.reply.build()}};
  }
  std::vector<EncodedImage> encoded;
  result.reply.clear_images();
  for (const RenderedImage& rendered : result.images) {
    const auto display = [&] { return displayImage(rendered.output, rendered.image(), request.tone_map()); };
    EncodedImage one;
    std::vector<std::string> channels = channelNames(rendered.names(), rendered.channels());
    Result<std::vector<uint8_t>> bytes = Status();
    switch (format) {
      case v1::Encoding::EXR:
        exr.metadata["gobo:output"] = rendered.output;
        bytes = encodeExr(rendered.image(), exr);
        break;
      case v1::Encoding::PNG:
      case v1::Encoding::JPEG: {
        const Image shown = display();
        bytes = format == v1::Encoding::PNG ? encodePng(shown)
                                            : encodeJpeg(shown, encoding.has_jpeg_quality() ? int(encoding.jpeg_quality()) : 90);
        channels = channelNames(shown.names, shown.channels);
        break;
      }
      case v1::Encoding::RAW_FLOAT: bytes = rawBytes(rendered.pixels(), false); break;
      case v1::Encoding::RAW_HALF: bytes = rawBytes(rendered.pixels(), true); break;
      default: return invalidArgument("encoding.format = " + std::to_string(int(format)) + " is not known", "request.encoding.format");
    }
    if (!bytes.ok()) return bytes.status().at("output " + rendered.output);
    one.bytes = std::move(bytes).value();
    one.descriptor.set_output(rendered.output);
    one.descriptor.set_width(uint32_t(rendered.width()));
    one.descriptor.set_height(uint32_t(rendered.height()));
    for (const std::string& name : channels) one.descriptor.add_channels(name);
    one.descriptor.set_format(format);
    one.descriptor.set_bytes(one.bytes.size());
    one.descriptor.set_digest(hashBytes(one.bytes.data(), one.bytes.size()).hex());
    *result.reply.add_images() = one.descriptor;
    encoded.push_back(std::move(one));
  }
  return encoded;
}

}  // namespace gobo
