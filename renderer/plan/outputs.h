// SPDX-License-Identifier: Apache-2.0
// The table of outputs: names, channels, and how pictures of them are stored and shown. The planner, the encoders and the
// error messages read it; docs/protocol.md ("Outputs") says it in words. Constant; any thread.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {

enum class OutputKind : uint8_t {
  Radiance,  ///< tone mapped in PNG and JPEG; DWA may lose some
  Colour,    ///< albedo: the transfer function only; DWA may lose some
  Plain,     ///< 0..1 by itself: alpha, visibility
  Vector,    ///< normal, motion
  Range,     ///< shown over its own range: depth, position, sample_count, variance
  Id,        ///< shown in a colour of its own
};

struct OutputInfo {
  const char* name;  ///< "group" for "group:LIGHT"
  OutputKind kind;
  bool perLight = false;
  bool float32 = false;          ///< never stored as half
  const char* channels = "RGB";  ///< EXR channel names, one letter each
  std::vector<std::string> channelNames() const;
  bool lossless() const { return kind != OutputKind::Radiance && kind != OutputKind::Colour; }
};

std::span<const OutputInfo> outputTable();
/// The row of "beauty", "group:key", ...; null if there is none.
const OutputInfo* findOutput(std::string_view output);
/// "key" of "group:key"; empty for outputs without a light.
std::string_view outputLight(std::string_view output);
/// Outputs that need the beauty's nodes, and of these the ones by the lobe of the first scattering event.
bool needsRadiance(std::string_view output);
bool needsLobes(std::string_view output);

/// Names an output that does not exist, or a light that the scene lacks.
Status checkOutputs(const Scene& scene, const v1::RenderRequest& request);
/// Refuses encodings that cannot be: layers in anything but EXR, PNG of other than 8 or 16 bits, unknown enum values.
Status checkEncoding(const v1::Encoding& encoding);

/// {"a":"b",...} of pairs of strings.
std::string jsonObject(std::span<const std::string> namesAndValues);
/// {"0":"floor","1":"box"}: what an id stands for.
std::string nameTable(std::span<const std::string> names);

}  // namespace gobo
