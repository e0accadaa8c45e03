// SPDX-License-Identifier: Apache-2.0
// What a progressive reply shows before its first whole pass: a small picture of one sample a pixel, then a whole one. Each is a request of its
// own, so that what it shows can be asked for again; the passes that follow have the same bits as without them.
#pragma once

#include <optional>

#include "gobo/v1/render.pb.h"

namespace gobo {

struct Rung {
  v1::RenderRequest request;
  uint32_t spp = 1;
};

/// A quarter of the size each way; nothing for pictures that are small themselves, and for windows (their place in the whole is what they are).
std::optional<Rung> smallRung(const v1::RenderRequest& resolved);
/// The whole picture at one sample a pixel; nothing where the first pass will come soon: by the time that the small one took, or as few samples.
std::optional<Rung> wholeRung(const v1::RenderRequest& resolved, double smallMs, uint32_t mostSpp);

}  // namespace gobo
