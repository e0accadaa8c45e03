// SPDX-License-Identifier: Apache-2.0
#include "plan/ladder.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>

#include "filters/picture/chain.h"
#include "plan/outputs.h"
#include "request/shutter.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

constexpr uint64_t kSmall = 128 * 128;  // pixels that are there at once
constexpr double kSoonMs = 60;          // pictures that would follow each other faster than this are left out
constexpr double kTurnMs = 200;         // small pictures of all who wait
constexpr uint64_t kLeast = 4096;       // pixels of a picture that is an eighth of another
constexpr size_t kScenes = 256;         // that RungPace knows
constexpr double kWorthTrying = 1.5;    // how much longer than the time that is left a pass may be expected to take: it is dropped if it does

}  // namespace

uint32_t RungPace::shrink(const std::string& scene, uint64_t pixels, size_t waiting) const {
  const std::lock_guard lock(mutex_);
  const auto known = msPerPixel_.find(scene);
  if (pixels < kShrinkMore * kShrinkMore * kLeast) return kShrink;
  if (known == msPerPixel_.end()) return kShrinkMore;
  const double ms = known->second * double(pixels) / (kShrink * kShrink);
  return ms > kRungMs || ms * double(waiting + 1) > kTurnMs ? kShrinkMore : kShrink;
}

void RungPace::took(const std::string& scene, uint64_t pixels, double ms) {
  if (pixels == 0 || !(ms > 0)) return;
  const std::lock_guard lock(mutex_);
  if (msPerPixel_.size() >= kScenes && !msPerPixel_.count(scene)) msPerPixel_.clear();
  const auto [at, fresh] = msPerPixel_.emplace(scene, ms / double(pixels));
  const double now = ms / double(pixels);  // the first one has in it what is made once
  if (!fresh) at->second = now < at->second ? now : at->second + 0.25 * (now - at->second);
}

std::optional<v1::RenderRequest> smallRung(const v1::RenderRequest& resolved, uint32_t shrink) {
  if (resolved.has_window() || uint64_t(resolved.width()) * resolved.height() <= kSmall) return std::nullopt;
  v1::RenderRequest rung = resolved;
  rung.clear_certificate();  // of the reply alone
  rung.clear_halt();
  rung.mutable_halt()->set_spp(shutterSlices(resolved));  // one of each
  rung.set_width(std::max(1u, resolved.width() / shrink));
  rung.set_height(std::max(1u, resolved.height() / shrink));
  scaleFilters(rung, double(rung.width()) / resolved.width());
  // Intrinsics are in pixels of the picture.
  const double x = double(rung.width()) / resolved.width(), y = double(rung.height()) / resolved.height();
  if (rung.has_camera()) {
    v1::CameraSettings& k = *rung.mutable_camera();
    if (k.has_focal_x() || k.has_focal_y()) {
      const double fx = k.has_focal_x() ? k.focal_x() : k.focal_y(), fy = k.has_focal_y() ? k.focal_y() : k.focal_x();
      k.set_focal_x(fx * x);
      k.set_focal_y(fy * y);
    }
    if (k.has_center_x()) k.set_center_x(k.center_x() * x);
    if (k.has_center_y()) k.set_center_y(k.center_y() * y);
    for (const char* px : {"camera.focal_x", "camera.focal_y", "camera.center_x", "camera.center_y"}) {  // those of the opening, which are scaled
      rung.mutable_curves()->erase(px);
      rung.mutable_expressions()->erase(px);
    }
  }
  return rung;
}

std::optional<v1::RenderRequest> plainRung(const v1::RenderRequest& rung) {
  for (const std::string& output : rung.outputs())
    if (const OutputInfo* info = findOutput(output); !info || !needsRadiance(*info)) return std::nullopt;
  const auto ofVisibility = [](const v1::PictureFilter& f) { return filteredTerm(f).starts_with("visibility:"); };
  if (std::any_of(rung.filters().begin(), rung.filters().end(), ofVisibility))
    for (const std::string& output : rung.outputs())
      if (output.starts_with("filtered:")) return std::nullopt;  // its number would be another filter's
  v1::RenderRequest plain = rung;
  plain.mutable_shadows()->mutable_path_traced();
  for (auto& [name, light] : *plain.mutable_lights()) light.clear_shadow();
  // Light is filtered as it will be; what is path traced has no visibility.
  auto& filters = *plain.mutable_filters();
  filters.erase(std::remove_if(filters.begin(), filters.end(), ofVisibility), filters.end());
  if (plain.has_environment()) {
    plain.mutable_environment()->clear_transfer();
    plain.mutable_environment()->clear_extract_lights();
    plain.mutable_environment()->clear_area_lights();
    plain.mutable_environment()->clear_area_lights_if_worth();
    plain.mutable_environment()->clear_subtractive();
  }
  // What moves during a shutter may be in what has gone, or stand at another place now: it stays as it is at the opening.
  const auto stay = [](auto& varying) {
    for (auto v = varying.begin(); v != varying.end();) {
      const std::string& path = v->first;
      const bool gone = path.starts_with("shadows.") || path.starts_with("environment.") || path.starts_with("filters[") ||
                        (path.starts_with("lights.") && path.find(".shadow.") != std::string::npos);
      v = gone ? varying.erase(v) : std::next(v);
    }
  };
  stay(*plain.mutable_curves());
  stay(*plain.mutable_expressions());
  if (google::protobuf::util::MessageDifferencer::Equals(plain, rung)) return std::nullopt;
  return plain;
}

uint32_t nextRung(uint32_t spp, uint32_t most, const RungTimes& times) {
  most = samplesOf(passesFor(most));
  if (samplesOf(passesFor(spp)) >= most) return spp;
  const uint32_t least = samplesOf(passesFor(spp) + 1);
  double add = spp;  // twice as many; of the first block more, where so few would be there before anybody has looked
  if (spp < kBlockSamples && times.perSample > 0) add = std::clamp(kSoonMs / times.perSample, add, double(kBlockSamples - spp));
  if (times.left >= 0 && times.perSample > 0) {
    const double fits = times.left / times.perSample;
    if (!times.rough && fits * kWorthTrying < least - spp) return spp;
    add = std::min(add, fits);
  }
  const uint32_t aim = uint32_t(std::min<double>(spp + add, most));
  const uint32_t passes = passesFor(aim);
  return std::max(samplesOf(passes) > aim ? samplesOf(passes - 1) : samplesOf(passes), least);
}

}  // namespace plan
}  // namespace gobo
