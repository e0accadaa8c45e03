// SPDX-License-Identifier: Apache-2.0
// The properties by name, for what feeds them: gobo_fuzz_run and the tests.
#pragma once

#include <cstddef>
#include <span>

#include "fuzz/properties.h"

namespace gobo::fuzz {

struct Target {
  const char* name;  ///< tests/data/fuzz/NAME, tests/data/fuzz/corpus/NAME.pack
  Outcome (*property)(Bytes);
  size_t mostBytes;        ///< of an input
  const char* dictionary;  ///< fuzz/NAME.dict; empty: none
  bool lines = false;      ///< each line of what is said is a kind of answer of its own; else the first line is
};

/// What reads bytes: these are libFuzzer's targets too.
std::span<const Target> readerTargets();
/// What needs a renderer or a server (fuzz/served). Their names are known here, so that a folder of regressions belongs to somebody.
std::span<const Target> servedTargets();
constexpr const char* kServedNames[] = {"rendered_request", "sequence"};

}  // namespace gobo::fuzz
