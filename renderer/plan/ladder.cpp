// SPDX-License-Identifier: Apache-2.0
#include "plan/ladder.h"

#include <algorithm>

namespace gobo {

namespace {

constexpr uint32_t kShrink = 4;
constexpr uint64_t kSmall = 128 * 128;  // pixels that a pass of 16 samples shows at once
constexpr double kSoonMs = 100;         // for the first pass
constexpr uint32_t kFew = 4;            // samples that come as soon as one

Rung rungOf(const v1::RenderRequest& resolved) {
  Rung rung{resolved};
  rung.request.clear_certificate();  // of the reply alone
  rung.request.clear_halt();
  rung.request.mutable_halt()->set_spp(rung.spp);
  return rung;
}

}  // namespace

std::optional<Rung> smallRung(const v1::RenderRequest& resolved) {
  if (resolved.has_window() || uint64_t(resolved.width()) * resolved.height() <= kSmall) return std::nullopt;
  Rung rung = rungOf(resolved);
  rung.request.set_width(std::max(1u, resolved.width() / kShrink));
  rung.request.set_height(std::max(1u, resolved.height() / kShrink));
  // Intrinsics are in pixels of the picture.
  const double x = double(rung.request.width()) / resolved.width(), y = double(rung.request.height()) / resolved.height();
  if (rung.request.has_camera()) {
    v1::CameraSettings& k = *rung.request.mutable_camera();
    if (k.has_focal_x() || k.has_focal_y()) {
      const double fx = k.has_focal_x() ? k.focal_x() : k.focal_y(), fy = k.has_focal_y() ? k.focal_y() : k.focal_x();
      k.set_focal_x(fx * x);
      k.set_focal_y(fy * y);
    }
    if (k.has_center_x()) k.set_center_x(k.center_x() * x);
    if (k.has_center_y()) k.set_center_y(k.center_y() * y);
  }
  return rung;
}

std::optional<Rung> wholeRung(const v1::RenderRequest& resolved, double smallMs, uint32_t mostSpp) {
  // A pass has 16 samples, and a sample of many costs about a quarter of a lonely one.
  const double passMs = smallMs * kShrink * kShrink * 16 / 4;
  if (resolved.has_window() || mostSpp <= kFew || passMs < kSoonMs) return std::nullopt;
  return rungOf(resolved);
}

}  // namespace gobo
