// SPDX-License-Identifier: Apache-2.0
// Chooses and traces the pixels that a certificate needs and turns them into figures (statistics: measure/certificate.h).
#pragma once

#include "base/image.h"
#include "gobo/v1/render.pb.h"
#include "plan/reference.h"
#include "request/effective_scene.h"
#include "trace/accel.h"

namespace gobo {
inline namespace plan {

/// `beauty` is a finished linear picture of the effective scene with its gains; certificate.spp samples a chosen pixel, rounded up
/// to four equal parts. Errors: Cancelled.
Result<v1::Certificate> certifyPicture(const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request, AccelCache& accels,
                                       const TaskArena& arena, const StopToken& stop);

/// The same against a reference made by this recipe instead of referenceRecipe(): what certifyPicture() does, and what tests of the
/// certificate's guards do with a recipe that is wrong.
Result<v1::Certificate> certifyAgainst(const ReferenceRecipe& recipe, const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request,
                                       AccelCache& accels, const TaskArena& arena, const StopToken& stop);

/// The pixels of a certificate and their chances.
struct CertificateDraw {
  std::vector<uint32_t> pixels;  ///< y * width + x, ascending
  std::vector<double> chances;   ///< of each
};
/// round(pixel_fraction * N) pixels, at least min_pixels, at most all N, drawn by what the picture says of its own errors. What it gives
/// when `stop` ended it is of no use.
CertificateDraw drawCertificate(const Image& beauty, const v1::CertificateSettings& settings, const StopToken& stop = {});

}  // namespace plan
}  // namespace gobo
