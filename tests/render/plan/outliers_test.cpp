// SPDX-License-Identifier: Apache-2.0
// request.denoise.outliers, whatever the method: what it traces, what it leaves alone, what it takes out. Methods are drawn from the schema's choice.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/outliers/sample_estimators.h"
#include "plan/outliers.h"
#include "support/engines.h"
#include "support/thorough.h"
#include "trace/sample_passes.h"

namespace gobo {
namespace outlier_requests_test {

using testing::firstDifference;
using testing::makeEngine;
using testing::mustRender;
using testing::nodesBy;
using testing::set;
using testing::smallRequest;

std::vector<std::string> namesIn(const google::protobuf::Descriptor* d, const char* choice) {
  std::vector<std::string> names;
  const auto* oneof = d->FindOneofByName(choice);
  for (int i = 0; i < oneof->field_count(); ++i) names.push_back(oneof->field(i)->name());
  return names;
}
std::vector<std::string> methods() { return namesIn(v1::OutlierRejection::descriptor(), "method"); }
std::vector<std::string> filters() { return namesIn(v1::Denoise::descriptor(), "filter"); }

/// Settings by which no sample is an outlier.
const std::vector<std::vector<const char*>> kNothingRejected = {
    {"denoise.outliers.path_density.soft=1000000", "denoise.outliers.path_density.hard=1000000"},
    {"denoise.outliers.median_of_means.buckets=1"},
    {"denoise.outliers.trimmed.share=0"},
    {"denoise.outliers.reweighting=", "denoise.outliers.white=1000000000000"},
};

const Image& beauty(const RenderResult& r) { return r.images.at(0).image(); }

/// Root of the mean relative squared error.
double relative(const Image& a, const Image& truth) {
  double sum = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double d = double(a.data[i]) - truth.data[i];
    sum += d * d / (double(truth.data[i]) * truth.data[i] + 1e-2);
  }
  return std::sqrt(sum / double(a.data.size()));
}

/// Largest difference, relative where values are large.
double difference(const RenderResult& a, const RenderResult& b) {
  double most = a.images.size() == b.images.size() && !a.images.empty() ? 0 : 1e9;
  for (size_t k = 0; k < a.images.size() && k < b.images.size(); ++k) {
    const Image &x = a.images[k].image(), &y = b.images[k].image();
    if (x.data.size() != y.data.size()) return 1e9;
    for (size_t i = 0; i < x.data.size(); ++i) most = std::max(most, std::abs(double(x.data[i]) - y.data[i]) / (std::abs(double(x.data[i])) + 0.05));
  }
  return most;
}

uint64_t raysOf(const RenderResult& r, const std::string& label) {
  uint64_t rays = 0;
  for (const auto& [name, row] : nodesBy(r, v1::NodeReport::RUN)) rays += name.find(label) != std::string::npos ? row.rays() : 0;
  return rays;
}

// The samples are the path tracer's own: where none is rejected it is the picture that it would be, whatever gains, clusters, backgrounds, lobes and streams.
TEST(Outliers, WhereNoneIsRejectedItIsThePictureWithout) {
  const std::vector<std::pair<std::string, std::vector<const char*>>> cases = {
      {"cornell", {}},
      {"spheres", {"lights.key.gain=0.1,1,0.3"}},
      {"lights8", {"integrator.max_bounces=5", "integrator.light_selection=POWER"}},
      {"atrium", {"integrator.russian_roulette_start=1"}},
      {"lamps", {"integrator.max_groups=2", "lights.lamp0003.gain=0,5,0"}},
      {"spheres", {"environment.background=COLOR", "environment.background_color=0.1,0.2,0.7"}},
      {"cornell", {"outputs=beauty,direct,indirect,emission,diffuse,indirect_specular"}},
      {"lights8", {"outputs=beauty,variance,sample_count"}},
      {"cornell", {"integrator.at_view_samples=true", "view_samples=3"}},
      {"spheres", {"shadows.ray_traced.samples=2", "environment.background=TRANSPARENT"}},
      {"cornell", {"integrator.indirect=false"}},
  };
  size_t many = 0;
  for (const auto& [scene, edits] : cases) {
    for (const int spp : {1, 2, 8, 16, 48}) {
      if (spp < 16 && !edits.empty()) continue;
      if (spp > 16 && !edits.empty() && !testing::inSweep(many++, 5)) continue;
      SCOPED_TRACE(scene + " " + (edits.empty() ? "" : edits[0]) + ", " + std::to_string(spp) + " samples");
      const auto engine = makeEngine();
      v1::RenderRequest r = smallRequest(scene, 24, 16, spp);
      for (const char* e : edits) set(r, e);
      const RenderResult plain = mustRender(*engine, r);
      for (const auto& settings : kNothingRejected)
        for (const char* judged : {"INDIRECT", "APART"}) {
          v1::RenderRequest with = r;
          for (const char* e : settings) set(with, e);
          set(with, std::string("denoise.outliers.judged=") + judged);
          EXPECT_LT(difference(plain, mustRender(*engine, with)), 2e-4) << settings[0] << " " << judged;
        }
    }
  }
}

TEST(Outliers, EveryMethodTakesFirefliesOut) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 64, 48, 1024);
  set(r, "integrator.max_bounces=8");
  const RenderResult truth = mustRender(*engine, r);
  r.mutable_halt()->set_spp(16);
  const double plain = relative(beauty(mustRender(*engine, r)), beauty(truth));
  for (const std::string& method : methods()) {
    r.clear_denoise();
    set(r, "denoise.outliers=" + method);
    if (method == "trimmed") set(r, "denoise.outliers.trimmed.share=0.1");  // 1 % of 16 samples is next to nothing
    const double error = relative(beauty(mustRender(*engine, r)), beauty(truth));
    EXPECT_LT(error, 0.8 * plain) << method;
  }
}

TEST(Outliers, EveryFilterWorksBehindEveryMethod) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 80, 60, testing::thoroughOr(512, 256));
  const RenderResult truth = mustRender(*engine, r);
  r.mutable_halt()->set_spp(4);
  const double plain = relative(beauty(mustRender(*engine, r)), beauty(truth));
  for (const std::string& filter : filters()) {
    r.clear_denoise();
    set(r, "denoise=" + filter);
    const RenderResult alone = mustRender(*engine, r);
    if (filter == "axis_aligned") {  // it is told of each lobe's light by all samples
      set(r, "denoise.outliers=path_density");
      const auto refused = engine->render(r);
      ASSERT_FALSE(refused.ok());
      EXPECT_NE(refused.status().toString().find("request.denoise.outliers: not before axis_aligned"), std::string::npos) << refused.status().toString();
      continue;
    }
    for (const std::string& method : methods()) {
      set(r, "denoise.outliers=" + method);
      const RenderResult both = mustRender(*engine, r);
      EXPECT_NE(firstDifference(alone, both), "") << method << " " << filter;
      const double error = relative(beauty(both), beauty(truth));
      EXPECT_LT(error, plain) << method << " " << filter;
      const double most = filter == "auto" ? 1.5 : 1.15;  // alone it has axis-aligned filtering to choose from
      EXPECT_LT(error, most * relative(beauty(alone), beauty(truth))) << method << " " << filter;
    }
  }
}

// Indirect light is traced once, by the samples themselves, and direct light apart from it.
TEST(Outliers, WhatIsJudgedIsNotTracedTwice) {
  v1::RenderRequest r = smallRequest("cornell", 32, 24, 16);
  set(r, "denoise.outliers=path_density");
  const RenderResult result = mustRender(*makeEngine(), r);
  const auto ran = nodesBy(result, v1::NodeReport::RUN);
  EXPECT_TRUE(ran.count("beauty samples of indirect"));
  EXPECT_TRUE(ran.count("direct"));
  EXPECT_FALSE(ran.count("indirect"));
  EXPECT_FALSE(ran.count("path_trace"));
  EXPECT_GT(raysOf(result, "samples of"), 0u);
  // Of its halves a filter is told by what judged them all.
  const uint64_t alone = raysOf(result, "samples of");
  set(r, "denoise=wavelet");
  EXPECT_EQ(raysOf(mustRender(*makeEngine(), r), "samples of"), alone);
}

TEST(Outliers, LeavesAloneWhatIsNotJudged) {
  for (const std::string& method : methods()) {
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 4);
    for (const char* e : {"integrator.indirect=false", "shadows.ray_traced.samples=2", "outputs=beauty,emission,albedo"}) set(r, e);
    const RenderResult plain = mustRender(*engine, r);
    set(r, "denoise.outliers=" + method);
    EXPECT_EQ(firstDifference(plain, mustRender(*engine, r)), "") << method;
  }
  // Direct light only where it is asked for.
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 16);
  set(r, "outputs=direct,emission,indirect");
  set(r, "denoise.outliers.trimmed.share=0.5");
  v1::RenderRequest nothing = r;
  set(nothing, "denoise.outliers.trimmed.share=0");
  const RenderResult none = mustRender(*engine, nothing), indirect = mustRender(*engine, r);
  set(r, "denoise.outliers.judged=APART");
  const RenderResult apart = mustRender(*engine, r);
  for (size_t k = 0; k < 3; ++k) {
    const bool light = k != 1, bounced = k == 2;
    EXPECT_EQ(indirect.images[k].image().data != none.images[k].image().data, bounced) << none.images[k].output;
    const auto &a = apart.images[k].image().data, &b = none.images[k].image().data;
    double most = 0;
    for (size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(double(a[i]) - b[i]));
    EXPECT_EQ(most > 1e-3, light) << none.images[k].output;
  }
}

// No rung fails for its few samples, and the last one is the picture at once, bit for bit.
TEST(Outliers, TheLadderEndsWithTheSameBits) {
  for (const std::string& method : methods())
    for (const char* filter : {"", "auto"}) {
      v1::RenderRequest r = smallRequest("cornell", 24, 16, 48);
      if (*filter) set(r, std::string("denoise=") + filter);
      set(r, "denoise.outliers=" + method);
      if (method == "path_density") set(r, "denoise.outliers.path_density.neighbours=50");
      const RenderResult whole = mustRender(*makeEngine(), r);
      const auto engine = makeEngine();
      for (const int spp : {1, 2, 4, 8, 16, 32}) {
        v1::RenderRequest rung = r;
        rung.mutable_halt()->set_spp(uint32_t(spp));
        mustRender(*engine, rung);
      }
      EXPECT_EQ(firstDifference(whole, mustRender(*engine, r)), "") << method << " " << filter;
    }
}

// 7 for each sample of a pixel: more are as many as that.
TEST(Outliers, FewSamplesHaveFewNeighbours) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 2);
  set(r, "denoise.outliers.path_density.neighbours=14");
  const RenderResult fourteen = mustRender(*engine, r);
  set(r, "denoise.outliers.path_density.neighbours=1000");
  EXPECT_EQ(firstDifference(fourteen, mustRender(*engine, r)), "");
  set(r, "denoise.outliers.path_density.neighbours=3");
  EXPECT_NE(firstDifference(fourteen, mustRender(*engine, r)), "");
}

TEST(Outliers, ThreadsChangeNoBit) {
  for (const std::string& method : methods()) {
    v1::RenderRequest r = smallRequest("spheres", 40, 30, 4);
    set(r, "denoise.outliers=" + method);
    set(r, "denoise.outliers.judged=APART");
    EXPECT_EQ(firstDifference(mustRender(*makeEngine(256ull << 20, {}, 1), r), mustRender(*makeEngine(256ull << 20, {}, 3), r)), "") << method;
  }
}

// Weights are in the samples: other gains are other samples, and the same picture as at once.
TEST(Outliers, ARelightTracesTheSamplesAgain) {
  for (const std::string& method : methods()) {
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest("lights8", 24, 16, 16);
    set(r, "denoise.outliers=" + method);
    mustRender(*engine, r);
    set(r, "lights.key.gain=4,1,0.2");
    const RenderResult lit = mustRender(*engine, r);
    EXPECT_GT(raysOf(lit, "samples of"), 0u);
    EXPECT_EQ(raysOf(lit, ""), raysOf(lit, "samples of")) << "direct light is there";
    EXPECT_EQ(firstDifference(lit, mustRender(*makeEngine(), r)), "") << method;
  }
}

TEST(Outliers, OfNothingIsPathDensityAndThePlanSaysSo) {
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  set(r, "denoise.outliers=");
  const RenderResult reply = mustRender(*makeEngine(), r);
  EXPECT_TRUE(reply.reply.resolved().denoise().outliers().has_path_density());
  EXPECT_EQ(reply.reply.resolved().denoise().filter_case(), v1::Denoise::FILTER_NOT_SET);
  EXPECT_EQ(reply.reply.resolved().denoise().outliers().path_density().neighbours(), 10u);
  for (const std::string& method : methods()) {
    r.clear_denoise();
    set(r, "denoise.outliers=" + method);
    bool said = false;
    const RenderResult by = mustRender(*makeEngine(), r);
    for (const auto& row : by.reply.plan()) said = said || (row.approximate() && row.reason().find("samples") != std::string::npos);
    EXPECT_TRUE(said) << method;
  }
}

// What single-pixel estimators and those of known white need lies around a window; neighbours of path density may lie anywhere.
TEST(Outliers, WindowsHaveTheBitsOfTheWholeOrAreRefused) {
  const auto engine = makeEngine();
  for (const char* settings : {"denoise.outliers.trimmed.share=0.1", "denoise.outliers.median_of_means.buckets=9", "denoise.outliers.reweighting.base=4"}) {
    v1::RenderRequest r = smallRequest("spheres", 37, 29, 16);
    set(r, settings);
    set(r, "denoise.outliers.white=2");
    set(r, "denoise.outliers.judged=APART");
    for (const bool filtered : {false, true}) {
      if (filtered) set(r, "denoise=wavelet");
      const RenderResult whole = mustRender(*engine, r);
      v1::RenderRequest part = r;
      for (const char* e : {"window.x=9", "window.y=7", "window.width=11", "window.height=5"}) set(part, e);
      const RenderResult window = mustRender(*engine, part);
      const Image &a = beauty(whole), &b = beauty(window);
      ASSERT_EQ(b.width, 11);
      for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 11; ++x)
          for (int c = 0; c < 3; ++c) ASSERT_EQ(a.at(x + 9, y + 7)[c], b.at(x, y)[c]) << settings << " " << filtered << " " << x << "," << y;
    }
  }
  for (const char* settings : {"denoise.outliers.path_density.neighbours=5", "denoise.outliers.reweighting.base=4"}) {
    v1::RenderRequest r = smallRequest("spheres", 37, 29, 4);
    for (const char* e : {"window.x=9", "window.y=7", "window.width=11", "window.height=5", settings}) set(r, e);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << settings;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), "request.window");
    EXPECT_NE(made.status().message().find("without outliers reads a whole picture"), std::string::npos) << made.status().toString();
  }
}

TEST(Outliers, CertificatesAreOfThePictureWithout) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 32, 24, testing::thoroughOr(2048, 1024));
  set(r, "seed=5");
  const RenderResult truth = mustRender(*engine, r);
  r.mutable_halt()->set_spp(8);
  for (const char* e : {"certificate.pixel_fraction=1", "certificate.spp=256", "denoise.outliers=path_density", "seed=0"}) set(r, e);
  const RenderResult calm = mustRender(*engine, r);
  double sum = 0;
  for (size_t i = 0; i < beauty(calm).data.size(); ++i) sum += std::pow(double(beauty(calm).data[i]) - beauty(truth).data[i], 2);
  const double error = std::sqrt(sum / double(beauty(calm).data.size()));
  // With the reference's own noise, and the bounces that the request leaves out.
  EXPECT_NEAR(calm.reply.certificate().rmse(), error, 0.35 * error);
}

TEST(Outliers, MistakesAreNamed) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<const char*> edits, Code code, const std::string& location, const std::string& text) {
    v1::RenderRequest r = smallRequest("cornell");
    for (const char* e : edits) set(r, e);
    if (r.halt().has_time_s()) r.mutable_halt()->clear_spp();
    for (const Status& s : {engine->render(r).status(), engine->prepare(r, nullptr).status()}) {
      EXPECT_EQ(s.code(), code) << s.toString();
      EXPECT_EQ(s.location(), location) << s.toString();
      EXPECT_NE(s.toString().find(text), std::string::npos) << s.toString();
    }
  };
  refused({"denoise.outliers.path_density.neighbours=0"}, Code::InvalidArgument, "request.denoise.outliers.path_density.neighbours", "neighbours = 0");
  refused({"denoise.outliers.trimmed.share=0.6"}, Code::InvalidArgument, "request.denoise.outliers.trimmed.share", "share = 0.6");
  refused({"denoise.outliers.path_density.hard=1"}, Code::InvalidArgument, "request.denoise.outliers.path_density.hard",
          "hard = 1: must be at least `soft`, which is 2");
  refused({"denoise.outliers.path_density.neighbours=10", "denoise.outliers.white=1e-13"}, Code::InvalidArgument, "request.denoise.outliers.white",
          "white = 1e-13: must be 0 or at least 1e-12");
  v1::RenderRequest least = smallRequest("cornell", 8, 6, 2);
  for (const char* e : {"denoise.outliers.path_density.neighbours=10", "denoise.outliers.white=1e-12"}) set(least, e);
  EXPECT_TRUE(engine->render(least).ok());
  refused({"denoise.outliers.trimmed=", "width=4096", "height=4096", "halt.spp=64"}, Code::ResourceExhausted, "request.halt.spp",
          "64 of 16777216 pixels are more than the 2048 MiB");
  refused({"denoise.outliers.trimmed=", "width=16384", "height=16384", "halt.time_s=1", "view_samples=1"}, Code::ResourceExhausted, "request.width",
          "(0 samples a pixel)");
  v1::RenderRequest r = smallRequest("cornell");
  EXPECT_FALSE(setPath(r, "denoise.outliers=path_desnity").ok());
}

// Requests that leave the number of samples open end where no more are held.
TEST(Outliers, OpenRequestsEndWithTheSamplesThatFit) {
  v1::RenderRequest r = smallRequest("cornell");
  EXPECT_EQ(mostSamples(r, 65536), 65536u);
  set(r, "denoise.outliers=trimmed");
  EXPECT_EQ(mostSamples(r, 65536), 65536u);
  r.set_width(1920);
  r.set_height(1080);
  EXPECT_EQ(mostSamples(r, 65536), 48u);  // 2 GiB of 20 bytes: 51.8 a pixel
  EXPECT_EQ(mostSamples(r, 32), 32u);
  r.set_width(4096);
  r.set_height(4096);
  EXPECT_EQ(mostSamples(r, 65536), 4u);  // 6.4
  EXPECT_TRUE(checkOutliers(r).ok());
  r.mutable_window()->set_width(100);
  r.mutable_window()->set_height(100);
  EXPECT_GT(mostSamples(r, 65536), 10000u);
}

// What is admitted is of the samples that the request asks for.
TEST(Outliers, AdmissionKnowsTheSamples) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 64, 48, 16);
  set(r, "denoise.outliers=path_density");
  const auto few = engine->prepare(r, nullptr);
  r.mutable_halt()->set_spp(160);
  const auto many = engine->prepare(r, nullptr);
  ASSERT_TRUE(few.ok() && many.ok());
  const uint64_t more = uint64_t(64) * 48 * 144;
  EXPECT_GE(many->pinnedBytes, few->pinnedBytes + 48 * more);  // in the term, and beside it while they are judged
  EXPECT_LE(many->pinnedBytes, few->pinnedBytes + 60 * more);

  // Cascades are held beside the samples.
  r.mutable_halt()->set_spp(16);
  const auto pinned = [&](std::initializer_list<const char*> assignments) {
    r.clear_denoise();
    for (const char* a : assignments) set(r, a);
    const auto prepared = engine->prepare(r, nullptr);
    EXPECT_TRUE(prepared.ok()) << prepared.status().toString();
    return prepared.ok() ? prepared->pinnedBytes : 0;
  };
  const uint64_t trimmed = pinned({"denoise.outliers=trimmed"});
  const uint64_t known = pinned({"denoise.outliers.reweighting.base=1.1", "denoise.outliers.white=2"});
  EXPECT_GE(known, trimmed + outliers::reweightingBytes(64, 48, 16, {2.0f, 1.1f, 4.0f}));
  const uint64_t any = pinned({"denoise.outliers.reweighting.base=4"});
  EXPECT_GE(any, trimmed + outliers::reweightingBytes(64, 48, 16, {1e-12f, 4.0f, 4.0f}));
}

}  // namespace outlier_requests_test
}  // namespace gobo
