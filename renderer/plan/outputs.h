// SPDX-License-Identifier: Apache-2.0
// The table of outputs: names, channels, and how pictures of them are stored and shown. The planner, the encoders and the
// error messages read it; docs/protocol.md ("Outputs") says it in words. Constant; any thread.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"
#include "technique/path_set.h"
#include "terms/gbuffer.h"
#include "terms/graph.h"

namespace gobo {
inline namespace plan {

enum class OutputKind : uint8_t {
  Radiance,  ///< tone mapped in PNG and JPEG; DWA may lose some
  Colour,    ///< albedo: the transfer function only; DWA may lose some
  Plain,     ///< 0..1 by itself: alpha, visibility
  Vector,    ///< normal, motion
  Range,     ///< shown over its own range: depth, position, sample_count, variance
  Id,        ///< shown in a colour of its own
  Matte,     ///< pairs (id, coverage): shown as the mean of the ids' colours; no halves
};

struct NoisySlice;    // plan/denoised.h
class OutputContext;  // plan/output_plans.h
struct OutputPlane {
  NodeId node = -1;
  std::string plane;
  /// Of a slice of a shutter's picture whose mean is filtered (plan/denoised_slices.h): what it is made of. `node` is then what it shows without the filter.
  std::shared_ptr<const NoisySlice> noisy;
  NodeId clear = -1;  ///< PlanContext::clear() of a picture with alpha that is still to get it
};
/// `light`: its name, for outputs of one.
using PlanOutput = Result<OutputPlane> (*)(OutputContext& context, const std::string& output, const std::string& light);

struct OutputInfo {
  const char* name;  ///< "group" for "group:LIGHT"
  OutputKind kind;
  PlanOutput plan;
  PathSet shows = PathSet::None;  ///< of the beauty; needed whole where it is told apart neither by class nor by lobe
  const char* channels = "RGB";   ///< EXR channel names, one letter each; of a matte its layers' name (plan/cryptomatte.h)
  bool perLight = false;
  bool float32 = false;                 ///< never stored as half
  GBufferPart seen = GBufferPart::All;  ///< what it needs of the camera's first hits; of a request all have what one needs
  bool perFilter = false;               ///< "filtered" for "filtered:N", a stage of request.filters
  bool named() const { return perLight || perFilter; }
  std::vector<std::string> channelNames() const;
  bool lossless() const { return kind != OutputKind::Radiance && kind != OutputKind::Colour; }
};

std::span<const OutputInfo> outputTable();
/// The row of "beauty", "group:key", ...; null if there is none.
const OutputInfo* findOutput(std::string_view output);
/// "key" of "group:key", "0" of "filtered:0"; empty for outputs of neither a light nor a filter.
std::string_view outputLight(std::string_view output);
/// N of "filtered:N". Errors: InvalidArgument: no number of a filter of the request.
Result<int> filterOfOutput(const v1::RenderRequest& request, std::string_view output);
/// Outputs that need the beauty's nodes; of these the ones that show some classes alone, and the ones that show some lobes alone.
bool needsRadiance(const OutputInfo& output);
/// A sum of light of the beauty that has a name of its own: the beauty, its classes and lobes; not that of one lamp.
bool sumsLight(const OutputInfo& output);
bool needsClasses(const OutputInfo& output);
bool needsLobes(const OutputInfo& output);
/// What the camera's first hits are, without any light: from albedo to motion.
bool showsFirstHits(const OutputInfo& output);

/// Names an output that does not exist, or a light that the scene lacks, or a filter that the request lacks.
Status checkOutputs(const Scene& scene, const v1::RenderRequest& request);
/// Refuses encodings that cannot be: layers in anything but EXR, PNG of other than 8 or 16 bits, unknown enum values.
Status checkEncoding(const v1::Encoding& encoding);

/// {"a":"b",...} of pairs of strings.
std::string jsonObject(std::span<const std::string> namesAndValues);
/// {"0":"floor","1":"box"}: what an id stands for.
std::string nameTable(std::span<const std::string> names);

}  // namespace plan
}  // namespace gobo
