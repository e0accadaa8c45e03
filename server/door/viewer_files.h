// SPDX-License-Identifier: Apache-2.0
// The files of clients/viewer, part of the program (server/door/embed.cmake).
#pragma once

#include <span>
#include <string_view>

namespace gobo {
inline namespace door {

struct ViewerFile {
  std::string_view name, type, bytes;  ///< "index.html", its media type
};

std::span<const ViewerFile> viewerFiles();

}  // namespace door
}  // namespace gobo
