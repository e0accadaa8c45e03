// SPDX-License-Identifier: Apache-2.0
// A request that is rendered, on a small scene with everything in it or on a room. First byte: the scene, whether a picture is made a third time on one thread
// without a store, whether pictures are compared as files. Second: how many edits (message_edits.h) follow, of 10 bytes each. The rest are wire bytes
// of the request that is edited. Bounds of all counts keep it at milliseconds (tiny_request.h).
#pragma once

#include "fuzz/properties.h"
#include "gobo/v1/render.pb.h"

namespace gobo::fuzz {

/// The request of an input.
v1::RenderRequest renderedRequest(Bytes bytes);

/// Refused with a code that blames the request and the field's name, or: every number of every picture is finite; rendered again as the reply resolved it, the
/// same bits, whatever the store holds, on any number of threads; as files the same bytes.
Outcome tryRenderedRequest(Bytes bytes);

}  // namespace gobo::fuzz
