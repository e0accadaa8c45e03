// SPDX-License-Identifier: Apache-2.0
// The shared object behind base/image_codec.h: reading by OpenImageIO, WebP by libwebp.
#include "base/image_codec.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>

#include "base/check.h"
#include "base/image_io.h"
#include "codec/webp.h"

namespace gobo {
inline namespace base {
namespace {

Result<Image> decode(const uint8_t* bytes, size_t size, const std::string& format, const std::string& name, const ReadLimits& limits,
                     ImageCodec::SizeCheck check) {
  if (format == "webp") return decodeWebp(bytes, size, name, limits, check);
  OIIO::Filesystem::IOMemReader memory(const_cast<uint8_t*>(bytes), size);
  // By the format's name: given a file's name or the bytes, it tries every reader that it has where this one refuses them.
  auto input = OIIO::ImageInput::create(format, false, nullptr, static_cast<OIIO::Filesystem::IOProxy*>(nullptr));
  if (!input) {
    OIIO::geterror();
    return invalidArgument("unknown image format", name);
  }
  if (!input->supports("ioproxy")) return Status(Code::Unimplemented, "image format " + format + " cannot be read", name);
  OIIO::ImageSpec config, spec;
  config.attribute("oiio:UnassociatedAlpha", 1);  // glTF and our own PNGs keep colour and alpha apart
  // The name must not exist as a file: readers that ignore the proxy would open it.
  if (!input->set_ioproxy(&memory) || !input->open("memory." + format, spec, config)) {
    const std::string why = input->geterror();
    return invalidArgument("not a readable " + format + " image" + (why.empty() ? "" : ": " + why), name);
  }
  GOBO_TRY(check(spec.width, spec.height, spec.nchannels, size, limits).at(name));
  if (spec.depth > 1) return invalidArgument("volume images are not read", name);
  if (spec.deep) return invalidArgument("deep images are not read", name);
  Image image(spec.width, spec.height, spec.nchannels);
  image.names = {spec.channelnames.begin(), spec.channelnames.end()};
  // Rows in whole strips between polls; tiles by the library, which asks for itself.
  bool read = true;
  if (spec.tile_width > 0) {
    const OIIO::ProgressCallback stopped = [](void* stop, float) { return static_cast<const StopToken*>(stop)->stopRequested(); };
    read = input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data(), OIIO::AutoStride, OIIO::AutoStride, OIIO::AutoStride, stopped,
                             const_cast<StopToken*>(&limits.stop));
  } else {
    const int strip = std::max(1, spec.get_int_attribute("tiff:RowsPerStrip", 1)), rows = std::max(64 / strip, 1) * strip;
    for (int y = 0; y < spec.height && read && !limits.stop.stopRequested(); y += rows) {
      const int end = std::min(spec.height, y + rows);
      float* to = image.data.data() + size_t(y) * size_t(spec.width) * size_t(spec.nchannels);
      read = input->read_scanlines(0, 0, spec.y + y, spec.y + end, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, to);
    }
  }
  if (limits.stop.stopRequested()) return Status(Code::Cancelled, "the reading was cancelled", name);
  if (!read) {
    const std::string why = input->geterror();
    return invalidArgument("damaged " + format + " image" + (why.empty() ? "" : ": " + why), name);
  }
  return image;
}

void useOneThread() {
  OIIO::attribute("threads", 1);
  OIIO::attribute("exr_threads", -1);  // none of its own
}

}  // namespace
}  // namespace base
}  // namespace gobo

extern "C" [[gnu::visibility("default")]] const gobo::ImageCodec gobo_image_codec = {gobo::decode, gobo::useOneThread};
