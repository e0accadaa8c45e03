// SPDX-License-Identifier: Apache-2.0
// Traces the pixels that a certificate needs and turns them into figures (statistics: measure/certificate.h).
#pragma once

#include "base/image.h"
#include "gobo/v1/render.pb.h"
#include "plan/effective_scene.h"
#include "trace/accel.h"

namespace gobo {

/// `beauty` is a finished linear picture of the effective scene with its gains. Two independent halves of spp/2 samples a
/// chosen pixel (full pixel filter, seeds apart from the render's). Errors: Cancelled.
Result<v1::Certificate> certifyPicture(const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request,
                                       AccelCache& accels, const TaskArena& arena, const StopToken& stop);

}  // namespace gobo
