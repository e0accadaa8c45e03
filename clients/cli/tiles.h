// SPDX-License-Identifier: Apache-2.0
// A picture that is rendered part by part (request.window), each written into one tiled EXR as it comes: in the memory of two tiles.
#pragma once

#include "pictures.h"
#include "session.h"

namespace gobo::cli {

struct Tiled {
  v1::RenderReply reply;  ///< of the first tile; resolved, images, rays, total_ms and peak_bytes are those of all
  int tiles = 0;
};
/// `progress`: tiles done and of how many; may be empty. Errors: the calls'; InvalidArgument naming what does not go in tiles. `file` appears whole or not at
/// all.
Result<Tiled> renderTiles(Session& session, v1::RenderRequest request, uint32_t tile, const std::string& file, const std::function<void(int, int)>& progress);

}  // namespace gobo::cli
