// SPDX-License-Identifier: Apache-2.0
// The report of a run as one static HTML file: a table, and for each case the reference and the render to flip between, a slider over both, a map of where the
// evidence is, and curves of past runs. Pictures are inside it; it loads nothing.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/image.h"
#include "regress/record.h"

namespace gobo::cli {

/// Text as HTML or XML: & < > and quotes as entities, control characters as '?'.
std::string markup(const std::string& text);
/// RFC 4648, padded.
std::string base64(const std::vector<uint8_t>& bytes);
/// Grey picture under colour where a block stands out: dark red at kChangeExcess, over orange to white at a hundred times that (logarithmic); below it dim
/// blue. Display-referred linear RGB.
Image evidencePicture(const Image& displayed, const std::vector<float>& excess);

struct CasePictures {
  std::vector<uint8_t> reference, now, evidence;  ///< PNG; empty: none
};
/// `pictures` is asked for each case by its name.
std::string reportPage(const RunRecord& run, const std::vector<PastRun>& history, const std::function<CasePictures(const std::string&)>& pictures);

}  // namespace gobo::cli
