// SPDX-License-Identifier: Apache-2.0
// Deflation that keeps a share of thin parts: skeletons, half widths, bars, dumbbells, rings.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <queue>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/half_width.h"
#include "filters/stylised/skeleton.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_keep_test {

using namespace test;

constexpr float kPixel = 0.1f;

PlaneView view(const Extent& e) {
  PlaneView v;
  v.width = e.width, v.height = e.height, v.layers = e.layers;
  v.du = Vec3(kPixel, 0, 0), v.dv = Vec3(0, kPixel, 0);
  return v;
}
/// Distances of a shape given in pixels.
std::shared_ptr<Term> distances(const Extent& e, const std::function<double(double x, double y)>& f) {
  return floatTerm(e, "D", [&](int x, int y, int) {
    const float d = kPixel * float(f(x, y));
    return d == 0.0f ? 1e-30f : d;
  });
}
TermPtr halfWidths(const TermPtr& D, const TermPtr& g, int threads = 2) { return runFilter(makeStyleHalfWidthNode({D->extent(), kPi / 4}), {D, g}, threads); }
TermPtr kept(const TermPtr& D, const TermPtr& g, float keep, float inflationPixels, int threads = 2) {
  return runFilter(makeStyleKeepNode({D->extent(), kPi / 4, keep, kPixel * inflationPixels, false}), {D, halfWidths(D, g, threads), g}, threads);
}
std::vector<float> plane(const TermPtr& t, const char* name = "D") {
  const auto p = t->floats(name);
  return {p.begin(), p.end()};
}
bool below(const TermPtr& D, float inflationPixels, size_t k) { return D->floats("D")[k] < kPixel * inflationPixels; }

/// Connected parts, by eight neighbours, of what is below `level` (pixels) or, by four, of what is not.
int parts(const TermPtr& D, float level, bool light = false) {
  const int w = D->extent().width, h = D->extent().height;
  std::vector<uint8_t> seen(size_t(w * h), 0);
  int n = 0;
  for (int s = 0; s < w * h; ++s) {
    if (seen[size_t(s)] || below(D, level, size_t(s)) == light) continue;
    ++n;
    std::queue<int> queue({s});
    seen[size_t(s)] = 1;
    for (; !queue.empty(); queue.pop())
      for (int v = -1; v <= 1; ++v)
        for (int u = -1; u <= 1; ++u) {
          const int x = queue.front() % w + u, y = queue.front() / w + v;
          if (x < 0 || y < 0 || x >= w || y >= h || (light && u && v)) continue;
          const size_t k = size_t(y * w + x);
          if (!seen[k] && below(D, level, k) != light) seen[k] = 1, queue.push(int(k));
        }
  }
  return n;
}

TEST(Skeleton, SimplePointsChangeNoConnections) {  // all neighbourhoods, against counting parts with the middle and without it
  for (int bits = 0; bits < 256; ++bits) {
    const auto count = [&](bool middle, bool light) {
      std::array<int, 9> part{};
      const auto dark = [&](int x, int y) {
        for (int k = 0; k < 8; ++k)
          if (kAround[k].x == x - 1 && kAround[k].y == y - 1) return (bits >> k & 1) != 0;
        return middle;
      };
      int n = 0;
      const std::function<void(int, int)> fill = [&](int x, int y) {
        if (x < 0 || y < 0 || x > 2 || y > 2 || part[size_t(3 * y + x)] || dark(x, y) == light) return;
        part[size_t(3 * y + x)] = n;
        for (int v = -1; v <= 1; ++v)
          for (int u = -1; u <= 1; ++u)
            if (!light || u == 0 || v == 0) fill(x + u, y + v);
      };
      for (int k = 0; k < 9; ++k)
        if (!part[size_t(k)] && dark(k % 3, k / 3) != light) ++n, fill(k % 3, k / 3);
      return n;
    };
    // Light parts that touch the middle by a side: with it gone they are one. Corners that do not touch it stay what they are.
    const bool same = count(true, false) == count(false, false) && count(true, true) == count(false, true);
    EXPECT_EQ(isSimplePoint(uint8_t(bits)), same) << bits;
  }
}

std::vector<float> skeletonOf(const TermPtr& D, const TermPtr& g) { return plane(halfWidths(D, g), "half_width"); }

TEST(StyleHalfWidth, OfABarIsHalfItsWidthAlongItsMiddle) {
  const Extent e{80, 60, 1};
  const auto g = planeGBuffer(view(e));
  for (const double h : {3.5, 4.0, 9.5, 2.0}) {
    const auto r = skeletonOf(distances(e, [&](double, double y) { return std::abs(y - 30) - h; }), g);
    size_t along = 0;
    for (int y = 0; y < e.height; ++y)
      for (int x = 0; x < e.width; ++x) {
        if (r[size_t(y * e.width + x)] == 0.0f) continue;
        ++along;
        EXPECT_EQ(y, 30) << x;
        EXPECT_NEAR(r[size_t(y * e.width + x)], kPixel * float(h), 1e-4f);
      }
    EXPECT_GE(along, 78u) << "as long as the bar";
  }
}

TEST(StyleHalfWidth, OfADiscIsItsRadiusAtItsCentreAlone) {
  const Extent e{90, 90, 1};
  const auto r = skeletonOf(distances(e, [](double x, double y) { return std::hypot(x - 44, y - 46) - 30; }), planeGBuffer(view(e)));
  for (size_t k = 0; k < r.size(); ++k) {
    if (r[k] == 0.0f) continue;
    EXPECT_LE(std::hypot(double(k % 90) - 44, double(k / 90) - 46), 2.5);
    EXPECT_NEAR(r[k], 30 * kPixel, 3 * kPixel);
  }
  EXPECT_GT(*std::max_element(r.begin(), r.end()), 0.0f);
}

/// Across a bar, turned by `degrees` about the middle: pixels from its axis.
double across(const Extent& e, double degrees, double x, double y) {
  const double a = degrees * M_PI / 180;
  return (y - e.height / 2) * std::cos(a) - (x - e.width / 2) * std::sin(a);
}

TEST(StyleKeep, ABarKeepsItsShare) {
  const Extent e{120, 120, 1};
  const auto g = planeGBuffer(view(e));
  for (const double degrees : {0.0, 27.0, 45.0, 90.0})
    for (const double h : {6.5, 8.0}) {
      const auto D = distances(e, [&](double x, double y) { return std::abs(across(e, degrees, x, y)) - h; });
      const float i = float(-1.5 * h);
      const auto width = [&](const TermPtr& d) {  // of what is below i in the middle of the picture
        double n = 0;
        for (int y = 30; y < 90; ++y)
          for (int x = 30; x < 90; ++x) n += below(d, i, size_t(y * e.width + x));
        return n / 60 * std::max(std::abs(std::cos(degrees * M_PI / 180)), std::abs(std::sin(degrees * M_PI / 180)));
      };
      EXPECT_EQ(width(D), 0) << "without keep it vanishes";
      EXPECT_EQ(width(kept(D, g, 0, i)), 0);
      for (const float k : {0.25f, 0.5f, 0.8f, 1.0f}) EXPECT_NEAR(width(kept(D, g, k, i)), 2 * double(k) * h, 1.5) << degrees << " " << h << " keeps " << k;
    }
}

TEST(StyleKeep, OfTheMethodsDistanceIsAShareOfTheWidth) {  // between two edges the averaged distance is less than half the width
  const Extent e{100, 80, 1};
  const auto g = planeGBuffer(view(e));
  const auto V = floatTerm(e, "V", [](int, int y, int) { return std::abs(y - 40) <= 10 ? 0.0f : 1.0f; });
  for (const StyleNorm norm : {StyleNorm::Local, StyleNorm::Published}) {
    StyleDistanceSettings d;
    d.extent = e;
    d.norm = norm;
    const auto D = runFilter(makeStyleDistanceNode(d), {V, g});
    const float i = 3 * D->floats("D")[40 * 100 + 50] / kPixel;  // thrice what is there
    const auto out = kept(D, g, 0.5f, i);
    int n = 0;
    for (int y = 0; y < 80; ++y) n += below(out, i, size_t(y * 100 + 50));
    EXPECT_NEAR(n, 10.5, 1.0) << int(norm);
  }
}

std::shared_ptr<Term> dumbbell(const Extent& e, double bridge) {
  return distances(e, [=](double x, double y) {
    const double discs = std::min(std::hypot(x - 35, y - 40), std::hypot(x - 125, y - 40)) - 25;
    const double bar = std::max(std::abs(y - 40) - bridge, std::abs(x - 80) - 45);
    return std::min(discs, bar);
  });
}

TEST(StyleKeep, ADumbbellStaysOnePiece) {
  const Extent e{160, 80, 1};
  const auto g = planeGBuffer(view(e));
  for (const double bridge : {5.5, 6.0, 8.5})
    for (const float i : {-10.0f, -14.0f, -18.0f, -22.0f}) {
      const auto D = dumbbell(e, bridge);
      EXPECT_EQ(parts(kept(D, g, 0, i), i), 2);
      for (const float k : {0.2f, 0.4f, 0.7f}) EXPECT_EQ(parts(kept(D, g, k, i), i), 1) << "bridge " << bridge << ", deflated by " << -i << ", keeps " << k;
    }
}

TEST(StyleKeep, WideDiscsAreDeflatedAsWithout) {
  const Extent e{160, 90, 1};
  const auto g = planeGBuffer(view(e));
  const auto D = distances(e, [](double x, double y) { return std::hypot(x - 60, y - 45) - 40; });
  for (const float k : {0.1f, 0.5f, 0.7f}) {
    const auto out = kept(D, g, k, -8);  // thin is what is less than 8 / (1 - k) wide
    for (size_t n = 0; n < e.elements(); ++n) ASSERT_EQ(std::bit_cast<uint32_t>(out->floats("D")[n]), std::bit_cast<uint32_t>(D->floats("D")[n])) << k;
  }
}

TEST(StyleKeep, RightCornersAreTakenBack) {
  const Extent e{100, 100, 1};
  const auto D = distances(e, [](double x, double y) { return std::max(std::abs(x - 50), std::abs(y - 50)) - 35.5; });
  const auto out = kept(D, planeGBuffer(view(e)), 0.5f, -8);
  for (size_t n = 0; n < e.elements(); ++n) ASSERT_EQ(out->floats("D")[n], D->floats("D")[n]);
}

TEST(StyleKeep, RingsStayRings) {
  const Extent e{100, 100, 1};
  const auto g = planeGBuffer(view(e));
  const auto D = distances(e, [](double x, double y) { return std::abs(std::hypot(x - 50, y - 50) - 30) - 6; });
  const auto out = kept(D, g, 0.3f, -9);
  EXPECT_EQ(parts(out, -9), 1);
  EXPECT_EQ(parts(out, -9, true), 2) << "inside and outside";
  EXPECT_EQ(parts(D, -9), 0);
}

TEST(StyleKeep, WithoutDeflationItIsTheDistanceToTheBit) {
  const Extent e{160, 80, 1};
  const auto g = planeGBuffer(view(e));
  const auto D = dumbbell(e, 5);
  for (const auto& [k, i] : {std::pair{0.5f, 0.0f}, {0.5f, 3.0f}, {1.0f, 0.0f}, {0.0f, -12.0f}}) {
    const auto out = kept(D, g, k, i);
    for (size_t n = 0; n < e.elements(); ++n) ASSERT_EQ(std::bit_cast<uint32_t>(out->floats("D")[n]), std::bit_cast<uint32_t>(D->floats("D")[n]));
  }
  const auto out = kept(D, g, 0.5f, -12);
  for (size_t n = 0; n < e.elements(); ++n) ASSERT_LE(out->floats("D")[n], D->floats("D")[n]) << "it only adds shadow";
}

TEST(StyleKeep, HasNoSeamAtTheFormerEdge) {
  const Extent e{40, 80, 1};
  const auto D = distances(e, [](double, double y) { return std::abs(y - 40) - 8; });
  const auto out = plane(kept(D, planeGBuffer(view(e)), 0.5f, -12));
  for (int y = 0; y + 1 < 80; ++y) {
    const float step = (out[size_t((y + 1) * 40 + 20)] - out[size_t(y * 40 + 20)]) / kPixel;
    EXPECT_NEAR(std::abs(step), 1.0f, 0.01f) << y;
    EXPECT_NEAR(out[size_t(y * 40 + 20)] / kPixel, std::abs(y - 40) - 4 - 12, 0.01) << "a distance to what is kept, less the inflation";
  }
}

TEST(StyleKeep, IsOfTheNearestDiscOneByOne) {
  const Extent e{90, 80, 1};
  const auto g = planeGBuffer(view(e));
  const auto V =
      floatTerm(e, "V", [](int x, int y, int) { return std::sin(0.13 * x) * std::cos(0.11 * y) + 0.4 * std::sin(0.005 * x * y) < 0.1 ? 0.0f : 1.0f; });
  StyleDistanceSettings d;
  d.extent = e;
  const TermPtr D = runFilter(makeStyleDistanceNode(d), {V, g});
  const float keep = 0.4f, i = -9;
  const auto r = plane(halfWidths(D, g), "half_width"), out = plane(kept(D, g, keep, i)), from = plane(D);
  std::vector<size_t> thin;
  for (size_t y = 0; y < e.elements(); ++y)
    if (r[y] > 0 && -from[y] * (1 - keep) < -i * kPixel) thin.push_back(y);
  EXPECT_GT(thin.size(), 100u);
  double off = 0;
  size_t different = 0;
  for (size_t x = 0; x < e.elements(); ++x) {
    double least = HUGE_VAL, value = 0;
    for (const size_t y : thin) {
      const double far = std::hypot(double(x % 90) - double(y % 90), double(x / 90) - double(y / 90)) * double(kPixel) - double(keep * r[y]);
      if (far < least) least = far, value = double(i * kPixel) - double(from[y] / r[y]) * far;
    }
    const double exact = std::min(double(from[x]), value);
    off = std::max(off, std::abs(double(out[x]) - exact));
    different += std::abs(double(out[x]) - exact) > 1e-5;
  }
  EXPECT_LT(off, 1.0 * double(kPixel));
  EXPECT_LT(different, e.elements() / 50);
}

TEST(StyleKeep, VariesWithTheInflation) {
  const Extent e{80, 60, 1};
  const auto g = planeGBuffer(view(e));
  const auto D = distances(e, [](double, double y) { return std::abs(y - 30) - 6; });
  const auto r = halfWidths(D, g);
  const auto run = [&](const std::function<float(int)>& inflation) {
    const auto p = floatTerm(e, "inflation", [&](int x, int, int) { return kPixel * inflation(x); });
    return runFilter(makeStyleKeepNode({e, kPi / 4, 0.5f, 0, true}), {D, r, g, p});
  };
  const auto same = run([](int) { return -9.0f; }), constant = kept(D, g, 0.5f, -9);
  const auto halves = run([](int x) { return x < 40 ? -9.0f : 2.0f; });
  for (size_t k = 0; k < e.elements(); ++k) {
    ASSERT_EQ(same->floats("D")[k], constant->floats("D")[k]);
    ASSERT_EQ(halves->floats("D")[k], k % 80 < 40 && std::abs(int(k / 80) - 30) < 12 && k % 80 < 25 ? constant->floats("D")[k] : halves->floats("D")[k]);
    if (k % 80 >= 40) { ASSERT_EQ(halves->floats("D")[k], D->floats("D")[k]) << "where it is inflated nothing is kept"; }
  }
}

TEST(StyleKeep, AnyNoiseEndsWithTheSameBitsForAllThreads) {
  const Extent e{61, 47, 3};
  auto g = planeGBuffer(view(e));
  for (size_t k = 0; k < e.elements(); k += 11) g->writable<uint32_t>("instance")[k] = ~0u;
  const auto D = noiseTerm(e, "D", 9);
  for (size_t k = 0; k < e.elements(); ++k) {
    float& d = D->writable<float>("D")[k];
    d = k % 11 == 0 ? kStyleFar : k % 41 == 0 ? -kStyleFar : d - 0.5f;
  }
  const auto one = kept(D, g, 0.5f, -3, 1), many = kept(D, g, 0.5f, -3, 4);
  for (size_t k = 0; k < e.elements(); ++k) {
    ASSERT_TRUE(std::isfinite(one->floats("D")[k]));
    ASSERT_EQ(std::bit_cast<uint32_t>(one->floats("D")[k]), std::bit_cast<uint32_t>(many->floats("D")[k]));
  }
  const auto dark = floatTerm(e, "D", [](int, int, int) { return -kStyleFar; });  // no contour anywhere: nothing to keep
  for (const float r : plane(halfWidths(dark, g), "half_width")) ASSERT_EQ(r, 0.0f);
  for (const float d : plane(kept(dark, g, 0.5f, -3))) ASSERT_EQ(d, -kStyleFar);
}

}  // namespace stylised_keep_test
}  // namespace gobo
