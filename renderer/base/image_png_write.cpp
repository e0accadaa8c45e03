// SPDX-License-Identifier: Apache-2.0
#include <png.h>

#include <bit>
#include <csetjmp>
#include <new>
#include <string>

#include "base/image_write.h"

namespace gobo {
inline namespace base {
namespace {

struct Sink {
  std::vector<uint8_t> bytes;
  std::string why;
};

void append(png_structp png, png_bytep data, png_size_t size) {
  auto& sink = *static_cast<Sink*>(png_get_io_ptr(png));
  try {
    sink.bytes.insert(sink.bytes.end(), data, data + size);
    return;
  } catch (const std::bad_alloc&) {}
  png_error(png, "out of memory");  // outside of the handler: it jumps
}
void nothing(png_structp) {}
void fail(png_structp png, png_const_charp what) {
  static_cast<Sink*>(png_get_error_ptr(png))->why = what;
  png_longjmp(png, 1);
}
void ignore(png_structp, png_const_charp) {}

/// In a function of its own: nothing that has a destructor may stand between the jump and where it lands.
bool write(png_structp png, png_infop info, const CodedPixels& p) {
  constexpr int kTypes[] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_user_limits(png, 0x7fffffff, 0x7fffffff);
  png_set_IHDR(png, info, png_uint_32(p.width), png_uint_32(p.height), p.wide ? 16 : 8, kTypes[p.channels - 1], PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(png, 6);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_NO_FILTERS);
  if (!p.plain && p.transfer == Transfer::Srgb) png_set_sRGB(png, info, PNG_sRGB_INTENT_ABSOLUTE);
  if (!p.plain && p.transfer == Transfer::Linear) png_set_gAMA(png, info, 1.0);
  png_write_info(png, info);
  if (p.wide && std::endian::native == std::endian::little) png_set_swap(png);
  const size_t row = size_t(p.width) * size_t(p.channels) * (p.wide ? 2 : 1);
  for (int y = 0; y < p.height; ++y) png_write_row(png, p.values + size_t(y) * row);
  png_write_end(png, info);
  return true;
}

}  // namespace

Result<std::vector<uint8_t>> writePng(const CodedPixels& pixels) {
  if (pixels.channels < 1 || pixels.channels > 4) return invalidArgument("a PNG has 1 to 4 channels, not " + std::to_string(pixels.channels));
  Sink sink;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &sink, fail, ignore);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  if (info) png_set_write_fn(png, &sink, append, nothing);
  const bool written = info && write(png, info, pixels);
  png_destroy_write_struct(&png, &info);
  if (!written) return Status(Code::ResourceExhausted, "cannot encode png: " + (sink.why.empty() ? std::string("out of memory") : sink.why));
  return std::move(sink.bytes);
}

}  // namespace base
}  // namespace gobo
