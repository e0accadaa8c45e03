// SPDX-License-Identifier: Apache-2.0
// Temporal accumulation: closed forms of noise, cameras that pan, what comes into view, lights that move, broken numbers.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "filters/denoise/temporal/neighbourhood.h"
#include "filters/denoise/temporal/temporal.h"
#include "noisy_pictures.h"

namespace gobo {
namespace denoise_temporal_test {

using denoise::NoisyPicture;
using denoise::TemporalAccumulator;
using denoise::TemporalFrame;
using denoise::TemporalSettings;
using tests::gaussian;

/// A frame that owns its planes.
struct Made {
  int width, height;
  Camera camera;
  std::vector<float> light, variance, position, normal, coverage, footprint, object;
  Made(int w, int h) : width(w), height(h) {
    const size_t n = size_t(w) * size_t(h);
    for (auto* v : {&light, &variance, &position, &normal}) v->assign(3 * n, 0.0f);
    for (auto* v : {&coverage, &footprint, &object}) v->assign(n, 0.0f);
  }
  size_t pixels() const { return coverage.size(); }
  TemporalFrame frame() const {
    TemporalFrame f;
    NoisyPicture& p = f.picture;
    p.width = width;
    p.height = height;
    p.mean = p.a = p.b = light;
    p.variance = variance;
    p.position = position;
    p.normal = normal;
    p.coverage = coverage;
    p.footprint = footprint;
    f.camera = camera;
    f.object = object;
    return f;
  }
};

/// What a ray meets: object 0 for nothing.
struct Hit {
  int object = 0;
  Vec3 position{0.0f}, normal{0.0f};
  float distance = 0;
};
using World = std::function<Hit(const Ray&)>;
using Light = std::function<float(const Hit&)>;

Made look(const Camera& camera, int width, int height, const World& world, const Light& light) {
  Made m(width, height);
  m.camera = camera;
  for (size_t i = 0; i < m.pixels(); ++i) {
    const Hit hit = world(cameraRay(camera, width, height, float(i % size_t(width)) + 0.5f, float(i / size_t(width)) + 0.5f));
    m.object[i] = float(hit.object);
    m.coverage[i] = hit.object ? 1.0f : 0.0f;
    m.footprint[i] = hit.object ? pixelFootprint(camera, height, hit.distance) : 0.0f;
    for (size_t c = 0; c < 3; ++c) {
      m.light[3 * i + c] = light(hit);
      m.position[3 * i + c] = hit.position[int(c)];
      m.normal[3 * i + c] = hit.normal[int(c)];
    }
  }
  return m;
}

/// Looks down on the plane z = 0 from (x, y, 10); a pixel is 1 m wide at `height` of them.
Camera above(float x, float y, int height) {
  Camera c;
  c.perspective = false;
  c.yheight = float(height);
  c.toWorld[3] = Vec4(x, y, 10.0f, 1.0f);
  return c;
}
Hit floorHit(const Ray& ray) {
  const float t = -ray.origin.z / ray.direction.z;
  return {1, ray.origin + ray.direction * t, Vec3(0, 0, 1), t};
}

void add(TemporalAccumulator& into, const Made& m, int threads = 2) { EXPECT_TRUE(into.add(m.frame(), TaskArena(threads))); }

// Nothing moves: the mean of all frames, then a moving one; noise 1/n, then a / (2 - a). Against sums in double, and against the scatter over pixels.
TEST(Temporal, AtRestItIsTheRunningMeanAndThenAMovingOne) {
  const int width = 61, height = 47, frames = 60;
  const double least = 0.1, sigma = 0.5;
  TemporalSettings s;
  s.leastShare = float(least);
  TemporalAccumulator t(s);
  Made m = look(above(0, 0, height), width, height, floorHit, [](const Hit&) { return 0.0f; });
  std::fill(m.variance.begin(), m.variance.end(), float(sigma * sigma));
  std::vector<double> sum(m.light.size(), 0.0), moving(m.light.size(), 0.0);
  double v = sigma * sigma;
  for (int n = 1; n <= frames; ++n) {
    for (size_t i = 0; i < m.light.size(); ++i) {
      m.light[i] = float(2 + sigma * gaussian(i, uint64_t(n)));
      sum[i] += m.light[i];
      moving[i] = n <= 10 ? sum[i] / n : moving[i] + least * (m.light[i] - moving[i]);
    }
    if (n > 10) v = (1 - least) * (1 - least) * v + least * least * sigma * sigma;
    else v = sigma * sigma / n;
    add(t, m);
    double scatter = 0;
    for (size_t i = 0; i < m.light.size(); ++i) {
      ASSERT_NEAR(t.light()[i], moving[i], 2e-6) << n;
      ASSERT_NEAR(t.variance()[i], v, 1e-5 * v) << n;
      scatter += (t.light()[i] - 2.0) * (t.light()[i] - 2.0);
    }
    EXPECT_NEAR(scatter / double(m.light.size()), v, 0.06 * v) << n;  // its own relative error is 1.5 %
    EXPECT_EQ(t.frames()[0], float(n));
  }
  EXPECT_NEAR(v, sigma * sigma * least / (2 - least), 1e-4 * v);
}

// A camera that pans by whole pixels: stripes one pixel wide stay as they are, and only what comes into view starts anew.
TEST(Temporal, PanningByWholePixelsKeepsDetailAndHistory) {
  const int width = 24, height = 9;
  TemporalAccumulator t({});
  const auto stripes = [](const Hit& h) { return float((int(std::floor(h.position.x + 1000.25f)) % 2 + 2) % 2); };
  for (int n = 0; n < 6; ++n) {
    const Made m = look(above(float(2 * n), 0, height), width, height, floorHit, stripes);
    add(t, m);
    for (size_t i = 0; i < m.pixels(); ++i) {
      ASSERT_NEAR(t.light()[3 * i], m.light[3 * i], 1e-5) << n << " " << i;
      ASSERT_FLOAT_EQ(t.frames()[i], float(std::min(n, (width - 1 - int(i % size_t(width))) / 2) + 1)) << n << " " << i;
    }
  }
}

// By parts of a pixel, in perspective: light that is affine on the floor comes out as it is, since bilinear interpolation keeps it.
TEST(Temporal, PanningByPartsOfAPixelKeepsGradients) {
  const int width = 40, height = 31;
  TemporalAccumulator t({});
  for (int n = 0; n < 8; ++n) {
    Camera c = above(0.37f * float(n), -0.21f * float(n), height);
    c.perspective = true;
    c.yfov = 2.0f * std::atan(float(height) / 20.0f);  // a pixel is 1 m wide on the floor
    const Made m = look(c, width, height, floorHit, [](const Hit& h) { return 3 + 0.1f * h.position.x - 0.2f * h.position.y; });
    add(t, m);
    for (int y = 9; y < height - 9; ++y)  // what enters the picture has no neighbours beyond it; that goes a pixel a frame inwards
      for (int x = 9; x < width - 9; ++x) {
        const size_t i = size_t(y * width + x);
        ASSERT_NEAR(t.light()[3 * i], m.light[3 * i], 1e-4) << n;
        ASSERT_NEAR(t.frames()[i], n + 1, 1e-5);
      }
  }
}

/// A card 4 m above the floor, 6 m wide and endlessly high, seen in perspective from 10 m. `objects`: with indices; else depth has to tell.
struct CardView {
  static constexpr int kWidth = 48, kHeight = 12;
  static Camera camera(float x) {
    Camera c = above(x, 0, kHeight);
    c.perspective = true;
    c.yfov = 2.0f * std::atan(float(kHeight) / 20.0f);
    return c;
  }
  static Hit world(const Ray& ray) {
    const float t = (4.0f - ray.origin.z) / ray.direction.z;
    const Vec3 at = ray.origin + ray.direction * t;
    if (std::abs(at.x) < 3.0f) return {2, at, Vec3(0, 0, 1), t};
    return floorHit(ray);
  }
  static Made look(float x, bool objects) {
    Made m = denoise_temporal_test::look(camera(x), kWidth, kHeight, world, [](const Hit& h) { return h.object == 2 ? 100.0f : 1.0f; });
    if (!objects) m.object.clear();
    return m;
  }
};

// The camera goes past a card: no pixel takes light of what is behind or before it, and floor that the card hid starts anew.
TEST(Temporal, WhatComesIntoViewStartsAnewAndEdgesTakeNothingFromBehind) {
  for (const bool objects : {false, true}) {
    TemporalSettings settings;
    settings.surface.planePixels = 1;  // pixels at the picture's side are 2.2 m wide, the card is 4 m above
    TemporalAccumulator t(settings);
    for (int n = 0; n < 4; ++n) {
      const float x = 5.0f * float(n), before = x - 5.0f;
      const Made m = CardView::look(x, objects);
      add(t, m);
      int hidden = 0, kept = 0;
      for (size_t i = 0; i < m.pixels(); ++i) {
        const bool card = m.position[3 * i + 2] > 1.0f;
        ASSERT_EQ(t.light()[3 * i], card ? 100.0f : 1.0f) << n << " " << i;
        if (n == 0) continue;
        // Was the floor here hidden, more than a pixel within the card's outline? The card is seen as 10 m wide on the floor.
        const float onFloor = m.position[3 * i] - before, left = (-3.0f - before) / 0.6f, right = (3.0f - before) / 0.6f;
        if (!card && onFloor > left + 1.01f && onFloor < right - 1.01f) {
          EXPECT_EQ(t.frames()[i], 1.0f) << i;
          ++hidden;
        } else if (!card && std::abs(onFloor) < 20 && (onFloor < left - 1.01f || onFloor > right + 1.01f)) {
          EXPECT_GT(t.frames()[i], 1.0f) << i;
          ++kept;
        }
      }
      if (n > 0) { EXPECT_GT(kept, 100); }
      if (n > 0 && n < 3) {
        EXPECT_GE(hidden, 2 * CardView::kHeight);  // of 3.3 columns that come into view
      }
    }
  }
}

/// Position and normal of pixel p of one frame against the same pixel of another.
bool same(const Made& a, const Made& b) {
  const auto seen = [](const Made& m) { return denoise::SeenSurfaces{m.width, m.height, m.position, m.normal, m.coverage, m.footprint, m.object}; };
  const bool forth = denoise::sameSurface(seen(a), 0, seen(b), 0, {}), back = denoise::sameSurface(seen(b), 0, seen(a), 0, {});
  EXPECT_EQ(forth, back);
  return forth;
}

// Each test of a surface by itself.
TEST(Temporal, SurfacesAreToldApart) {
  const auto one = [](Vec3 position, Vec3 normal, float object) {
    Made m(1, 1);
    m.coverage = {1.0f};
    m.footprint = {0.1f};
    m.object = {object};
    m.position = {position.x, position.y, position.z};
    m.normal = {normal.x, normal.y, normal.z};
    return m;
  };
  const Made m = one(Vec3(0), Vec3(0, 0, 1), 1);
  EXPECT_TRUE(same(m, m));
  EXPECT_TRUE(same(m, one(Vec3(5, 0, 0.19f), Vec3(0, 0, 1), 1)));  // along the plane any way
  EXPECT_FALSE(same(m, one(Vec3(5, 0, 0.21f), Vec3(0, 0, 1), 1)));
  EXPECT_FALSE(same(m, one(Vec3(0), Vec3(0, 0, 1), 2)));
  const auto turned = [&](float radians) { return one(Vec3(0), Vec3(std::sin(radians), 0, std::cos(radians)), 1); };
  EXPECT_TRUE(same(m, turned(0.44f)));  // acos 0.9 = 0.451
  EXPECT_FALSE(same(m, turned(0.46f)));
  // In the first one's plane, off the other's: 1 m sin 0.4.
  EXPECT_FALSE(same(m, one(Vec3(1, 0, 0), Vec3(std::sin(0.4f), 0, std::cos(0.4f)), 1)));
  EXPECT_TRUE(same(m, one(Vec3(0, 0, 0.15f), Vec3(0, 0, 0.2f), 1)));  // normals that differ within a pixel are shorter; the plane is the same
  const Made nowhere = one(Vec3(0), Vec3(0), 1);
  EXPECT_TRUE(same(nowhere, one(Vec3(0.19f, 0, 0), Vec3(0, 0, 1), 1)));
  EXPECT_FALSE(same(nowhere, one(Vec3(0.21f, 0, 0), Vec3(0, 0, 1), 1)));
  Made nothing = m;
  nothing.coverage = {0.0f};
  EXPECT_FALSE(same(m, nothing));
  EXPECT_TRUE(same(nothing, nothing));
  EXPECT_FALSE(same(m, one(Vec3(0, 0, std::numeric_limits<float>::quiet_NaN()), Vec3(0, 0, 1), 1)));
}

// The edge of a shadow goes 2 pixels a frame over the floor. Without clamping the light stays behind, by the closed form of the weights; with it, no error is
// larger than what the neighbourhood leaves open, and where the window is even there is none.
TEST(Temporal, MovingLightLeavesGhostsAndClampingBoundsThem) {
  const int width = 64, height = 9, last = 20, radius = 3;
  const auto frame = [&](int n) {
    return look(above(0, 0, height), width, height, floorHit, [&](const Hit& h) { return h.position.x + 32.0f < float(10 + 2 * n) ? 1.0f : 0.0f; });
  };
  TemporalSettings s;
  TemporalAccumulator free(s);
  s.clampDeviations = 1;
  s.clampRadius = radius;
  TemporalAccumulator held(s);
  Made m = frame(0);
  for (int n = 0; n <= last; ++n) {
    m = frame(n);
    add(free, m);
    add(held, m);
  }
  const denoise::SeenSurfaces seen{m.width, m.height, m.position, m.normal, m.coverage, m.footprint, m.object};
  double ghost = 0, bounded = 0;
  for (size_t i = 0; i < m.pixels(); ++i) {
    const int x = int(i % size_t(width)), edge = 10 + 2 * last;
    // Lit since frame k: the share of the frames before, the mean of ten and a tenth each after that.
    const int k = std::max((x - 10) / 2 + 1, 0);
    double dark = 0;
    for (int n = 0; n <= last; ++n) dark += std::max(1.0 / (n + 1), 0.1) * ((x >= 10 && n < k ? 1.0 : 0.0) - dark);
    const double expected = 1.0 - dark;
    if (x < edge) { EXPECT_NEAR(free.light()[3 * i], expected, 1e-5) << x; }
    ghost = std::max(ghost, std::abs(double(free.light()[3 * i]) - m.light[3 * i]));
    const auto range = denoise::lightAround(seen, m.light, i, radius, s.surface);
    const double error = std::abs(double(held.light()[3 * i]) - m.light[3 * i]);
    EXPECT_LE(error, 0.9 * (std::abs(range.mean[0] - m.light[3 * i]) + std::sqrt(range.variance[0])) + 1e-6) << x;
    if (std::abs(x - edge + 0.5) > radius + 1) { EXPECT_EQ(error, 0.0) << x; }
    bounded += error;
  }
  EXPECT_GT(ghost, 0.8);
  EXPECT_GT(bounded, 0.0);  // it is bounded, not gone
}

// The range is that of the window's pixels of the same object, in double; a pixel alone has no spread, and its noise leaves room for history then.
TEST(Temporal, NeighbourhoodIsOfOneSurface) {
  Made m = look(above(0, 0, 5), 7, 5, floorHit, [](const Hit& h) { return 1000.0f + h.position.x; });
  m.object[2 * 7 + 2] = 9;
  m.light[3 * (1 * 7 + 1)] = std::numeric_limits<float>::infinity();
  const denoise::SeenSurfaces seen{m.width, m.height, m.position, m.normal, m.coverage, m.footprint, m.object};
  double sum = 0, squares = 0;
  int count = 0;
  for (int y = 1; y <= 3; ++y)
    for (int x = 1; x <= 3; ++x) {
      if ((x == 1 && y == 1) || (x == 2 && y == 2)) continue;
      const double v = m.light[size_t(3 * (y * 7 + x))];
      sum += v;
      squares += v * v;
      ++count;
    }
  const auto range = denoise::lightAround(seen, m.light, 2 * 7 + 3, 1, {});
  EXPECT_EQ(range.pixels, 8);
  const auto other = denoise::lightAround(seen, m.light, 2 * 7 + 2, 1, {});
  EXPECT_EQ(other.pixels, 1);
  EXPECT_EQ(other.variance[0], 0.0);
  EXPECT_EQ(other.mean[0], double(m.light[3 * (2 * 7 + 2)]));
  m.object[2 * 7 + 2] = 1;
  m.object[2 * 7 + 1] = 9;
  const auto third = denoise::lightAround({m.width, m.height, m.position, m.normal, m.coverage, m.footprint, m.object}, m.light, 2 * 7 + 2, 1, {});
  EXPECT_EQ(third.pixels, 7);
  sum += double(m.light[3 * (2 * 7 + 2)]) - double(m.light[3 * (2 * 7 + 1)]);
  squares += std::pow(double(m.light[3 * (2 * 7 + 2)]), 2) - std::pow(double(m.light[3 * (2 * 7 + 1)]), 2);
  EXPECT_NEAR(third.mean[0], sum / count, 1e-9);
  EXPECT_NEAR(third.variance[0], squares / count - sum * sum / count / count, 1e-6);

  Made lone(1, 1);
  lone.coverage = lone.footprint = {1.0f};
  lone.normal = {0, 0, 1};
  TemporalSettings s;
  s.clampDeviations = 2;
  TemporalAccumulator t(s);
  lone.light = {1, 1, 1};
  lone.variance = {0.25f, 0.25f, 0.25f};
  add(t, lone);
  lone.light = {5, 1.5f, 1};
  add(t, lone);
  EXPECT_FLOAT_EQ(t.light()[0], 4.5f);  // history 1 is held to 5 - 2 x 0.5
  EXPECT_FLOAT_EQ(t.light()[1], 1.25f);
}

// Odd sizes, pixels without a hit, numbers that are not finite: everything that comes out is finite, and a broken frame leaves the history as it is.
TEST(Temporal, AnySizeAndAnyNumber) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  for (const auto& [width, height] : {std::pair<int, int>{1, 1}, {3, 1}, {1, 5}, {5, 7}}) {
    for (const float clamp : {0.0f, 1.0f}) {
      TemporalSettings s;
      s.clampDeviations = clamp;
      TemporalAccumulator t(s);
      const World half = [](const Ray& r) { return r.origin.x + r.direction.x > 0.4f ? floorHit(r) : Hit(); };
      for (int n = 0; n < 4; ++n) {
        Camera c = above(n == 3 ? 0.5f : 0.0f, 0, height);
        c.perspective = n % 2 == 1;
        Made m = look(c, width, height, half, [](const Hit&) { return 1.0f; });
        const float bad[] = {nan, inf, -inf, 3e38f};
        for (size_t i = 0; i < m.pixels(); ++i) {
          m.light[3 * i + size_t(n) % 3] = bad[(i + size_t(n)) % 4];
          m.variance[3 * i] = bad[i % 4];
          if (i % 3 == 1) m.position[3 * i] = bad[n];
          if (i % 5 == 2) m.normal[3 * i] = bad[n];
        }
        add(t, m);
        for (const auto plane : {t.light(), t.frames()})
          for (const float v : plane) ASSERT_LE(std::abs(v), 1e18f) << width << "x" << height << " " << n;  // not of a NaN either
        for (const float v : t.variance()) ASSERT_LE(std::abs(v), 1e36f) << width << "x" << height << " " << n;
      }
    }
  }
  TemporalAccumulator t({});
  Made m = look(above(0, 0, 3), 5, 3, floorHit, [](const Hit&) { return 2.0f; });
  Made broken = m;
  std::fill(broken.light.begin(), broken.light.end(), nan);
  add(t, broken);
  EXPECT_EQ(t.frames()[7], 0.0f);
  EXPECT_EQ(t.light()[21], 0.0f);
  add(t, m);  // the black of the broken one is not in it
  EXPECT_EQ(t.light()[21], 2.0f);
  add(t, broken);
  EXPECT_EQ(t.light()[21], 2.0f);
  EXPECT_EQ(t.frames()[7], 1.0f);
  const Made wider = look(above(0, 0, 3), 6, 3, floorHit, [](const Hit&) { return 4.0f; });
  add(t, wider);  // another size starts anew
  EXPECT_EQ(t.light()[21], 4.0f);
  EXPECT_EQ(t.picture(wider.frame().picture).mean.data(), t.light().data());
}

// The background moves as what is infinitely far: turning the camera keeps it, going does not move it.
TEST(Temporal, BackgroundIsInfinitelyFar) {
  const int width = 33, height = 21;
  const World sky = [](const Ray&) { return Hit(); };
  TemporalAccumulator t({});
  for (int n = 0; n < 4; ++n) {
    Camera c = above(3.0f * float(n), 0, height);
    c.perspective = true;
    Made m = look(c, width, height, sky, [](const Hit&) { return 1.0f; });
    m.light[3 * 200] = 8.0f;
    add(t, m);
    EXPECT_NEAR(t.light()[3 * 200], 8.0f, 1e-3);  // directions are in float
    EXPECT_NEAR(t.light()[3 * 201], 1.0f, 1e-3);
    EXPECT_NEAR(t.frames()[200], n + 1, 1e-3);
  }
  TemporalAccumulator flat({});  // an orthographic camera sees no direction move, but at rest
  for (int n = 0; n < 3; ++n) add(flat, look(above(n < 2 ? 0.0f : 1.0f, 0, height), width, height, sky, [](const Hit&) { return 1.0f; }));
  EXPECT_EQ(flat.frames()[0], 1.0f);
  add(flat, look(above(1, 0, height), width, height, sky, [](const Hit&) { return 1.0f; }));
  EXPECT_EQ(flat.frames()[0], 2.0f);
  Camera turned = above(0, 0, height);
  turned.perspective = true;
  const float by = 2.0f * std::atan(std::tan(0.5f * turned.yfov) * float(width) / float(height));  // all that is seen, and nothing of it again
  turned.toWorld = Mat4(Vec4(std::cos(by), 0, -std::sin(by), 0), Vec4(0, 1, 0, 0), Vec4(std::sin(by), 0, std::cos(by), 0), Vec4(0, 0, 10, 1));
  const Made m = look(turned, width, height, sky, [](const Hit&) { return 1.0f; });
  add(t, m);
  EXPECT_EQ(t.frames()[10 * width + 16], 1.0f);
}

// Any number of threads has the same bits; a stop leaves the history.
TEST(Temporal, ThreadsAndStops) {
  std::vector<float> first;
  for (const int threads : {1, 3}) {
    TemporalSettings s;
    s.clampDeviations = 1;
    TemporalAccumulator t(s);
    for (int n = 0; n < 4; ++n) {
      Made m = CardView::look(0.7f * float(n), true);
      for (size_t i = 0; i < m.light.size(); ++i) m.light[i] += 0.3f * float(gaussian(i, uint64_t(50 + n)));
      add(t, m, threads);
    }
    std::vector<float> all(t.light().begin(), t.light().end());
    all.insert(all.end(), t.variance().begin(), t.variance().end());
    if (first.empty()) first = all;
    else EXPECT_EQ(first, all);
    StopSource source;
    source.stop(StopReason::Cancelled);
    EXPECT_FALSE(t.add(CardView::look(9, true).frame(), TaskArena(threads), source.token()));
    EXPECT_EQ(std::vector<float>(t.light().begin(), t.light().end()), std::vector<float>(first.begin(), first.begin() + ptrdiff_t(t.light().size())));
  }
}

}  // namespace denoise_temporal_test
}  // namespace gobo
