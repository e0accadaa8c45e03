// SPDX-License-Identifier: Apache-2.0
#include "request/shutter.h"

#include <algorithm>
#include <string_view>

#include "base/sobol.h"
#include "request/curves.h"
#include "request/expressions.h"
#include "request/request.h"
#include "scene/rig.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace request {

namespace {

constexpr uint64_t kMostSpp = 1u << 20;  // of halt.spp in the proto

/// Of the picture that is shown, or of the shutter: at the moment when it opens.
bool ofTheOpening(std::string_view path) { return path.starts_with("tone_map.") || path.starts_with("camera.shutter_"); }

/// Moves what is seen on the screen.
bool movesOnScreen(std::string_view path) { return (path.starts_with("camera.") || path.starts_with("meshes.")) && !ofTheOpening(path); }

/// First-hit outputs and those of shadows that are of one moment: ids and places have no mean, and a mean over what is hit is none of means.
bool hasMean(std::string_view output) {
  constexpr std::string_view first[] = {
      "normal",      "position",    "depth",     "z_depth",          "object_id",     "material_id",  "motion",        "variance",
      "unoccluded:", "visibility:", "filtered:", "shadow_distance:", "shadow_flags:", "shadow_rays:", "shadow_width:", "shadow_basis:"};
  return std::none_of(std::begin(first), std::end(first), [&](std::string_view o) { return o.ends_with(':') ? output.starts_with(o) : output == o; });
}

Status refuseMoments(const v1::RenderRequest& r) {
  const std::string shutter = "request.camera.shutter_s = " + std::to_string(r.camera().shutter_s());
  const auto refuse = [&](const std::string& field, const std::string& why) { return invalidArgument(shutter + ": " + why, field); };
  for (const std::string& o : r.outputs())
    if (!hasMean(o)) return refuse("request.outputs", "output '" + o + "' is of one moment; ask for it without a shutter, or leave it out");
  if (r.denoise().has_outliers()) return refuse("request.denoise.outliers", "request.denoise.outliers is of one moment; leave out one of them");
  if (r.halt().has_error())
    return refuse("request.halt.error", "request.halt.error is measured by a certificate, which is of one moment; give halt.spp or time_s");
  if (r.has_certificate()) return refuse("request.certificate", "request.certificate is of one moment; leave out one of them");
  return {};
}

}  // namespace

uint32_t shutterSlices(const v1::RenderRequest& resolved) {
  if (!hasShutter(resolved)) return 1;
  const uint32_t slices = resolved.camera().has_shutter_slices() ? resolved.camera().shutter_slices() : kShutterSlices;
  return std::max(1u, resolved.halt().has_spp() ? std::min(slices, resolved.halt().spp()) : slices);
}

bool mayHaveLens(const v1::RenderRequest& request) {
  if (request.camera().has_f_number() || request.camera().lens_radius() > 0.0) return true;
  return hasShutter(request) && (request.curves().contains("camera.lens_radius") || request.curves().contains("camera.f_number") ||
                                 request.expressions().contains("camera.lens_radius") || request.expressions().contains("camera.f_number"));
}

bool mayMove(const Scene& scene, const v1::RenderRequest& request) {
  return (scene.rig && !scene.rig->animations.empty()) || !request.curves().empty() || expressionsMove(request);
}

Status resolveShutter(v1::RenderRequest& request, const v1::RenderRequest& asked, const Scene& scene) {
  if (!hasShutter(request)) return {};
  for (const auto& [path, curve] : asked.curves())
    if (!ofTheOpening(path)) (*request.mutable_curves())[path] = curve;
  for (const auto& [path, expression] : asked.expressions())
    if (!ofTheOpening(path)) (*request.mutable_expressions())[path] = expression;
  v1::CameraSettings& camera = *request.mutable_camera();
  if (!mayMove(scene, request)) camera.set_shutter_slices(1);
  else {
    if (!camera.has_shutter_slices()) camera.set_shutter_slices(kShutterSlices);
    GOBO_TRY(refuseMoments(request));
    // What the picture gets (the reply's halt.spp) must be what may be asked for again.
    if (request.halt().has_spp()) {
      const uint32_t slices = shutterSlices(request);
      if (const uint64_t got = uint64_t(samplesOf(passesFor(samplesOfSlice(request.halt().spp(), slices)))) * slices; got > kMostSpp)
        return invalidArgument("request.halt.spp = " + std::to_string(request.halt().spp()) + ": request.camera.shutter_slices = " + std::to_string(slices) +
                                   " make it " + std::to_string(got) + ", more than " + std::to_string(kMostSpp),
                               "request.halt.spp");
    }
  }
  return {};
}

void resolveMotion(v1::RenderRequest& request, const v1::RenderRequest& asked) {
  if (std::find(request.outputs().begin(), request.outputs().end(), "motion") == request.outputs().end()) return;
  for (const auto& [path, curve] : asked.curves())
    if (movesOnScreen(path)) (*request.mutable_curves())[path] = curve;
  for (const auto& [path, expression] : asked.expressions())
    if (movesOnScreen(path)) (*request.mutable_expressions())[path] = expression;
}

uint64_t sliceSeed(uint64_t seed, uint32_t slice, uint32_t slices) { return slices == 1 ? seed : hash64(mix64(seed ^ 0x5348555454455231ull), slice); }

Result<v1::RenderRequest> sliceRequest(const v1::RenderRequest& resolved, uint32_t k) {
  const uint32_t slices = shutterSlices(resolved);
  v1::RenderRequest r = resolved;
  r.set_seed(sliceSeed(resolved.seed(), k, slices));
  r.set_time_s(resolved.time_s() + (k + 0.5) / slices * resolved.camera().shutter_s());
  if (!resolved.curves().empty() || !resolved.expressions().empty()) {
    GOBO_TRY(applyCurves(r));
    GOBO_TRY(applyExpressions(r));
    GOBO_TRY(resolveDefaults(r));  // of messages that one of them made
    // The mean of the slices is filtered, once: by what the filters are at the opening.
    for (int f = 0; f < r.filters_size(); ++f)
      if (r.filters(f).term().empty() || r.filters(f).term() == "beauty") *r.mutable_filters(f) = resolved.filters(f);
  }
  r.mutable_camera()->clear_shutter_s();
  r.mutable_camera()->clear_shutter_slices();
  if (resolved.halt().has_spp()) r.mutable_halt()->set_spp(samplesOfSlice(resolved.halt().spp(), slices));
  return r;
}

}  // namespace request
}  // namespace gobo
