// SPDX-License-Identifier: Apache-2.0
// PNG and JPEG of radiance through a view of an OpenColorIO config: code values of the files against closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "base/image_io.h"
#include "plan/display_transforms.h"
#include "server/encode.h"
#include "support/color_configs.h"
#include "support/temp_folder.h"

namespace gobo::encode_view_test {
namespace {

struct Views {
  test::TempFolder folder;
  DisplayTransforms displays{{test::writeColorConfig(folder.path), "", {}}};

  RenderResult resultOf(const Image& image, const std::string& view, v1::Encoding::Format format, uint32_t bits, const std::string& output = "beauty") {
    RenderResult result;
    v1::RenderRequest& r = *result.reply.mutable_resolved();
    r.mutable_encoding()->set_format(format);
    r.mutable_encoding()->set_png_bits(bits);
    r.mutable_encoding()->set_jpeg_quality(100);
    if (view.empty()) {
      r.mutable_tone_map()->set_curve(v1::ToneMap::LINEAR);
      r.mutable_encoding()->set_transfer(v1::Encoding::SRGB);
    } else {
      r.mutable_encoding()->set_view(view);
      const v1::RenderRequest asked = r;
      EXPECT_TRUE(displays.resolve(r, asked).ok());
      auto processor = displays.processor(r.encoding());
      EXPECT_TRUE(processor.ok());
      result.view = *processor;
    }
    const auto term = std::make_shared<Term>("pixels", Domain::Pixel, Extent{image.width, image.height, 1});
    const auto plane = term->addPlane<float>("v", image.channels);
    std::copy(image.data.begin(), image.data.end(), plane.begin());
    result.images.emplace_back(output, term, "v", image.names);
    return result;
  }
  /// Code values of the file, as floats of 0..1.
  Image decoded(const Image& image, const std::string& view, v1::Encoding::Format format = v1::Encoding::PNG, uint32_t bits = 8,
                const std::string& output = "beauty") {
    RenderResult result = resultOf(image, view, format, bits, output);
    auto files = encodeImages(result);
    EXPECT_TRUE(files.ok()) << files.status().toString();
    const std::vector<uint8_t> bytes = (*files)[0].bytes.copy();
    auto read = readImageFromMemory(bytes.data(), bytes.size(), format == v1::Encoding::PNG ? "a.png" : "a.jpg");
    EXPECT_TRUE(read.ok()) << read.status().toString();
    EXPECT_EQ(result.reply.images(0).channels_size(), read->channels);
    return std::move(*read);
  }
};

Image ramp() {
  Image image(64, 40, 3);
  for (size_t p = 0; p < image.pixels(); ++p)
    for (size_t c = 0; c < 3; ++c) image.data[3 * p + c] = float(1.3 * double((p * (c + 1)) % image.pixels()) / double(image.pixels()) - 0.05);
  return image;
}

TEST(EncodeView, CodeValuesAreTheClosedFormsWithinHalfAStep) {
  Views views;
  const Image image = ramp();
  for (const char* view : {"Power", "Swapped", "Log", "sRGB", "Graded", "Half", "Raw"})
    for (const uint32_t bits : {8u, 16u}) {
      const Image file = views.decoded(image, view, v1::Encoding::PNG, bits);
      ASSERT_EQ(file.channels, 3);
      const double top = bits == 8 ? 255 : 65535;
      double most = 0;
      for (size_t p = 0; p < image.pixels(); ++p) {
        const double rgb[3] = {image.data[3 * p], image.data[3 * p + 1], image.data[3 * p + 2]};
        for (int c = 0; c < 3; ++c) most = std::max(most, std::fabs(file.data[3 * p + c] - test::expectedView(view, rgb, c)) * top);
      }
      EXPECT_LE(most, bits == 8 ? 0.501 : 0.6) << view << " " << bits;  // 16 bits: 24 of a float's stand for the rest
    }
}

TEST(EncodeView, TheLibrarysSrgbIsOurTransferFunction) {
  Views views;
  const Image image = ramp();
  for (const uint32_t bits : {8u, 16u}) {
    const Image theirs = views.decoded(image, "sRGB", v1::Encoding::PNG, bits), ours = views.decoded(image, "", v1::Encoding::PNG, bits);
    for (size_t i = 0; i < ours.data.size(); ++i) ASSERT_LE(std::fabs(theirs.data[i] - ours.data[i]) * (bits == 8 ? 255 : 65535), 1.001) << i;
  }
}

TEST(EncodeView, OtherOutputsAreAsWithoutAView) {
  Views views;
  Image image = ramp();
  for (float& v : image.data) v = std::max(v, 0.0f);
  for (const char* output : {"albedo", "normal", "position"})
    EXPECT_EQ(views.decoded(image, "Swapped", v1::Encoding::PNG, 8, output).data, views.decoded(image, "", v1::Encoding::PNG, 8, output).data) << output;
  EXPECT_NE(views.decoded(image, "Swapped", v1::Encoding::PNG, 8, "direct").data, views.decoded(image, "", v1::Encoding::PNG, 8, "direct").data);
}

TEST(EncodeView, APngClaimsNoTransferFunction) {
  Views views;
  const auto chunk = [&](const std::string& view) {
    RenderResult result = views.resultOf(ramp(), view, v1::Encoding::PNG, 8);
    auto files = encodeImages(result);
    const std::vector<uint8_t> bytes = (*files)[0].bytes.copy();
    return std::string(bytes.begin(), bytes.end()).find("sRGB") != std::string::npos;
  };
  EXPECT_TRUE(chunk(""));
  EXPECT_FALSE(chunk("Power"));
}

TEST(EncodeView, AlphaIsKeptByPngAndLaidOnBlackByJpeg) {
  Views views;
  Image image(16, 16, 4);
  for (size_t p = 0; p < image.pixels(); ++p) {
    for (size_t c = 0; c < 3; ++c) image.data[4 * p + c] = 0.3f;
    image.data[4 * p + 3] = 0.6f;
  }
  const Image png = views.decoded(image, "Power");
  ASSERT_EQ(png.channels, 4);
  EXPECT_NEAR(png.data[0], std::pow(0.5, 1 / 2.2), 0.51 / 255);
  EXPECT_NEAR(png.data[3], 0.6, 0.51 / 255);
  const Image jpeg = views.decoded(image, "Power", v1::Encoding::JPEG);
  ASSERT_EQ(jpeg.channels, 3);
  for (const float v : jpeg.data) EXPECT_NEAR(v, std::pow(0.3, 1 / 2.2), 1.6 / 255);  // a flat picture: what JPEG's own steps leave
}

}  // namespace
}  // namespace gobo::encode_view_test
