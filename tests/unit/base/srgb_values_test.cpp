// SPDX-License-Identifier: Apache-2.0
// Code values of picture files as the light that they stand for.
#include "base/srgb_values.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/image_io.h"

namespace gobo {
namespace {

Image ramp(int channels) {
  Image image(64, 2, channels);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i * 37 % 101) / 100.0f;
  return image;
}

TEST(SrgbValues, WhatAFileShowsIsWhatWasWritten) {
  for (const int channels : {1, 3, 4})
    for (const Transfer transfer : {Transfer::Srgb, Transfer::Linear})
      for (const int bits : {8, 16}) {
        const Image image = ramp(channels);
        PixelOptions options;
        options.bits = bits;
        options.transfer = transfer;
        const auto bytes = encodePng(image, options);
        ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
        EXPECT_EQ(holdsSrgbValues(bytes->data(), bytes->size()), transfer == Transfer::Srgb);
        auto back = readImageFromMemory(bytes->data(), bytes->size(), "x.png");
        ASSERT_TRUE(back.ok()) << back.status().toString();
        if (holdsSrgbValues(bytes->data(), bytes->size())) { ASSERT_TRUE(decodeSrgbValues(*back)); }
        for (size_t i = 0; i < image.data.size(); ++i)
          ASSERT_NEAR(back->data[i], image.data[i], bits == 8 ? 5e-3 : 2e-5) << channels << " channels, value " << i;
      }
}

TEST(SrgbValues, OtherFilesAreLinear) {
  const auto exr = encodeExr(ramp(3));
  ASSERT_TRUE(exr.ok());
  EXPECT_FALSE(holdsSrgbValues(exr->data(), exr->size()));
  const auto jpeg = encodeJpeg(ramp(3), {});
  ASSERT_TRUE(jpeg.ok());
  EXPECT_TRUE(holdsSrgbValues(jpeg->data(), jpeg->size()));
  EXPECT_FALSE(holdsSrgbValues(nullptr, 0));
  // A chunk whose length is beyond the file, and a file that ends in its head.
  PixelOptions linear;
  linear.transfer = Transfer::Linear;
  auto png = *encodePng(ramp(3), linear);
  for (size_t n = 0; n <= 64; ++n) (void)holdsSrgbValues(png.data(), n);
  png[8] = 0xff;
  EXPECT_TRUE(holdsSrgbValues(png.data(), png.size()));
}

TEST(SrgbValues, AStopLeavesIt) {
  Image image = ramp(3);
  StopSource source;
  source.stop(StopReason::Cancelled);
  EXPECT_FALSE(decodeSrgbValues(image, source.token()));
}

}  // namespace
}  // namespace gobo
