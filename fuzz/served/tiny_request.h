// SPDX-License-Identifier: Apache-2.0
// Requests that cost milliseconds and are otherwise what they were. Pure; any thread.
#pragma once

#include <string>

#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo::fuzz {

/// Bounds whatever counts work in the message and in the requests that it has: pixels, samples, rays, texels, photons. Values that the schema
/// refuses stay as they are. A request without a bound in samples gets one. Taken out is what no two renders agree on: a technique that is
/// chosen by the clock, and devices, which are not there everywhere.
void makeTiny(google::protobuf::Message& message);

/// A text for a field of a request: an output, a light, a camera, an animation, a variant of the scene (null: of none), or one that is nothing.
std::string requestText(const std::string& field, uint32_t value, const Scene* scene);

}  // namespace gobo::fuzz
