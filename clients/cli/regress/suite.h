// SPDX-License-Identifier: Apache-2.0
// A suite of renders to be held against accepted references: a TOML file (docs/regression.md has every key). Unknown keys, wrong types, values out of range,
// names that come twice and files that are not there are errors that name file:line, key and value; nothing is guessed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo::cli {

/// One [[case]].
struct RegressCase {
  std::string name;
  std::string scene;                ///< file (absolute), id or built-in name
  std::string environment;          ///< file (absolute) in place of the request's environment.path; empty: that one
  v1::RenderRequest request;        ///< all but the scene and the seeds of parts; one output
  uint64_t seed = 0;                ///< the k-th part has the request's seed 16 * seed + k
  uint32_t parts = 8;               ///< renders with seeds of their own; 1: a picture without noise
  double tolerance = 1e-4;          ///< ChangeOptions::tolerance
  double maxTime = 0, maxRays = 0;  ///< times the reference's above which the case fails; 0: any
  int line = 0;                     ///< in the file
};

struct Suite {
  std::string file, name;
  std::string references;  ///< folder, absolute
  std::vector<RegressCase> cases;
};

/// Errors: NotFound where the file cannot be read, else InvalidArgument.
Result<Suite> readSuite(const std::string& file);

}  // namespace gobo::cli
