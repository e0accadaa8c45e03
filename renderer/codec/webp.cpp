// SPDX-License-Identifier: Apache-2.0
#include "codec/webp.h"

#include <webp/decode.h>

#include <new>
#include <vector>

#include "base/check.h"
#include "base/image_io.h"

namespace gobo {
inline namespace base {

Result<Image> decodeWebp(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits, ImageCodec::SizeCheck check) {
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(bytes, size, &features) != VP8_STATUS_OK) return invalidArgument("not a readable webp image", name);
  const int channels = features.has_alpha ? 4 : 3;
  GOBO_TRY(check(features.width, features.height, channels, size, limits).at(name));
  if (features.has_animation) return invalidArgument("animated webp images are not read", name);
  if (limits.stop.stopRequested()) return Status(Code::Cancelled, "the reading was cancelled", name);
  Image image(features.width, features.height, channels);
  image.names = {"R", "G", "B"};
  if (channels == 4) image.names.push_back("A");
  const size_t row = size_t(image.width) * size_t(channels);
  std::vector<uint8_t> values(row * size_t(image.height));
  WebPDecoderConfig config;
  if (!WebPInitDecoderConfig(&config)) return internalError("another libwebp than this was built with", name);
  config.output.colorspace = channels == 4 ? MODE_RGBA : MODE_RGB;
  config.output.is_external_memory = 1;
  config.output.u.RGBA = {values.data(), int(row), values.size()};
  const VP8StatusCode status = WebPDecode(bytes, size, &config);
  WebPFreeDecBuffer(&config.output);
  if (status == VP8_STATUS_OUT_OF_MEMORY) {  // a picture is not left out for that: gobo-ingest's handler ends the reading
    if (const std::new_handler handler = std::get_new_handler()) handler();
    throw std::bad_alloc();
  }
  if (status != VP8_STATUS_OK) return invalidArgument("damaged webp image", name);
  for (size_t i = 0; i < values.size(); ++i) {
    if (i % (size_t(1) << 16) == 0 && limits.stop.stopRequested()) return Status(Code::Cancelled, "the reading was cancelled", name);
    image.data[i] = float(values[i]) * (1.0f / 255.0f);  // in the bits that OpenImageIO gives
  }
  return image;
}

}  // namespace base
}  // namespace gobo
