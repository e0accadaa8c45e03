// SPDX-License-Identifier: Apache-2.0
// Transfer functions: round trips (densely around the joints of their segments), continuity there, known values, and what the
// integer encoders make of them.
#include "base/transfer.h"

#include <gtest/gtest.h>

#include <limits>

#include "base/image_io.h"

namespace gobo {
namespace {

constexpr Transfer kAll[] = {Transfer::Linear, Transfer::Srgb, Transfer::Rec709};
double joint(Transfer t) { return t == Transfer::Srgb ? 0.0031308 : t == Transfer::Rec709 ? kRec709Beta : 0.5; }

TEST(Transfer, RoundTripsEverywhereAndAtTheJoints) {
  for (const Transfer t : kAll) {
    for (int i = 0; i <= 65535; ++i) EXPECT_NEAR(encodeTransfer(t, decodeTransfer(t, i / 65535.0)), i / 65535.0, 2e-8) << int(t) << " " << i;
    for (int i = -1000; i <= 1000; ++i) {
      const double x = joint(t) * (1.0 + i * 1e-6);
      EXPECT_NEAR(decodeTransfer(t, encodeTransfer(t, x)), x, 5e-9) << int(t) << " " << i;  // sRGB's published constants leave 1e-8
    }
  }
}

TEST(Transfer, SegmentsMeetAndNeverFall) {
  for (const Transfer t : kAll) {
    const double x = joint(t), step = 1e-12;
    EXPECT_NEAR(encodeTransfer(t, x + step), encodeTransfer(t, x - step), t == Transfer::Srgb ? 1e-7 : 1e-10) << int(t);
    double last = 0;
    for (int i = 0; i <= 100000; ++i) {
      const double e = encodeTransfer(t, i / 100000.0);
      EXPECT_GE(e, last);
      last = e;
    }
    EXPECT_EQ(encodeTransfer(t, 1.0), 1.0);
    EXPECT_EQ(encodeTransfer(t, 7.0), 1.0);
    EXPECT_EQ(encodeTransfer(t, -1.0), 0.0);
    EXPECT_EQ(encodeTransfer(t, std::numeric_limits<double>::quiet_NaN()), 0.0);
    EXPECT_EQ(decodeTransfer(t, std::numeric_limits<double>::quiet_NaN()), 0.0);
  }
}

TEST(Transfer, KnownValues) {
  EXPECT_NEAR(encodeTransfer(Transfer::Srgb, 0.2140411), 0.5, 1e-6);                              // IEC 61966-2-1: code 0.5
  EXPECT_NEAR(encodeTransfer(Transfer::Rec709, 0.18), 0.409, 5e-4);                               // grey card: 40.9 % of the signal range
  EXPECT_NEAR(encodeTransfer(Transfer::Rec709, 0.01), 0.045, 1e-12);                              // slope 4.5 at the foot
  EXPECT_NEAR(encodeTransfer(Transfer::Rec709, 0.5), 1.099 * std::pow(0.5, 0.45) - 0.099, 1e-3);  // the printed constants agree to 3 digits
}

// 16 bits carry every code value exactly; 8 bits the nearest; the transfer is the one asked for; alpha is not curved.
TEST(Transfer, PngBitsAndTransfers) {
  Image image(512, 1, 4);
  for (int x = 0; x < 512; ++x)
    for (int c = 0; c < 4; ++c) image.at(x, 0)[c] = float(x) / 511.0f;
  for (const Transfer t : kAll)
    for (const int bits : {8, 16}) {
      const auto bytes = encodePng(image, {.transfer = t, .bits = bits});
      ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
      const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.png");
      ASSERT_TRUE(back.ok()) << back.status().toString();
      const double half = 0.5 / (bits == 8 ? 255.0 : 65535.0) + 1e-7;
      for (int x = 0; x < 512; ++x) {
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(back->at(x, 0)[c], encodeTransfer(t, x / 511.0), half) << int(t) << " " << bits << " " << x;
        ASSERT_NEAR(back->at(x, 0)[3], x / 511.0, half);
      }
    }
}

TEST(Transfer, JpegQualityIsHeeded) {
  Image image(64, 64, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float((i * 2654435761u) >> 8 & 255) / 255.0f;
  const auto coarse = encodeJpeg(image, {.quality = 20}), fine = encodeJpeg(image, {.quality = 98});
  ASSERT_TRUE(coarse.ok() && fine.ok());
  EXPECT_LT(coarse->size() * 2, fine->size());
}

}  // namespace
}  // namespace gobo
