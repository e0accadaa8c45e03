// SPDX-License-Identifier: Apache-2.0
// Packets of 16 rays of which some lanes are not meant, on the processor's own kernels and on those of processors without AVX-512, where Embree 3 takes a
// packet for a stream and does not read its mask (found where every path trace ended the process).
#include "trace/embree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

namespace gobo::testing {
namespace {

constexpr int kPacket = 16;
constexpr float kInfinite = std::numeric_limits<float>::infinity(), kNan = std::numeric_limits<float>::quiet_NaN();

class EmbreeLanes : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    device_ = rtcNewDevice(GetParam());
    ASSERT_TRUE(device_);
    scene_ = rtcNewScene(device_);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    const RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    std::uniform_real_distribution<float> place(-1, 1), size(-0.3f, 0.3f);
    auto* corners = static_cast<float*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * kTriangles));
    auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, kTriangles));
    for (uint32_t t = 0; t < kTriangles; ++t) {
      const float centre[3] = {place(random_), place(random_), place(random_)};
      for (uint32_t k = 0; k < 9; ++k) corners[9 * t + k] = centre[k % 3] + size(random_);
      for (uint32_t k = 0; k < 3; ++k) indices[3 * t + k] = 3 * t + k;
    }
    rtcCommitGeometry(g);
    rtcAttachGeometryByID(scene_, g, 0);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene_);
    embree::initContext(context_);
  }
  void TearDown() override {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  /// Rays through the triangles, in all lanes; then in those that are not valid what a kernel's registers may hold.
  RTCRayHit16 packet(int* valid) {
    RTCRayHit16 r;
    std::memset(&r, 0, sizeof r);
    std::uniform_real_distribution<float> place(-1, 1);
    for (int i = 0; i < kPacket; ++i) {
      valid[i] = random_() % 2 ? -1 : 0;
      r.ray.org_x[i] = 2 * place(random_), r.ray.org_y[i] = 2 * place(random_), r.ray.org_z[i] = 3;
      r.ray.dir_x[i] = 0.3f * place(random_), r.ray.dir_y[i] = 0.3f * place(random_), r.ray.dir_z[i] = -1;
      r.ray.tfar[i] = 10;
      r.ray.mask[i] = ~0u;
      r.hit.geomID[i] = r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      if (valid[i]) continue;
      const float junk[] = {kNan, kInfinite, -kInfinite, 1e-45f, 3e38f};
      switch (random_() % 5) {
        case 0: r.ray.org_x[i] = junk[random_() % 5]; break;
        case 1: r.ray.dir_y[i] = junk[random_() % 5]; break;
        case 2: r.ray.tfar[i] = junk[random_() % 5]; break;
        case 3: r.ray.tnear[i] = junk[random_() % 5]; break;
        default: break;  // would hit what the others may
      }
    }
    return r;
  }
  static constexpr uint32_t kTriangles = 400;
  std::mt19937 random_{41};
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
  embree::Context context_;
};

bool sameBits(float a, float b) { return std::memcmp(&a, &b, sizeof a) == 0; }

TEST_P(EmbreeLanes, LanesThatAreNotMeantAreLeftAsTheyAre) {
  int hits = 0, misses = 0;
  for (int round = 0; round < 200; ++round) {
    alignas(64) int valid[kPacket];
    alignas(64) const RTCRayHit16 before = packet(valid);
    alignas(64) RTCRayHit16 after = before;
    embree::intersect16(valid, scene_, context_, after, round % 2 == 0);
    for (int i = 0; i < kPacket; ++i) {
      SCOPED_TRACE(i);
      EXPECT_TRUE(sameBits(after.ray.tnear[i], before.ray.tnear[i]));
      if (!valid[i]) {
        EXPECT_TRUE(sameBits(after.ray.tfar[i], before.ray.tfar[i]));
        EXPECT_EQ(after.hit.geomID[i], before.hit.geomID[i]);
        continue;
      }
      RTCRayHit one;
      one.ray = {
          before.ray.org_x[i], before.ray.org_y[i], before.ray.org_z[i], 0, before.ray.dir_x[i], before.ray.dir_y[i], before.ray.dir_z[i], 0, 10, ~0u, 0, 0};
      one.hit.geomID = one.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      embree::intersect1(scene_, context_, one, false);
      EXPECT_EQ(after.hit.geomID[i], one.hit.geomID);
      EXPECT_EQ(after.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID, after.ray.tfar[i] == 10.0f);
      if (one.hit.geomID != RTC_INVALID_GEOMETRY_ID) EXPECT_NEAR(after.ray.tfar[i], one.ray.tfar, 1e-5f);
      ++(one.hit.geomID != RTC_INVALID_GEOMETRY_ID ? hits : misses);
    }
  }
  EXPECT_GT(hits, 300);
  EXPECT_GT(misses, 300);
}

TEST_P(EmbreeLanes, ShadowRaysThatAreNotMeantAreLeftAsTheyAre) {
  int blocked = 0;
  for (int round = 0; round < 200; ++round) {
    alignas(64) int valid[kPacket];
    alignas(64) const RTCRayHit16 before = packet(valid);
    alignas(64) RTCRay16 after = before.ray;
    embree::occluded16(valid, scene_, context_, after);
    for (int i = 0; i < kPacket; ++i) {
      SCOPED_TRACE(i);
      EXPECT_TRUE(sameBits(after.tnear[i], before.ray.tnear[i]));
      if (!valid[i]) {
        EXPECT_TRUE(sameBits(after.tfar[i], before.ray.tfar[i]));
        continue;
      }
      RTCRay one = {
          before.ray.org_x[i], before.ray.org_y[i], before.ray.org_z[i], 0, before.ray.dir_x[i], before.ray.dir_y[i], before.ray.dir_z[i], 0, 10, ~0u, 0, 0};
      embree::occluded1(scene_, context_, one);
      EXPECT_EQ(after.tfar[i] < 0, one.tfar < 0);
      blocked += after.tfar[i] < 0;
    }
  }
  EXPECT_GT(blocked, 300);
}

TEST_P(EmbreeLanes, WhatCannotBeTracedMeetsNothingAndHasNoLight) {
  alignas(64) int valid[kPacket];
  alignas(64) RTCRayHit16 r = packet(valid);
  for (int i = 0; i < kPacket; ++i) {
    valid[i] = -1;
    r.ray.tfar[i] = 10;
    r.ray.org_x[i] = i % 2 ? kNan : 0;
    r.ray.dir_y[i] = 0;
  }
  alignas(64) RTCRay16 shadow = r.ray;
  embree::intersect16(valid, scene_, context_, r, false);
  embree::occluded16(valid, scene_, context_, shadow);
  for (int i = 1; i < kPacket; i += 2) {
    EXPECT_EQ(r.hit.geomID[i], RTC_INVALID_GEOMETRY_ID);
    EXPECT_EQ(r.ray.tfar[i], 10.0f);
    EXPECT_LT(shadow.tfar[i], 0.0f);
  }
}

// Kernels: of the processor that runs, and by vectors of eight and of four.
INSTANTIATE_TEST_SUITE_P(Kernels, EmbreeLanes, ::testing::Values("", "isa=avx2", "isa=sse4.2"));

}  // namespace
}  // namespace gobo::testing
