// SPDX-License-Identifier: Apache-2.0
// Displays and views of OpenColorIO configs: values against closed forms, which space pictures enter by, hashes, and what is refused and how.
#include "plan/display_transforms.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <thread>

#include "plan/engine.h"
#include "support/color_configs.h"
#include "support/engines.h"
#include "support/temp_folder.h"

namespace gobo::display_transforms_test {
namespace {

using test::ColorConfigParts;
using test::TempFolder;
using test::writeColorConfig;
using testing::set;
using testing::smallRequest;

constexpr float kInf = std::numeric_limits<float>::infinity(), kNan = std::numeric_limits<float>::quiet_NaN();

struct Config {
  TempFolder folder;
  std::string path;
  std::vector<std::string> said;
  std::shared_ptr<DisplayTransforms> displays;
  explicit Config(const ColorConfigParts& parts = {}, const std::string& workingSpace = "") : path(writeColorConfig(folder.path, parts)) { read(workingSpace); }
  void read(const std::string& workingSpace = "") {
    displays = std::make_shared<DisplayTransforms>(DisplayTransforms::Options{path, workingSpace, [this](const std::string& line) { said.push_back(line); }});
  }
  v1::Encoding resolved(const std::string& view, const std::string& display = "", const std::string& look = "") const {
    v1::RenderRequest r;
    r.mutable_encoding()->set_format(v1::Encoding::PNG);
    r.mutable_encoding()->set_view(view);
    r.mutable_encoding()->set_display(display);
    r.mutable_encoding()->set_look(look);
    const v1::RenderRequest asked = r;
    const Status status = displays->resolve(r, asked);
    EXPECT_TRUE(status.ok()) << status.toString();
    return r.encoding();
  }
  Image shown(const Image& image, const std::string& view, double exposure = 0, const std::string& display = "", const std::string& look = "") const {
    const auto processor = displays->processor(resolved(view, display, look));
    EXPECT_TRUE(processor.ok()) << processor.status().toString();
    auto out = shownByView(image, exposure, **processor, false);
    EXPECT_TRUE(out.ok()) << out.status().toString();
    return std::move(*out);
  }
};

/// Channels that differ, from below zero to far above one, and more than a block of the processor.
Image colours(int channels = 3) {
  Image image(61, 53, channels);
  for (size_t p = 0; p < image.pixels(); ++p)
    for (int c = 0; c < channels; ++c) image.data[p * channels + c] = float(std::exp2(-12.0 + 16.0 * double(p) / double(image.pixels())) * (1.0 + 0.37 * c));
  for (int c = 0; c < channels; ++c) image.data[c] = 0, image.data[channels + c] = -0.25f * float(c + 1);
  return image;
}

double worst(const Image& shown, const Image& linear, const std::string& view, double scale = 1, const double* slope = nullptr) {
  double most = 0;
  for (size_t p = 0; p < linear.pixels(); ++p) {
    double rgb[3];
    for (int c = 0; c < 3; ++c) rgb[c] = double(linear.data[3 * p + c]) * scale * (slope ? slope[c] : 1);
    for (int c = 0; c < 3; ++c) most = std::max(most, std::fabs(shown.data[3 * p + c] - test::expectedView(view, rgb, c)));
  }
  return most;
}

TEST(DisplayTransforms, EachViewIsItsClosedForm) {
  const Config config;
  const Image image = colours();
  for (const char* view : {"Power", "Swapped", "Log", "sRGB", "Graded", "Half", "Raw"})
    // A float's rounding.
    EXPECT_LT(worst(config.shown(image, view), image, view), 2.5e-7) << view;
  EXPECT_LT(worst(config.shown(image, "Cinema", 0, "Projector"), image, "Cinema"), 2.5e-7);
  EXPECT_TRUE(config.said.empty()) << config.said[0];
}

TEST(DisplayTransforms, ExposureComesFirstThenTheLookThenTheView) {
  const Config config;
  const Image image = colours();
  EXPECT_LT(worst(config.shown(image, "Log", 2.0), image, "Log", 4.0), 2e-6);
  EXPECT_LT(worst(config.shown(image, "Power", -1.0), image, "Power", 0.5), 2e-6);
  const double warm[3] = {1.5, 1, 0.5}, twice[3] = {2, 2, 2};
  EXPECT_LT(worst(config.shown(image, "Power", 0, "", "warm"), image, "Power", 1, warm), 2e-6);
  EXPECT_LT(worst(config.shown(image, "Log", 1, "Monitor", "warm"), image, "Log", 2, warm),
            2e-6);  // the look is of linear light, not of the view's code values
  // The view's own look stays.
  EXPECT_LT(worst(config.shown(image, "Graded", 0, "", "doubled"), image, "Graded", 1, twice), 2e-6);
}

TEST(DisplayTransforms, TheFirstActiveViewIsTheDefaultAndRepliesSayIt) {
  const Config config;
  const v1::Encoding byView = config.resolved("Swapped"), byDisplay = config.resolved("", "Projector"), first = config.resolved("", "Monitor");
  EXPECT_EQ(byView.display(), "Monitor");
  EXPECT_EQ(byView.view(), "Swapped");
  EXPECT_EQ(byDisplay.view(), "Cinema");
  EXPECT_EQ(first.view(), "Power") << "Hidden comes first in the file, but is not active";
  EXPECT_EQ(byView.ocio_hash().size(), 32u);
  EXPECT_EQ(byView.ocio_hash(), byDisplay.ocio_hash());
  v1::RenderRequest plain, asked;
  plain.mutable_encoding()->set_ocio_hash("of a picture that had a view");
  asked = plain;
  ASSERT_TRUE(config.displays->resolve(plain, asked).ok());
  EXPECT_EQ(plain.encoding().ocio_hash(), "");
}

TEST(DisplayTransforms, NothingThatIsNoNumberComesOut) {
  const Config config;
  Image image(4, 2, 3);
  const float odd[] = {kNan, kInf, -kInf, 3e38f, -3e38f, 1e-42f, -0.0f, 65505.0f};
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = odd[i % 8];
  for (const char* view : {"Power", "Swapped", "Log", "sRGB", "Graded", "Half", "Raw"})
    for (const double exposure : {0.0, 20.0, -20.0}) {
      const Image shown = config.shown(image, view, exposure);
      for (size_t i = 0; i < shown.data.size(); ++i) EXPECT_TRUE(shown.data[i] >= 0 && shown.data[i] <= 1) << view << " " << odd[i % 8] << " " << shown.data[i];
    }
  // What is infinitely bright is as bright as can be; NaN is black.
  const Image shown = config.shown(image, "Power");
  EXPECT_EQ(shown.data[0], 0.0f);
  EXPECT_EQ(shown.data[1], 1.0f);
  EXPECT_EQ(shown.data[2], 0.0f);
  /// What a config makes of numbers is held to numbers too.
  struct Broken final : ColorProcessor {
    Status apply(float* rgb, size_t pixels) const override {
      const float values[] = {kNan, kInf, -kInf, 0.25f};
      for (size_t i = 0; i < 3 * pixels; ++i) rgb[i] = values[i % 4];
      return {};
    }
  };
  const auto held = shownByView(image, 0, Broken(), false);
  ASSERT_TRUE(held.ok());
  EXPECT_EQ(std::vector<float>(held->data.begin(), held->data.begin() + 4), (std::vector<float>{0, 1, 0, 0.25f}));
  /// Views are given finite numbers whatever the picture has: within what halves hold.
  struct Finite final : ColorProcessor {
    Status apply(float* rgb, size_t pixels) const override {
      for (size_t i = 0; i < 3 * pixels; ++i)
        if (!(std::fabs(rgb[i]) <= 65504.0f)) return invalidArgument("got " + std::to_string(rgb[i]));
      return {};
    }
  };
  const auto finite = shownByView(image, 3, Finite(), false);
  EXPECT_TRUE(finite.ok()) << finite.status().toString();
  struct Failing final : ColorProcessor {
    Status apply(float*, size_t) const override { return invalidArgument("words"); }
  };
  EXPECT_EQ(shownByView(image, 0, Failing(), false).status().message(), "words");
}

TEST(DisplayTransforms, AlphaIsStraightAndOnBlackItIsTheLight) {
  const Config config;
  Image image(3, 1, 4);
  image.data = {0.1f, 0.2f, 0.05f, 0.5f, 0, 0, 0, 0, 0.3f, 0.2f, 0.1f, 1.0f};
  const Image shown = config.shown(image, "Power");
  ASSERT_EQ(shown.channels, 4);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(shown.data[c], std::pow(image.data[c] / 0.5, 1 / 2.2), 2e-6);
    EXPECT_EQ(shown.data[4 + c], 0.0f);
    EXPECT_NEAR(shown.data[8 + c], std::pow(double(image.data[8 + c]), 1 / 2.2), 2e-6);
  }
  EXPECT_EQ(shown.data[3], 0.5f);
  EXPECT_EQ(shown.data[7], 0.0f);
  EXPECT_EQ(shown.data[11], 1.0f);
  const auto processor = config.displays->processor(config.resolved("Power"));
  const auto black = shownByView(image, 0, **processor, true);
  ASSERT_TRUE(black.ok());
  ASSERT_EQ(black->channels, 3);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(black->data[c], std::pow(double(image.data[c]), 1 / 2.2), 2e-6);  // premultiplied light is what lies before black
  // One channel is a grey.
  Image grey(2, 1, 1);
  grey.data = {0.25f, 0.5f};
  const Image tinted = config.shown(grey, "Power", 0, "", "warm");
  ASSERT_EQ(tinted.channels, 3);
  EXPECT_NEAR(tinted.data[0], std::pow(0.25 * 1.5, 1 / 2.2), 2e-6);
  EXPECT_NEAR(tinted.data[2], std::pow(0.25 * 0.5, 1 / 2.2), 2e-6);
}

TEST(DisplayTransforms, ThreadsAndCompanyChangeNothing) {
  const Config config;
  const Image image = colours();
  for (const char* view : {"Log", "Graded", "Half"}) {
    const Image alone = config.shown(image, view);
    // Pixel by pixel, whatever stands beside it.
    const auto processor = config.displays->processor(config.resolved(view));
    for (const size_t p : {size_t(0), size_t(1023), size_t(1024), size_t(2047), image.pixels() - 1}) {
      Image one(1, 1, 3);
      std::copy_n(image.data.begin() + long(3 * p), 3, one.data.begin());
      EXPECT_EQ(shownByView(one, 0, **processor, false)->data, std::vector<float>(alone.data.begin() + long(3 * p), alone.data.begin() + long(3 * p + 3)))
          << view << p;
    }
    std::atomic<int> differ{0};
    std::vector<std::thread> threads;
    Config fresh;  // whose config is read by whoever comes first
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int n = 0; n < 4; ++n) differ += fresh.shown(image, view).data != alone.data;
      });
    for (std::thread& t : threads) t.join();
    EXPECT_EQ(differ.load(), 0) << view;
  }
}

TEST(DisplayTransforms, PicturesEnterByTheSpaceThatIsLinearRec709) {
  const Image image = colours();
  for (const char* name : {"lin_rec709", "Linear Rec.709 (sRGB)", "Utility - Linear - sRGB", "scene-linear Rec.709-sRGB"}) {
    ColorConfigParts parts;
    parts.linear = name;
    // Another space is its scene_linear.
    parts.roles = "  scene_linear: power22\n";
    const Config config(parts);
    EXPECT_LT(worst(config.shown(image, "Power"), image, "Power"), 2e-6) << name;
    EXPECT_TRUE(config.said.empty());
    parts.linear = "another name", parts.alias = name;
    const Config aliased(parts);
    EXPECT_LT(worst(aliased.shown(image, "Power"), image, "Power"), 2e-6) << name;
  }
}

TEST(DisplayTransforms, WithoutOneTheyEnterByAcesOrAreTakenForSceneLinear) {
  const Image image = colours();
  // The reference is ACES2065-1; a view goes back to linear Rec. 709 by the published matrix from AP0 (Bradford adaptation to D65).
  ColorConfigParts aces;
  aces.linear = "ACES2065-1";
  aces.roles = "  aces_interchange: reference_name\n  cie_xyz_d65_interchange: raw\n";
  aces.colorspaces =
      "  - !<ColorSpace>\n    name: back\n    from_scene_reference: !<MatrixTransform> {matrix: [2.52168619, -1.13413099, -0.38755520, 0, -0.27647991, "
      "1.37271909, -0.09623917, 0, -0.01537806, -0.15297534, 1.16835340, 0, 0, 0, 0, 1]}\n";
  Config config(aces);
  std::string text;
  {
    std::ostringstream all;
    all << std::ifstream(config.path).rdbuf();
    text = all.str();
  }
  const std::string from = "name: Swapped, colorspace: swapped";
  text.replace(text.find(from), from.size(), "name: Swapped, colorspace: back");
  test::writeText(config.path, text);
  config.read();
  EXPECT_LT(worst(config.shown(image, "Swapped"), image, "Raw"), 3e-6);
  EXPECT_TRUE(config.said.empty());
  // Nothing says what linear Rec. 709 is: taken as it is, and said once.
  ColorConfigParts silent;
  silent.linear = "some linear";
  Config taken(silent);
  EXPECT_LT(worst(taken.shown(image, "Power"), image, "Power"), 2e-6);
  taken.shown(image, "Swapped");
  ASSERT_EQ(taken.said.size(), 1u);
  EXPECT_NE(taken.said[0].find("scene_linear, \"some linear\""), std::string::npos) << taken.said[0];
  EXPECT_NE(taken.said[0].find("color.working_space"), std::string::npos) << taken.said[0];
  // Whoever runs it may say which; the operator's word goes before names.
  const Config named({}, "swapped");
  const Image there = named.shown(image, "Swapped");
  EXPECT_LT(worst(there, image, "Raw"), 2e-6);  // in by `swapped`, out by it
  Config nowhere({}, "nowhere");
  EXPECT_EQ(nowhere.displays->load().code(), Code::InvalidArgument);
  EXPECT_NE(nowhere.displays->load().message().find("color.working_space = \"nowhere\""), std::string::npos);
  ColorConfigParts none;
  none.linear = "some linear";
  none.roles = "";
  Config lost(none);
  EXPECT_EQ(lost.displays->load().code(), Code::FailedPrecondition) << lost.displays->load().toString();
  EXPECT_NE(lost.displays->load().message().find("color.working_space"), std::string::npos);
}

TEST(DisplayTransforms, TheHashIsOfWhatTheConfigSaysAndOfItsFiles) {
  const auto hashOf = [](const ColorConfigParts& parts) {
    const Config config(parts);
    return config.resolved("Power").ocio_hash();
  };
  const std::string plain = hashOf({});
  EXPECT_EQ(hashOf({}), plain) << "in another folder, at another time";
  ColorConfigParts edited;
  edited.more = "# a word\n";
  EXPECT_NE(hashOf(edited), plain);
  edited = {};
  edited.lutTop = 0.25f;
  EXPECT_NE(hashOf(edited), plain) << "a file that a view names";
  // A file that nothing names, and one that is missing.
  Config config;
  test::writeText(config.folder.path + "/other.spi1d", "x");
  config.read();
  EXPECT_EQ(config.resolved("Power").ocio_hash(), plain);
  std::filesystem::remove(config.folder.path + "/half.spi1d");
  config.read();
  const std::string missing = config.resolved("Power").ocio_hash();
  EXPECT_NE(missing, plain);
  test::writeText(config.folder.path + "/half.spi1d", "");
  config.read();
  EXPECT_NE(config.resolved("Power").ocio_hash(), missing) << "an empty file is there";
  // A variable counts where the config uses it.
  ColorConfigParts variable;
  variable.colorspaces = "  - !<ColorSpace>\n    name: shot\n    from_scene_reference: !<FileTransform> {src: $GOBO_TEST_SHOT.spi1d}\n";
  const auto with = [&](const char* value) {
    Config c(variable);
    std::ostringstream all;
    all << std::ifstream(c.path).rdbuf();
    std::string text = all.str();
    text.replace(text.find("environment: {}"), 15, "environment: {GOBO_TEST_SHOT: one}");
    test::writeText(c.path, text);
    ::setenv("GOBO_TEST_SHOT", value, 1);
    c.read();
    const std::string hash = c.resolved("Power").ocio_hash();
    ::unsetenv("GOBO_TEST_SHOT");
    return hash;
  };
  EXPECT_NE(with("one"), with("two"));
  EXPECT_EQ(with("one"), with("one"));
}

TEST(DisplayTransforms, AFileThatHasChangedSinceIsNotTakenForTheOneThatWasHashed) {
  Config config;
  const Image image = colours();
  const Image before = config.shown(image, "Half");
  std::filesystem::remove(config.folder.path + "/half.spi1d");
  test::writeText(config.folder.path + "/half.spi1d", "Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{\n0.0\n0.125\n}\n");
  EXPECT_EQ(config.shown(image, "Half").data, before.data) << "what is made stays";
  v1::RenderRequest r;
  r.mutable_encoding()->set_format(v1::Encoding::PNG);
  r.mutable_encoding()->set_view("Half");
  r.mutable_encoding()->set_look("warm");
  const v1::RenderRequest asked = r;
  const Status status = config.displays->resolve(r, asked);
  EXPECT_EQ(status.code(), Code::FailedPrecondition);
  EXPECT_NE(status.message().find("half.spi1d"), std::string::npos) << status.toString();
}

TEST(DisplayTransforms, BrokenConfigsSayWhatTheLibrarySays) {
  TempFolder folder;
  const auto status = [&](const std::string& text) {
    test::writeText(folder.path + "/c.ocio", text);
    DisplayTransforms displays({folder.path + "/c.ocio", "", {}});
    const Status first = displays.load();
    EXPECT_EQ(displays.load().toString(), first.toString()) << "at every call";
    return first;
  };
  for (const char* text : {"ocio_profile_version: 2\ndisplays: [", "no config", "ocio_profile_version: 99\n", "ocio_profile_version: 2\n"}) {
    const Status s = status(text);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << text << ": " << s.toString();
    EXPECT_NE(s.message().find("c.ocio\": "), std::string::npos) << s.toString();
  }
  EXPECT_EQ(status("").code(), Code::NotFound);
  EXPECT_EQ(DisplayTransforms({folder.path + "/none.ocio", "", {}}).load().code(), Code::NotFound);
  EXPECT_EQ(DisplayTransforms({folder.path, "", {}}).load().code(), Code::NotFound);
  EXPECT_TRUE(DisplayTransforms({}).load().ok());
  EXPECT_TRUE(DisplayTransforms({}).check().ok());
  // A view of a colour space that is not there is found while reading; a file that is missing, by a check or by who asks for it.
  ColorConfigParts parts;
  parts.more = "named_transforms:\n  - !<NamedTransform> {name: unused, transform: !<ColorSpaceTransform> {src: raw, dst: raw}}\n";
  Config config(parts);
  std::ostringstream good;
  good << std::ifstream(config.path).rdbuf();
  std::string dangling = good.str();
  dangling.replace(dangling.find("colorspace: swapped"), 19, "colorspace: swopped");
  test::writeText(config.path, dangling);
  config.read();
  EXPECT_EQ(config.displays->load().code(), Code::InvalidArgument);
  EXPECT_NE(config.displays->load().message().find("swopped"), std::string::npos) << config.displays->load().toString();
  test::writeText(config.path, good.str());
  config.read();
  EXPECT_TRUE(config.displays->check().ok()) << config.displays->check().toString();
  std::filesystem::remove(config.folder.path + "/half.spi1d");
  config.read();
  EXPECT_TRUE(config.displays->load().ok());
  const Status missing = config.displays->check();
  EXPECT_EQ(missing.code(), Code::InvalidArgument);
  EXPECT_NE(missing.message().find("view \"Half\""), std::string::npos) << missing.toString();
  EXPECT_NE(missing.message().find("half.spi1d"), std::string::npos) << missing.toString();
  // So is one of a look.
  parts.more = "";
  Config looks(parts);
  std::ostringstream all;
  all << std::ifstream(looks.path).rdbuf();
  std::string text = all.str();
  const std::string from = "!<CDLTransform> {slope: [1.5, 1, 0.5]}";
  text.replace(text.find(from), from.size(), "!<FileTransform> {src: warm.spi1d}");
  test::writeText(looks.path, text);
  looks.read();
  EXPECT_NE(looks.displays->check().message().find("look \"warm\""), std::string::npos) << looks.displays->check().toString();
}

struct EngineWithDisplays {
  Config config;
  std::unique_ptr<Engine> engine;
  explicit EngineWithDisplays(bool configured = true) {
    EngineOptions o;
    o.loader = inProcessLoader();
    o.threads = 2;
    o.storeBytes = 64ull << 20;
    if (configured) o.displays = config.displays;
    engine = std::move(*Engine::create(o));
  }
  Status refused(const std::vector<std::string>& edits, const std::string& place, const std::vector<std::string>& words,
                 Code code = Code::InvalidArgument) const {
    v1::RenderRequest r = smallRequest("cornell");
    for (const std::string& e : edits) set(r, e);
    const Status s = engine->resolve(r).status();
    EXPECT_EQ(s.code(), code) << s.toString();
    EXPECT_EQ(s.location(), place) << s.toString();
    for (const std::string& w : words) EXPECT_NE(s.message().find(w), std::string::npos) << w << " is not in: " << s.message();
    return s;
  }
};

TEST(DisplayRequests, RefusalsNameFieldValueAndWhatThereIs) {
  const EngineWithDisplays e;
  const std::string d = "request.encoding.display", v = "request.encoding.view", png = "encoding.format=PNG";
  e.refused({png, "encoding.display=Monitr"}, d, {"Monitr", "\"Monitor\", \"Projector\"", "config.ocio"});
  e.refused({png, "encoding.view=Cinema"}, v, {"Cinema", "Monitor", "\"Power\", \"Swapped\", \"Log\", \"sRGB\", \"Graded\", \"Half\", \"Raw\""});
  e.refused({png, "encoding.view=power"}, v, {"\"power\"", "\"Power\""});  // names are as the config has them
  e.refused({png, "encoding.view=Hidden"}, v, {"Hidden", "active_views"});
  e.refused({png, "encoding.view=Power", "encoding.look=cold"}, "request.encoding.look", {"cold", "\"doubled\", \"warm\""});
  e.refused({png, "encoding.look=warm"}, "request.encoding.look", {"warm", "request.encoding.display"});
  e.refused({png, "encoding.view=Power", "tone_map.curve=LINEAR"}, v, {"Power", "request.tone_map.curve"});
  e.refused({png, "encoding.display=Monitor", "tone_map.curve=FILMIC"}, d, {"Monitor", "request.tone_map.curve"});  // the default too, once it is given
  e.refused({png, "encoding.view=Power", "encoding.transfer=SRGB"}, v, {"Power", "request.encoding.transfer"});
  e.refused({png, "encoding.view=Power", "encoding.ocio_hash=00112233445566778899aabbccddeeff"}, "request.encoding.ocio_hash",
            {"00112233445566778899aabbccddeeff", e.config.resolved("Power").ocio_hash()}, Code::FailedPrecondition);
  for (const char* format : {"EXR", "RAW_FLOAT", "RAW_HALF"})
    e.refused({std::string("encoding.format=") + format, "encoding.view=Power"}, v, {"Power", format, "PNG or JPEG"});
  e.refused({"encoding.display=Monitor"}, d, {"EXR", "PNG or JPEG"});  // its default
  std::filesystem::remove(e.config.folder.path + "/half.spi1d");
  e.refused({png, "encoding.view=Half"}, v, {"half.spi1d", "Half"}, Code::InvalidArgument);
  const EngineWithDisplays without(false);
  without.refused({png, "encoding.view=Power"}, v, {"Power", "[color] ocio", "OCIO", "--ocio"}, Code::FailedPrecondition);
  without.refused({png, "encoding.display=Monitor"}, d, {"Monitor", "[color] ocio"}, Code::FailedPrecondition);
  v1::RenderRequest r = smallRequest("cornell");
  set(r, png);
  EXPECT_TRUE(without.engine->resolve(r).ok()) << "nobody else needs a config";
}

TEST(DisplayRequests, AResolvedRequestIsTheSameAgain) {
  const EngineWithDisplays e;
  v1::RenderRequest r = smallRequest("cornell");
  for (const char* edit : {"encoding.format=PNG", "encoding.view=Log", "encoding.look=warm", "tone_map.exposure=1"}) set(r, edit);
  const RenderResult first = testing::mustRender(*e.engine, r);
  const v1::RenderRequest& resolved = first.reply.resolved();
  EXPECT_EQ(resolved.encoding().display(), "Monitor");
  EXPECT_EQ(resolved.encoding().view(), "Log");
  EXPECT_EQ(resolved.encoding().look(), "warm");
  EXPECT_EQ(resolved.encoding().ocio_hash(), e.config.resolved("Log").ocio_hash());
  EXPECT_FALSE(resolved.tone_map().has_curve());
  EXPECT_FALSE(resolved.encoding().has_transfer());
  ASSERT_TRUE(first.view);
  const RenderResult again = testing::mustRender(*e.engine, resolved);
  EXPECT_EQ(again.view, first.view);
  EXPECT_EQ(again.reply.resolved().SerializeAsString(), resolved.SerializeAsString());
  for (const v1::NodeReport& node : again.reply.plan()) EXPECT_NE(node.state(), v1::NodeReport::RUN) << node.node();
  // The view is of no term's key: another one runs nothing.
  for (const char* edit : {"encoding.view=Power", "encoding.look=doubled", "encoding.display=Monitor"}) {
    set(r, edit);
    const RenderResult other = testing::mustRender(*e.engine, r);
    for (const v1::NodeReport& node : other.reply.plan()) EXPECT_NE(node.state(), v1::NodeReport::RUN) << edit << ": " << node.node();
  }
  set(r, "encoding.view=");
  set(r, "encoding.display=");
  set(r, "encoding.look=");
  const RenderResult plain = testing::mustRender(*e.engine, r);
  EXPECT_FALSE(plain.view);
  EXPECT_EQ(plain.reply.resolved().tone_map().curve(), v1::ToneMap::FILMIC);
}

TEST(DisplayRequests, ARelightPutsAViewInACurvesPlaceAndTheOtherWayRound) {
  const EngineWithDisplays e;
  v1::RenderRequest r = smallRequest("cornell");
  set(r, "encoding.format=PNG");
  const auto relit = [&](const std::string& id, const std::vector<std::string>& edits, std::vector<std::string> mask = {}) -> Result<RenderResult> {
    v1::RelightRequest relight;
    relight.set_render_id(id);
    for (const std::string& edit : edits) set(*relight.mutable_patch(), edit);
    if (mask.empty()) mask = setPaths(relight.patch());
    for (const std::string& path : mask) relight.add_mask(path);
    GOBO_ASSIGN(const v1::RenderRequest request, e.engine->relightRequest(relight));
    return e.engine->render(request);
  };
  const RenderResult curve = testing::mustRender(*e.engine, r);
  const auto view = relit(curve.reply.render_id(), {"encoding.view=Log", "encoding.look=warm", "tone_map.exposure=1"});
  ASSERT_TRUE(view.ok()) << view.status().toString();
  EXPECT_TRUE(view->view);
  EXPECT_EQ(view->reply.resolved().tone_map().exposure(), 1);
  const auto other = relit(view->reply.render_id(), {"encoding.display=Projector"});  // Log is of the other display
  ASSERT_TRUE(other.ok()) << other.status().toString();
  EXPECT_EQ(other->reply.resolved().encoding().view(), "Cinema");
  const auto exposed = relit(view->reply.render_id(), {"tone_map.exposure=2"}, {"tone_map"});
  ASSERT_TRUE(exposed.ok()) << exposed.status().toString();
  EXPECT_EQ(exposed->reply.resolved().encoding().view(), "Log") << "a message without a curve is no word against the view";
  const auto back = relit(view->reply.render_id(), {"tone_map.curve=REINHARD"});
  ASSERT_TRUE(back.ok()) << back.status().toString();
  EXPECT_FALSE(back->view);
  EXPECT_EQ(back->reply.resolved().tone_map().curve(), v1::ToneMap::REINHARD);
  EXPECT_EQ(back->reply.resolved().encoding().view() + back->reply.resolved().encoding().display() + back->reply.resolved().encoding().look() +
                back->reply.resolved().encoding().ocio_hash(),
            "");
  const auto transfer = relit(view->reply.render_id(), {"encoding.transfer=REC709"});
  ASSERT_TRUE(transfer.ok()) << transfer.status().toString();
  EXPECT_FALSE(transfer->view);
  const auto whole = relit(curve.reply.render_id(), {"encoding.format=JPEG", "encoding.view=sRGB"}, {"encoding"});
  ASSERT_TRUE(whole.ok()) << whole.status().toString();
  EXPECT_TRUE(whole->view);
  const auto both = relit(curve.reply.render_id(), {"encoding.view=sRGB", "tone_map.curve=ACES"});
  EXPECT_EQ(both.status().code(), Code::InvalidArgument);
  EXPECT_NE(both.status().message().find("request.tone_map.curve"), std::string::npos) << both.status().toString();
  const auto none = relit(view->reply.render_id(), {"encoding.format=PNG"}, {"encoding"});
  ASSERT_TRUE(none.ok()) << none.status().toString();
  EXPECT_FALSE(none->view);
}

TEST(DisplayTransforms, TheConfigOfTheDocumentsHasWhatTheySay) {
  DisplayTransforms displays({"examples/color/config.ocio", "", [](const std::string& line) { ADD_FAILURE() << line; }});
  const Status status = displays.check();
  EXPECT_TRUE(status.ok()) << status.toString();
  for (const char* view : {"sRGB", "Soft", "Grey"}) {
    v1::RenderRequest r;
    r.mutable_encoding()->set_format(v1::Encoding::PNG);
    r.mutable_encoding()->set_view(view);
    const v1::RenderRequest asked = r;
    EXPECT_TRUE(displays.resolve(r, asked).ok()) << view;
  }
}

}  // namespace
}  // namespace gobo::display_transforms_test
