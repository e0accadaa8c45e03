// SPDX-License-Identifier: Apache-2.0
#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

#include <jpeglib.h>

#include "base/image_write.h"

namespace gobo {
inline namespace base {
namespace {

struct Errors {
  jpeg_error_mgr manager;  ///< first: the library gives a pointer to it back
  std::jmp_buf place;
  char why[JMSG_LENGTH_MAX];
};

void fail(j_common_ptr jpeg) {
  auto* const errors = reinterpret_cast<Errors*>(jpeg->err);
  errors->manager.format_message(jpeg, errors->why);
  std::longjmp(errors->place, 1);
}
void ignore(j_common_ptr, int) {}

/// In a function of its own: nothing that has a destructor may stand between the jump and where it lands.
bool write(jpeg_compress_struct& jpeg, Errors& errors, const CodedPixels& p, unsigned char*& out, unsigned long& size) {
  if (setjmp(errors.place)) return false;
  jpeg_create_compress(&jpeg);
  jpeg_mem_dest(&jpeg, &out, &size);
  jpeg.image_width = JDIMENSION(p.width);
  jpeg.image_height = JDIMENSION(p.height);
  jpeg.input_components = p.channels;
  jpeg.in_color_space = p.channels == 3 ? JCS_RGB : JCS_GRAYSCALE;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, p.quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    JSAMPROW row = const_cast<JSAMPROW>(p.values + size_t(jpeg.next_scanline) * size_t(p.width) * size_t(p.channels));
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  return true;
}

}  // namespace

Result<std::vector<uint8_t>> writeJpeg(const CodedPixels& pixels) {
  if (pixels.channels != 1 && pixels.channels != 3) return invalidArgument("a JPEG has 1 or 3 channels, not " + std::to_string(pixels.channels));
  Errors errors{};
  jpeg_compress_struct jpeg{};
  jpeg.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = fail;
  errors.manager.emit_message = ignore;
  unsigned char* out = nullptr;
  unsigned long size = 0;
  const bool written = write(jpeg, errors, pixels, out, size);
  jpeg_destroy_compress(&jpeg);
  Result<std::vector<uint8_t>> result =
      written ? Result<std::vector<uint8_t>>(std::vector<uint8_t>(out, out + size)) : internalError(std::string("cannot encode jpg: ") + errors.why);
  std::free(out);
  return result;
}

}  // namespace base
}  // namespace gobo
