// SPDX-License-Identifier: Apache-2.0
// KnownErrors against pictures whose error is b^2 + v / n by construction.
#include "plan/known_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gobo::testing {
namespace {

v1::RenderReply replyOf(const std::string& scene, uint32_t spp, double noise, double rmse = -1) {
  v1::RenderReply r;
  r.mutable_resolved()->set_scene_hash(scene);
  r.mutable_resolved()->mutable_halt()->set_spp(spp);
  r.set_standard_error(noise);
  if (rmse >= 0) r.mutable_certificate()->set_rmse(rmse);
  return r;
}
double rmse(double stays, double variance, double n) { return std::sqrt(stays * stays + variance / n); }

TEST(KnownErrors, NoiseFallsWithTheRootOfSamples) {
  KnownErrors known;
  const v1::RenderReply r = replyOf("a", 64, 0.5);
  EXPECT_EQ(known.at(r.resolved(), 64, true).from, "");
  known.add(r);
  EXPECT_DOUBLE_EQ(known.at(r.resolved(), 64, true).standardError, 0.5);
  EXPECT_DOUBLE_EQ(known.at(r.resolved(), 16, false).standardError, 1.0);
  EXPECT_EQ(known.at(r.resolved(), 16, true).rmse, 0.0);
}

TEST(KnownErrors, TwoCertificatesTellWhatStays) {
  KnownErrors known;
  const double stays = 0.03, variance = 0.7;
  for (const uint32_t n : {16u, 256u}) known.add(replyOf("a", n, 0, rmse(stays, variance, n)));
  for (const uint32_t n : {1u, 64u, 100000u}) {
    const ExpectedError e = known.at(replyOf("a", n, 0).resolved(), n, false);
    EXPECT_NEAR(e.rmse, rmse(stays, variance, n), 1e-9) << n;
    EXPECT_NEAR(e.standardError, std::sqrt(variance / n), 1e-9) << n;
    // Where nothing stays the later of the two, with more samples, is all noise.
    EXPECT_NEAR(known.at(replyOf("a", n, 0).resolved(), n, true).rmse, rmse(stays, variance, 256) * std::sqrt(256.0 / n), 1e-9) << n;
  }
  // The order in which they came does not matter, and a third takes the first one's place.
  KnownErrors other;
  for (const uint32_t n : {4u, 256u, 16u}) other.add(replyOf("a", n, 0, n == 4 ? 9.0 : rmse(stays, variance, n)));
  EXPECT_NEAR(other.at(replyOf("a", 1, 0).resolved(), 64, false).rmse, rmse(stays, variance, 64), 1e-9);
}

TEST(KnownErrors, OneCertificateIsNoiseOrStaysAsItWas) {
  KnownErrors known;
  known.add(replyOf("a", 16, 0, 0.4));
  const v1::RenderRequest r = replyOf("a", 64, 0).resolved();
  EXPECT_DOUBLE_EQ(known.at(r, 64, true).rmse, 0.2);
  EXPECT_DOUBLE_EQ(known.at(r, 64, true).standardError, 0.2);
  EXPECT_DOUBLE_EQ(known.at(r, 64, false).rmse, 0.4);
  EXPECT_EQ(known.at(r, 64, false).standardError, 0.0);
  known.add(replyOf("a", 16, 0.3));  // snapshots say how much of it is noise
  EXPECT_NEAR(known.at(r, 64, false).rmse, std::sqrt(0.4 * 0.4 - 0.3 * 0.3 + 0.15 * 0.15), 1e-12);
  EXPECT_NEAR(known.at(r, 64, false).standardError, 0.15, 1e-12);
}

TEST(KnownErrors, TheLatestCertificateOfAsManySamplesTakesTheOthersPlace) {
  KnownErrors known;
  for (const double rmse : {0.4, 0.3, 0.2}) known.add(replyOf("a", 16, 0, rmse));
  const v1::RenderRequest r = replyOf("a", 64, 0).resolved();
  EXPECT_DOUBLE_EQ(known.at(r, 64, true).rmse, 0.1);
  EXPECT_DOUBLE_EQ(known.at(r, 64, false).rmse, 0.2);
  EXPECT_EQ(known.at(r, 64, false).from, "certificates of this picture, 16 samples");
}

TEST(KnownErrors, NoPartIsNegative) {
  KnownErrors worse;  // with more samples: by chance, nothing of it is noise
  worse.add(replyOf("a", 16, 0, 0.1));
  worse.add(replyOf("a", 64, 0, 0.2));
  const v1::RenderRequest r = replyOf("a", 64, 0).resolved();
  EXPECT_DOUBLE_EQ(worse.at(r, 1024, false).rmse, 0.2);
  EXPECT_EQ(worse.at(r, 1024, false).standardError, 0.0);
  KnownErrors better;  // by more than noise can
  better.add(replyOf("a", 16, 0, 0.8));
  better.add(replyOf("a", 64, 0, 0.1));
  EXPECT_DOUBLE_EQ(better.at(r, 64 * 4, false).rmse, 0.05);
  KnownErrors noisy;  // snapshots that say more than the certificate
  noisy.add(replyOf("a", 16, 0.9, 0.1));
  EXPECT_NEAR(noisy.at(r, 64, false).rmse, 0.05, 1e-12);
  KnownErrors exact;
  exact.add(replyOf("a", 16, 0, 0.0));
  EXPECT_EQ(exact.at(r, 64, true).rmse, 0.0);
}

TEST(KnownErrors, OtherPicturesOfTheSceneTellNoiseAlone) {
  KnownErrors known;
  known.add(replyOf("a", 16, 0.4, 0.5));
  v1::RenderRequest r = replyOf("a", 64, 0).resolved();
  r.set_seed(9), r.set_width(7), r.mutable_encoding()->set_format(v1::Encoding::PNG);
  EXPECT_GT(known.at(r, 64, false).rmse, 0.0) << "the same picture";
  r.mutable_integrator()->set_max_bounces(1);
  EXPECT_EQ(known.at(r, 64, false).rmse, 0.0);
  EXPECT_DOUBLE_EQ(known.at(r, 64, false).standardError, 0.2);
  EXPECT_EQ(known.at(r, 64, false).from, "snapshots of another picture of this scene, 16 samples");
  r.set_scene_hash("b");
  EXPECT_EQ(known.at(r, 64, false).from, "");
}

TEST(KnownErrors, KeepsSoManyAndTheLatest) {
  KnownErrors known(4);
  for (int i = 0; i < 6; ++i) {
    known.add(replyOf("first", 16, 0.4));  // used all the time: a scene and a picture
    known.add(replyOf("scene " + std::to_string(i), 16, 0.4));
  }
  EXPECT_NE(known.at(replyOf("first", 1, 0).resolved(), 1, true).from, "");
  EXPECT_NE(known.at(replyOf("scene 5", 1, 0).resolved(), 1, true).from, "");
  EXPECT_EQ(known.at(replyOf("scene 4", 1, 0).resolved(), 1, true).from, "");
}

TEST(KnownErrors, WhatIsNoNumberTellsNothing) {
  KnownErrors known;
  known.add(replyOf("a", 0, 0.4));
  known.add(replyOf("a", 16, std::nan("")));
  known.add(replyOf("a", 16, 0, std::numeric_limits<double>::infinity()));
  known.add(replyOf("a", 16, std::numeric_limits<double>::infinity()));
  EXPECT_EQ(known.at(replyOf("a", 16, 0).resolved(), 16, true).from, "");
}

}  // namespace
}  // namespace gobo::testing
