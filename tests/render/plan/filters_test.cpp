// SPDX-License-Identifier: Apache-2.0
// request.filters in plans: each filter is its node behind the term that it names, in every output that has the term; what changes nothing is not there; what
// cannot be is refused by name. The nodes themselves: tests/unit/filters/picture_filters_test.cpp.
#include <gtest/gtest.h>

#include "filters/picture/picture_filters.h"
#include "plan/ladder.h"
#include "support/engines.h"
#include "unit/filters/synthetic.h"

namespace gobo::testing {
namespace {

constexpr int kFilteredWidth = 28, kFilteredHeight = 21;

/// A lamp with rays, the room's own light path traced, indirect light.
v1::RenderRequest filteredRoom(const std::vector<std::string>& edits = {}) {
  v1::RenderRequest r = smallRequest("cornell", kFilteredWidth, kFilteredHeight, 4);
  for (const char* a : {"lights.lamp.kind=SPOT", "lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3",
                        "lights.lamp.shadow.ray_traced.samples=1"})
    set(r, a);
  for (const std::string& e : edits) set(r, e);
  return r;
}

const Image& pictureNamed(const RenderResult& r, const std::string& output = "beauty") {
  for (const auto& i : r.images)
    if (i.output == output) return i.image();
  ADD_FAILURE() << "no " << output;
  return r.images.at(0).image();
}

/// What a node makes of the colours of a picture; alpha as it is.
Image throughNode(const NodePtr& node, const Image& in) {
  auto t = std::make_shared<Term>("picture", Domain::Pixel, Extent{in.width, in.height, 1});
  auto v = t->addPlane<float>("rgb", 3);
  for (size_t p = 0; p < in.pixels(); ++p)
    for (size_t c = 0; c < 3; ++c) v[3 * p + c] = in.data[p * size_t(in.channels) + c];
  const TermPtr made = test::runFilter(node, {t});
  Image out = in;
  for (size_t p = 0; p < in.pixels(); ++p)
    for (size_t c = 0; c < 3; ++c) out.data[p * size_t(in.channels) + c] = made->floats("rgb")[3 * p + c];
  return out;
}

std::string differs(const Image& a, const Image& b, double tolerance = 0) {
  if (a.data.size() != b.data.size()) return "sizes";
  for (size_t i = 0; i < a.data.size(); ++i)
    if (!(std::abs(double(a.data[i]) - b.data[i]) <= tolerance * (1.0 + std::abs(double(b.data[i])))))
      return std::to_string(i) + ": " + std::to_string(a.data[i]) + " and " + std::to_string(b.data[i]);
  return {};
}

PictureShape wholeShape(int width = kFilteredWidth, int height = kFilteredHeight) { return {{width, height, 1}, Domain::Pixel, "rgb", 3, false}; }

struct FilterRow {
  const char* name;
  std::vector<const char*> settings;  ///< fields
  std::vector<const char*> nothing;   ///< those at which it is the identity
  std::function<NodePtr()> node;      ///< of the settings
};
const std::vector<FilterRow>& filterRows() {
  static const std::vector<FilterRow> rows{
      {"gaussian", {"sigma_px=1.5"}, {"sigma_px=0"}, [] { return makeGaussianNode(wholeShape(), 1.5); }},
      {"sharpen", {"sigma_px=2", "amount=0.5"}, {"amount=0"}, [] { return makeSharpenNode(wholeShape(), 2, 0.5); }},
      {"median", {"radius_px=2", "deviations=1.5"}, {"radius_px=0"}, [] { return makeMedianNode(wholeShape(), 2, 1.5); }},
      {"bilateral", {"sigma_px=1", "range=0.2"}, {"sigma_px=0"}, [] { return makeBilateralNode(wholeShape(), 1, 0.2); }},
      {"bloom", {"threshold=0.1", "gain=0.5", "radius_px=3"}, {"gain=0"}, [] { return makeBloomNode(wholeShape(), 0.1, 0.5, 3); }},
      {"compression", {"share=0.1"}, {"share=1"}, [] { return makeCompressionNode(wholeShape(), 0.1); }},
      {"resample",
       {"factor=3", "kernel=LANCZOS", "prefilter=false"},
       {"factor=1"},
       [] { return makeResampleNode(wholeShape(), 3, v1::ResampleFilter::LANCZOS, false); }},
      {"color_balance",
       {"red=0.9", "green=0.5", "blue=0.2", "density=0.7", "keep_luminance=true"},
       {"density=0"},
       [] {
         return makeColorBalanceNode(wholeShape(), {0.9, 0.5, 0.2}, 0.7, true);
       }},
  };
  return rows;
}

TEST(Filters, EachIsItsNodeBehindTheBeauty) {
  ASSERT_EQ(int(filterRows().size()), v1::PictureFilter::descriptor()->FindOneofByName("filter")->field_count()) << "a filter has no row";
  const auto engine = makeEngine();
  const RenderResult plain = mustRender(*engine, filteredRoom());
  for (const FilterRow& row : filterRows()) {
    v1::RenderRequest r = filteredRoom({std::string("filters[0]=") + row.name});
    for (const char* s : row.settings) set(r, std::string("filters[0].") + row.name + "." + s);
    const RenderResult made = mustRender(*engine, r);
    EXPECT_EQ(differs(pictureNamed(made), throughNode(row.node(), pictureNamed(plain))), "") << row.name;
    EXPECT_NE(differs(pictureNamed(made), pictureNamed(plain), 1e-4), "") << row.name << " changes nothing";
    EXPECT_EQ(nodesBy(made, v1::NodeReport::RUN).size(), 1u) << row.name << ": all that is before it is there";
    EXPECT_EQ(nodesBy(made, v1::NodeReport::RUN).count(std::string("filters[0] ") + row.name + ":beauty"), 1u);
  }
}

TEST(Filters, IdentitiesAreLeftOutWhilePlanningAndGiveTheSameBits) {
  const auto engine = makeEngine(), other = makeEngine();
  for (const char* term : {"beauty", "direct", "indirect_specular", "visibility:lamp"}) {
    v1::RenderRequest r = filteredRoom();
    r.add_outputs("beauty");
    std::vector<std::string> rows;
    for (const FilterRow& row : filterRows()) {
      if (std::string(term) == "visibility:lamp" && (std::string(row.name) == "bloom" || std::string(row.name) == "color_balance")) continue;
      const std::string at = "filters[" + std::to_string(r.filters_size()) + "]";
      rows.push_back(at + " " + row.name + ":" + term);
      set(r, at + "=" + row.name);
      set(r, at + ".term=" + term);
      for (const char* s : row.nothing) set(r, at + "." + row.name + "." + s);
    }
    const RenderResult plain = mustRender(*other, filteredRoom()), made = mustRender(*engine, r);
    EXPECT_EQ(firstDifference(plain, made), "") << term;
    const auto pruned = nodesBy(made, v1::NodeReport::PRUNED);
    for (const std::string& label : rows) {
      ASSERT_TRUE(pruned.count(label)) << label;
      EXPECT_NE(pruned.at(label).reason().find("changes nothing"), std::string::npos);
    }
    EXPECT_EQ(mustRender(*other, r).reply.plan_size(), plain.reply.plan_size() + int(rows.size())) << "no node more";
  }
  v1::RenderRequest same = filteredRoom({"filters[0]=color_balance"});  // of a filter that lets all through
  EXPECT_TRUE(nodesBy(mustRender(*engine, same), v1::NodeReport::PRUNED).count("filters[0] color_balance:beauty"));
}

TEST(Filters, AChainIsAppliedInItsOrder) {
  const auto engine = makeEngine();
  const RenderResult plain = mustRender(*engine, filteredRoom());
  const NodePtr median = makeMedianNode(wholeShape(), 1, 0), gaussian = makeGaussianNode(wholeShape(), 2);
  const RenderResult one = mustRender(*engine, filteredRoom({"filters[0].median.radius_px=1", "filters[1].gaussian.sigma_px=2"}));
  const RenderResult two = mustRender(*engine, filteredRoom({"filters[0].gaussian.sigma_px=2", "filters[1].median.radius_px=1"}));
  EXPECT_EQ(differs(pictureNamed(one), throughNode(gaussian, throughNode(median, pictureNamed(plain)))), "");
  EXPECT_EQ(differs(pictureNamed(two), throughNode(median, throughNode(gaussian, pictureNamed(plain)))), "");
  EXPECT_NE(differs(pictureNamed(one), pictureNamed(two), 1e-4), "");
  // The last one edited: the first one's result is there.
  const RenderResult edited = mustRender(*engine, filteredRoom({"filters[0].gaussian.sigma_px=2", "filters[1].median.radius_px=2"}));
  const auto ran = nodesBy(edited, v1::NodeReport::RUN);
  EXPECT_EQ(ran.size(), 1u);
  EXPECT_TRUE(ran.count("filters[1] median:beauty"));
}

TEST(Filters, ATermIsFilteredWhereverItIsSeen) {
  const std::vector<std::pair<std::string, NodePtr>> filters = {{"gaussian.sigma_px=1.5", makeGaussianNode(wholeShape(), 1.5)},
                                                                {"median.radius_px=2", makeMedianNode(wholeShape(), 2, 0)}};
  for (const char* term :
       {"direct", "indirect", "emission", "diffuse", "specular", "direct_diffuse", "direct_specular", "indirect_diffuse", "indirect_specular"})
    for (const auto& [assignment, node] : filters) {
      const auto engine = makeEngine();
      const v1::RenderRequest asked = filteredRoom({std::string("outputs=beauty,") + term});
      v1::RenderRequest r = asked;
      set(r, "filters[0]." + assignment);
      set(r, std::string("filters[0].term=") + term);
      const RenderResult plain = mustRender(*engine, asked), made = mustRender(*engine, r);
      const Image before = pictureNamed(plain, term), after = throughNode(node, before);
      EXPECT_EQ(differs(pictureNamed(made, term), after), "") << term << " " << assignment;
      Image beauty = pictureNamed(plain);
      for (size_t i = 0; i < beauty.data.size(); ++i) beauty.data[i] += after.data[i] - before.data[i];
      EXPECT_EQ(differs(pictureNamed(made), beauty, 2e-6), "") << term << " " << assignment;
      // The beauty alone is the same picture, whatever outputs are beside it.
      r.clear_outputs();
      EXPECT_EQ(differs(pictureNamed(mustRender(*makeEngine(), r)), pictureNamed(made)), "") << term << " " << assignment;
    }
}

TEST(Filters, PartsOfALinearlyFilteredTermAddUpToIt) {
  const auto engine = makeEngine();
  v1::RenderRequest r =
      filteredRoom({"outputs=direct,direct_diffuse,direct_specular,group:lamp,group:light", "filters[0].sharpen.amount=1", "filters[0].term=direct"});
  const RenderResult made = mustRender(*engine, r);
  Image sum = pictureNamed(made, "direct_diffuse");
  for (size_t i = 0; i < sum.data.size(); ++i) sum.data[i] += pictureNamed(made, "direct_specular").data[i];
  EXPECT_EQ(differs(sum, pictureNamed(made, "direct"), 2e-6), "");
  v1::RenderRequest beauty = r;
  set(beauty, "outputs=beauty");
  Image lights = pictureNamed(made, "group:lamp");
  for (size_t i = 0; i < lights.data.size(); ++i) lights.data[i] += pictureNamed(made, "group:light").data[i];
  EXPECT_EQ(differs(lights, pictureNamed(mustRender(*engine, beauty)), 2e-6), "");
}

TEST(Filters, VisibilityIsFilteredBeforeLightIsMadeOfIt) {
  const auto engine = makeEngine();
  const v1::RenderRequest asked =
      filteredRoom({"view_samples=1", "outputs=visibility:lamp,unoccluded:lamp,direct,alpha", "lights.light.enabled=false", "camera.yfov_deg=20"});
  for (const auto& [assignment, node] : std::vector<std::pair<std::string, std::function<NodePtr(PictureShape)>>>{
           {"gaussian.sigma_px=1.5", [](PictureShape s) { return makeGaussianNode(s, 1.5); }},
           {"sharpen.amount=2", [](PictureShape s) { return makeSharpenNode(s, 1, 2); }},
           {"median.radius_px=2", [](PictureShape s) { return makeMedianNode(s, 2, 0); }},
           {"compression.share=0.1", [](PictureShape s) { return makeCompressionNode(s, 0.1); }},
           {"resample.factor=3", [](PictureShape s) { return makeResampleNode(s, 3, v1::ResampleFilter::MITCHELL, true); }},
           {"bilateral.sigma_px=2", [](PictureShape s) { return makeBilateralNode(s, 2, 0.1); }}}) {
    v1::RenderRequest r = asked;
    set(r, "filters[0]." + assignment);
    set(r, "filters[0].term=visibility:lamp");
    const RenderResult plain = mustRender(*engine, asked), made = mustRender(*engine, r);
    const Image& v = pictureNamed(plain, "visibility:lamp");
    for (const float alpha : pictureNamed(plain, "alpha").data) ASSERT_EQ(alpha, 1.0f) << "the output shows visibility of what is seen alone";
    auto t = std::make_shared<Term>("visibility", Domain::ViewSample, Extent{kFilteredWidth, kFilteredHeight, 1});
    std::copy(v.data.begin(), v.data.end(), t->addPlane<float>("V").begin());
    const TermPtr expected = test::runFilter(node({{kFilteredWidth, kFilteredHeight, 1}, Domain::ViewSample, "V", 1, true}), {t});
    const Image &after = pictureNamed(made, "visibility:lamp"), &light = pictureNamed(plain, "unoccluded:lamp"), &direct = pictureNamed(made, "direct");
    for (size_t p = 0; p < v.pixels(); ++p) {
      ASSERT_EQ(after.data[p], expected->floats("V")[p]) << assignment << " " << p;
      ASSERT_TRUE(after.data[p] >= 0.0f && after.data[p] <= 1.0f);
      // Power 1 and the lamp's gain: direct light is a multiple of both.
      for (size_t c = 0; c < 3; ++c)
        if (light.data[3 * p + c] > 1e-4f && v.data[p] == 1.0f && pictureNamed(plain, "direct").data[3 * p + c] > 1e-4f) {
          ASSERT_NEAR(direct.data[3 * p + c] / pictureNamed(plain, "direct").data[3 * p + c], after.data[p], 1e-4) << assignment;
        }
    }
    // A hard shadow is as sharp as shares can be, and its sides are unlike.
    if (assignment.find("sharpen") == std::string::npos && assignment.find("bilateral") == std::string::npos)
      EXPECT_NE(differs(after, v, 1e-3), "") << assignment;
  }
  // After a style.
  v1::RenderRequest styled = asked;
  set(styled, "lights.lamp.shadow.style.softness=0.2");
  v1::RenderRequest both = styled;
  set(both, "filters[0].gaussian.sigma_px=1");
  set(both, "filters[0].term=visibility:lamp");
  const Image before = pictureNamed(mustRender(*engine, styled), "visibility:lamp"), made = pictureNamed(mustRender(*engine, both), "visibility:lamp");
  auto t = std::make_shared<Term>("visibility", Domain::ViewSample, Extent{kFilteredWidth, kFilteredHeight, 1});
  std::copy(before.data.begin(), before.data.end(), t->addPlane<float>("V").begin());
  const TermPtr expected = test::runFilter(makeGaussianNode({{kFilteredWidth, kFilteredHeight, 1}, Domain::ViewSample, "V", 1, true}, 1), {t});
  EXPECT_TRUE(std::equal(made.data.begin(), made.data.end(), expected->floats("V").begin()));
}

TEST(Filters, ComeAfterDenoising) {
  const auto engine = makeEngine();
  for (const char* by : {"denoise.wavelet.levels=2", "denoise=auto"}) {
    const v1::RenderRequest asked = filteredRoom({by, "outputs=beauty,indirect"});
    v1::RenderRequest r = asked, part = asked;
    set(r, "filters[0].gaussian.sigma_px=1.5");
    set(part, "filters[0].median.radius_px=2");
    set(part, "filters[0].term=indirect");
    const RenderResult plain = mustRender(*engine, asked);
    EXPECT_EQ(differs(pictureNamed(mustRender(*engine, r)), throughNode(makeGaussianNode(wholeShape(), 1.5), pictureNamed(plain))), "") << by;
    EXPECT_EQ(differs(pictureNamed(mustRender(*engine, part), "indirect"), throughNode(makeMedianNode(wholeShape(), 2, 0), pictureNamed(plain, "indirect"))),
              "")
        << by;
    mustRender(*engine, part);
  }
}

TEST(Filters, AlphaStaysAsItIs) {
  const auto engine = makeEngine();
  for (const bool shutter : {false, true}) {
    v1::RenderRequest asked = smallRequest("spheres", kFilteredWidth, kFilteredHeight, 4);
    for (const char* a : {"environment.background=TRANSPARENT", "environment.constant=0.5,0.6,0.7"}) set(asked, a);
    if (shutter)
      for (const char* a : {"camera.shutter_s=1", "camera.shutter_slices=2", "curves.camera.yfov_deg.time_s=0,1", "curves.camera.yfov_deg.value=50,30"})
        set(asked, a);
    v1::RenderRequest r = asked;
    set(r, "filters[0].gaussian.sigma_px=1.5");
    const Image before = pictureNamed(mustRender(*engine, asked)), after = pictureNamed(mustRender(*engine, r));
    ASSERT_EQ(before.channels, 4);
    EXPECT_EQ(differs(after, throughNode(makeGaussianNode(wholeShape(), 1.5), before)), "") << shutter;
    EXPECT_NE(differs(after, before, 1e-3), "");
  }
}

TEST(Filters, OfAShutterThePictureOfAllMomentsIsFiltered) {
  const auto engine = makeEngine();
  const std::vector<std::string> open = {"camera.shutter_s=1", "camera.shutter_slices=2", "curves.camera.yfov_deg.time_s=0,1",
                                         "curves.camera.yfov_deg.value=50,30"};
  for (const char* denoise : {"", "denoise.wavelet.levels=2"}) {
    v1::RenderRequest asked = filteredRoom(open);
    if (*denoise) set(asked, denoise);
    v1::RenderRequest r = asked;
    set(r, "filters[0].median.radius_px=2");
    const Image before = pictureNamed(mustRender(*engine, asked)), after = pictureNamed(mustRender(*engine, r));
    EXPECT_EQ(differs(after, throughNode(makeMedianNode(wholeShape(), 2, 0), before)), "") << denoise;
  }
  // Linear filters of a term: the mean of the moments' is that of the mean. Others, and any of what is denoised as one picture, are refused.
  v1::RenderRequest asked = filteredRoom(open);
  set(asked, "outputs=beauty,direct");
  v1::RenderRequest linear = asked;
  set(linear, "filters[0].gaussian.sigma_px=1.5");
  set(linear, "filters[0].term=direct");
  EXPECT_EQ(differs(pictureNamed(mustRender(*engine, linear), "direct"),
                    throughNode(makeGaussianNode(wholeShape(), 1.5), pictureNamed(mustRender(*engine, asked), "direct")), 1e-5),
            "");
  v1::RenderRequest denoised = linear, median = asked;
  set(denoised, "denoise.wavelet.levels=2");
  set(median, "filters[0]=median");
  set(median, "filters[0].term=direct");
  for (const v1::RenderRequest& bad : {denoised, median}) {
    const auto made = engine->render(bad);
    ASSERT_FALSE(made.ok());
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), "request.filters[0].term") << made.status().toString();
    EXPECT_NE(made.status().message().find("shutter"), std::string::npos) << made.status().toString();
  }
}

TEST(Filters, WhatCannotBeIsRefusedByName) {
  const auto engine = makeEngine();
  struct Bad {
    std::vector<std::string> edits;
    const char *location, *says;
  };
  for (const Bad& bad : std::vector<Bad>{
           {{"filters[0].term=beauty"}, "request.filters[0]", "gaussian, sharpen"},
           {{"filters[0]=median", "filters[0].term=baeuty"}, "request.filters[0].term", "visibility:LIGHT"},
           {{"filters[0]=median", "filters[1]=median", "filters[1].term=albedo"}, "request.filters[1].term", "'albedo'"},
           {{"filters[0]=median", "filters[0].term=depth"}, "request.filters[0].term", "'depth'"},
           {{"filters[0]=median", "filters[0].term=variance"}, "request.filters[0].term", "'variance'"},
           {{"filters[0]=median", "filters[0].term=group:lamp"}, "request.filters[0].term", "'group:lamp'"},
           {{"filters[0]=median", "filters[0].term=visibility"}, "request.filters[0].term", "'visibility'"},
           {{"filters[0]=median", "filters[0].term=visibility:lmap"}, "request.filters[0].term", "no light 'lmap'"},
           {{"filters[0]=median", "filters[0].term=visibility:light"}, "request.filters[0].term", "path traced"},
           {{"filters[0]=median", "filters[0].term=visibility:environment", "environment.constant=1"}, "request.filters[0].term", "environment"},
           {{"filters[0]=median", "filters[0].term=visibility:lamp", "camera.lens_radius=0.1", "camera.focus_distance=2", "lights.lamp.shadow.auto="},
            "request.filters[0].term",
            "lens"},
           {{"filters[0]=bloom", "filters[0].term=visibility:lamp"}, "request.filters[0].term", "bloom is of light"},
           {{"filters[0]=color_balance", "filters[0].term=visibility:lamp"}, "request.filters[0].term", "color_balance is of light"},
           {{"filters[0]=gaussian", "filters[0].term=direct", "filters[1]=gaussian", "filters[1].term=direct_specular"}, "request.filters[1].term", "'direct'"},
           {{"filters[0]=median", "filters[0].term=direct", "outputs=direct_diffuse"}, "request.filters[0].term", "not linear"},
           {{"filters[0]=median", "filters[0].term=direct", "outputs=diffuse"}, "request.filters[0].term", "not linear"},
           {{"filters[0]=bloom", "filters[0].term=direct", "outputs=group:lamp"}, "request.filters[0].term", "group:lamp"},
           {{"filters[0].gaussian.sigma_px=-1"}, "request.filters[0].gaussian.sigma_px", "-1"},
           {{"filters[0].gaussian.sigma_px=1", "filters[1].median.radius_px=9"}, "request.filters[1].median.radius_px", "9"},
           {{"filters[0].bilateral.range=0"}, "request.filters[0].bilateral.range", "0"},
           {{"filters[0].resample.factor=0.5"}, "request.filters[0].resample.factor", "0.5"},
           {{"filters[0]=bloom", "window.width=8", "window.height=8"}, "request.window", "bloom_filter"},
           {{"filters[0]=compression", "window.width=8", "window.height=8"}, "request.window", "compression_filter"},
           {{"filters[0]=resample", "window.width=8", "window.height=8"}, "request.window", "resample_filter"},
       }) {
    const auto made = engine->render(filteredRoom(bad.edits));
    ASSERT_FALSE(made.ok()) << bad.edits.back();
    EXPECT_EQ(made.status().code(), Code::InvalidArgument) << made.status().toString();
    EXPECT_EQ(made.status().location(), bad.location) << made.status().toString();
    EXPECT_NE(made.status().message().find(bad.says), std::string::npos) << made.status().toString();
  }
  v1::RenderRequest many = filteredRoom();
  for (int k = 0; k < 65; ++k) many.add_filters()->mutable_median();
  EXPECT_EQ(engine->render(many).status().location(), "request.filters");
  v1::RenderRequest kernel = filteredRoom({"filters[0]=resample"});
  kernel.mutable_filters(0)->mutable_resample()->set_kernel(v1::ResampleFilter::Kernel(77));
  EXPECT_EQ(engine->render(kernel).status().location(), "request.filters[0].resample.kernel");
}

TEST(Filters, CertificatesSayThatTheyCountWhatFiltersDo) {
  const auto engine = makeEngine();
  const auto warned = [&](const v1::RenderRequest& r) {
    const RenderResult made = mustRender(*engine, r);
    return std::any_of(made.reply.warnings().begin(), made.reply.warnings().end(),
                       [](const std::string& w) { return w.find("request.filters") != std::string::npos; });
  };
  EXPECT_TRUE(warned(filteredRoom({"certificate.pixel_fraction=0.1", "filters[0]=gaussian"})));
  EXPECT_FALSE(warned(filteredRoom({"certificate.pixel_fraction=0.1", "filters[0].gaussian.sigma_px=0"})));
  EXPECT_TRUE(warned(filteredRoom({"outputs=beauty,variance", "filters[0]=gaussian"})));
  EXPECT_FALSE(warned(filteredRoom({"filters[0]=gaussian"})));
}

TEST(Filters, AutomaticExposureSeesTheFilteredPicture) {
  const auto engine = makeEngine();
  v1::RenderRequest r = filteredRoom(
      {"encoding.format=PNG", "filters[0].color_balance.red=0.001", "filters[0].color_balance.green=0.001", "filters[0].color_balance.blue=0.001"});
  const RenderResult dark = mustRender(*engine, r), plain = mustRender(*engine, filteredRoom({"encoding.format=PNG"}));
  EXPECT_GT(dark.reply.resolved().tone_map().exposure(), plain.reply.resolved().tone_map().exposure() + 2.0);
}

TEST(Filters, SmallPicturesAreFilteredAsSmall) {
  const auto engine = makeEngine();
  v1::RenderRequest r = filteredRoom({"filters[0].gaussian.sigma_px=4", "filters[1].median.radius_px=6", "filters[2].bloom.radius_px=0.6",
                                      "filters[3].resample.factor=8", "filters[4].gaussian.sigma_px=1", "filters[4].term=visibility:lamp"});
  r.set_width(400);
  r.set_height(300);
  const auto rung = smallRung(*engine->resolve(r), 4);
  ASSERT_TRUE(rung.has_value());
  EXPECT_EQ(rung->filters(0).gaussian().sigma_px(), 1.0);
  EXPECT_EQ(rung->filters(1).median().radius_px(), 2u);
  EXPECT_EQ(rung->filters(2).bloom().radius_px(), 0.5);  // the least that there is
  EXPECT_EQ(rung->filters(3).resample().factor(), 2.0);
  // Path traced in the place of its techniques it has no visibility, and the same filters of light.
  const auto plain = plainRung(*rung);
  ASSERT_TRUE(plain.has_value());
  EXPECT_EQ(plain->filters_size(), 4);
  EXPECT_TRUE(engine->render(*plain).ok());
}

}  // namespace
}  // namespace gobo::testing
