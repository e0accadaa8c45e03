// SPDX-License-Identifier: Apache-2.0
// What the truth of a request is, and which settings of a series would change it.
#include "measurement/reference.h"

#include <gtest/gtest.h>

#include "request/request.h"

namespace gobo::cli {
namespace {

v1::RenderRequest requestOf(const std::vector<std::string>& sets) {
  v1::RenderRequest request;
  request.set_scene("cornell");
  for (const std::string& set : sets) {
    const Status status = setPath(request, set);
    EXPECT_TRUE(status.ok()) << status.toString();
  }
  return request;
}

TEST(Truth, OutputsOfLightHaveOneByPathsAndVisibilityByRays) {
  for (const char* output : {"beauty", "direct", "indirect", "diffuse", "specular", "indirect_specular", "group:key"}) {
    const auto by = truthOf(output);
    ASSERT_TRUE(by.ok()) << output;
    EXPECT_EQ(*by, TruthBy::Paths) << output;
  }
  ASSERT_TRUE(truthOf("visibility:key").ok());
  EXPECT_EQ(*truthOf("visibility:key"), TruthBy::Rays);
  EXPECT_TRUE(truthOf("nonsense").ok());  // the server's refusal has the list
  for (const char* output : {"depth", "variance", "negative_light", "filtered:0", "unoccluded:key", "shadow_rays:key", "sample_count", "albedo"}) {
    const auto by = truthOf(output);
    ASSERT_FALSE(by.ok()) << output;
    EXPECT_EQ(by.status().code(), Code::InvalidArgument);
    EXPECT_NE(by.status().message().find(std::string("--output ") + output), std::string::npos);
    EXPECT_NE(by.status().message().find("beauty"), std::string::npos);
    EXPECT_NE(by.status().message().find("visibility:LIGHT"), std::string::npos);
  }
}

TEST(Truth, HasNoApproximation) {
  v1::RenderRequest request =
      requestOf({"shadows.axis_aligned.k=3", "lights.light.shadow.variance.bleeding_reduction=0.2", "lights.light.gain=2,2,2", "environment.constant=1,1,1",
                 "environment.transfer.bands=4", "environment.extract_lights=8", "environment.area_lights=3", "environment.area_lights_if_worth=true",
                 "environment.subtractive.lights=5", "denoise=auto", "halt.time_s=2", "filters[0].bloom.gain=0.3", "certificate.spp=8",
                 "integrator.max_bounces=2", "seed=4"});
  const v1::RenderRequest truth = truthRequest(request, TruthBy::Paths, 96, 11);
  EXPECT_TRUE(truth.shadows().has_path_traced());
  EXPECT_FALSE(truth.lights().at("light").has_shadow());
  EXPECT_EQ(truth.lights().at("light").gain().x(), 2);
  EXPECT_FALSE(truth.environment().has_transfer() || truth.environment().has_subtractive() || truth.environment().has_extract_lights() ||
               truth.environment().has_area_lights() || truth.environment().has_area_lights_if_worth());
  EXPECT_TRUE(truth.environment().has_constant());
  EXPECT_FALSE(truth.has_denoise() || truth.has_certificate());
  EXPECT_EQ(truth.filters_size(), 0);
  EXPECT_EQ(truth.halt().spp(), 96u);
  EXPECT_FALSE(truth.halt().has_time_s());
  EXPECT_EQ(truth.seed(), 11u);
  EXPECT_EQ(truth.integrator().max_bounces(), 2u);
  const v1::RenderRequest rays = truthRequest(request, TruthBy::Rays, 96, 11);
  EXPECT_EQ(rays.shadows().ray_traced().samples(), 96u);
  EXPECT_EQ(rays.halt().spp(), 1u);
  EXPECT_EQ(truthRequest(request, TruthBy::Rays, 1u << 20, 1).shadows().ray_traced().samples(), 4096u);
}

TEST(Truth, SettingsOfTechniquesKeepIt) {
  const v1::RenderRequest base = requestOf({"lights.key.gain=1,2,3", "width=64"});
  for (const char* set : {"shadows.axis_aligned.k=3", "shadows.map.resolution=512", "lights.light.shadow.exponential.c=40", "halt.spp=3", "halt.time_s=0.1",
                          "seed=9", "view_samples=2", "integrator.sampler=HALTON", "integrator.max_bounces=3", "denoise=auto", "denoise.outliers=path_density",
                          "environment.transfer.bands=4", "environment.extract_lights=8", "environment.extract_by=STRUCTURED"}) {
    v1::RenderRequest point = base;
    ASSERT_TRUE(setPath(point, set).ok()) << set;
    EXPECT_TRUE(checkSameTruth(base, point, TruthBy::Paths).ok()) << set << ": " << checkSameTruth(base, point, TruthBy::Paths).toString();
  }
}

TEST(Truth, SettingsOfThePictureAreRefusedByTheirField) {
  const v1::RenderRequest base = requestOf({"lights.key.gain=1,2,3", "width=64"});
  for (const auto& [set, field] : std::vector<std::pair<std::string, std::string>>{{"lights.key.gain=1,2,4", "request.lights"},
                                                                                   {"lights.other.enabled=false", "request.lights"},
                                                                                   {"width=65", "request.width"},
                                                                                   {"camera.yfov_deg=20", "request.camera"},
                                                                                   {"environment.constant=1,1,1", "request.environment"},
                                                                                   {"environment.rotation_deg=4", "request.environment"},
                                                                                   {"time_s=1", "request.time_s"},
                                                                                   {"shadows.style.softness=0.1", "request.shadows"},
                                                                                   {"outputs=depth", "request.outputs"},
                                                                                   {"scene=atrium", "request.scene"}}) {
    v1::RenderRequest point = base;
    const Status made = setPath(point, set);
    ASSERT_TRUE(made.ok()) << set << ": " << made.toString();
    const Status status = checkSameTruth(base, point, TruthBy::Paths);
    EXPECT_EQ(status.code(), Code::InvalidArgument) << set;
    EXPECT_EQ(status.location(), field) << set;
    EXPECT_NE(status.message().find(field), std::string::npos) << set;
  }
}

}  // namespace
}  // namespace gobo::cli
