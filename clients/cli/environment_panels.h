// SPDX-License-Identifier: Apache-2.0
// What both methods of `gobo environment` print and draw alike.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "techniques/transfer/environment_report.h"

namespace gobo::cli {

struct EnvironmentPanels {
  static constexpr double kDegrees = 57.29577951308232;
  static std::string list(const DVec3& v, const char* format);
  static std::string json(const DVec3& v);
  /// Of --out (empty: PNG). InvalidArgument unless it ends in .png or .exr.
  static Result<v1::Encoding::Format> formatOf(const std::string& out);
  /// PNG: four panels; EXR: four layers.
  static Result<std::vector<uint8_t>> drawn(const transfer::EnvironmentReport& report, v1::Encoding::Format format);
};

}  // namespace gobo::cli
