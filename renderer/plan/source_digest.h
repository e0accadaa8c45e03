// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace gobo {
inline namespace plan {

/// Part of every recipe key in builds for work on the code (CMAKE_BUILD_TYPE Debug): a digest of the renderer's sources, so that a store on disk never
/// serves what other code made. Empty in builds for use, where versions of nodes say what changed (docs/changed_pictures.md).
std::string_view sourceDigest();

}  // namespace plan
}  // namespace gobo
