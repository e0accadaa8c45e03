// SPDX-License-Identifier: Apache-2.0
// The filter of a request by the name that denoise_bench's command line has for it.
#pragma once

#include <string>

#include "measure/report.h"
#include "request/request.h"

namespace gobo::bench {

/// "none", "wavelet", "wavelet.levels=3", "path_density", "path_density.neighbours=20+wavelet": a rejection of outliers, a filter, or one before the other.
inline Status chooseFilter(v1::RenderRequest& r, const std::string& filter) {
  if (filter == "none") return {};
  for (const std::string& part : partsOf(filter, '+')) {
    const std::string name = part.substr(0, part.find('.'));
    const bool outliers = v1::OutlierRejection::descriptor()->FindFieldByName(name) != nullptr;
    const Status s = setPath(r, std::string(outliers ? "denoise.outliers" : "denoise") + (part.find('=') == std::string::npos ? "=" + part : "." + part));
    if (!s.ok()) return s;
  }
  return {};
}

}  // namespace gobo::bench
