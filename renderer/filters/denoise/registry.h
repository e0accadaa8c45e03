// SPDX-License-Identifier: Apache-2.0
// The denoisers that a request may name.
#pragma once

#include "base/status.h"
#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

/// `settings`: resolved. Null where it names no filter. Errors: InvalidArgument, with the field.
Result<DenoiserPtr> makeDenoiser(const v1::Denoise& settings);

}  // namespace gobo::denoise
