// SPDX-License-Identifier: Apache-2.0
#include "measurement/reference.h"

#include <algorithm>

#include <google/protobuf/util/message_differencer.h>

#include "plan/outputs.h"
#include "request/request.h"

namespace gobo::cli {
namespace {

constexpr uint32_t kMostRays = 4096;  // shadows.ray_traced.samples

bool hasTruth(const OutputInfo& output) {
  const std::string_view name = output.name;
  return sumsLight(output) || name == "group" || name == "visibility";
}

}  // namespace

Result<TruthBy> truthOf(const std::string& output) {
  const OutputInfo* info = findOutput(output);
  if (!info) return TruthBy::Paths;
  if (hasTruth(*info)) return std::string_view(info->name) == "visibility" ? TruthBy::Rays : TruthBy::Paths;
  std::string list;
  for (const OutputInfo& row : outputTable())
    if (hasTruth(row)) list += (list.empty() ? "" : ", ") + std::string(row.name) + (row.perLight ? ":LIGHT" : "");
  return invalidArgument("--output " + output + ": paths or shadow rays give no truth of it; must be one of " + list);
}

const char* errorUnit(TruthBy by) { return by == TruthBy::Rays ? "1" : "scene-linear radiance"; }

v1::RenderRequest truthRequest(v1::RenderRequest request, TruthBy by, uint32_t samples, uint64_t seed) {
  if (by == TruthBy::Rays) request.mutable_shadows()->mutable_ray_traced()->set_samples(std::clamp(samples, 1u, kMostRays));
  else request.mutable_shadows()->mutable_path_traced();
  for (auto& [name, light] : *request.mutable_lights()) light.clear_shadow();
  if (request.has_environment()) {
    request.mutable_environment()->clear_extract_lights();
    request.mutable_environment()->clear_area_lights();
    request.mutable_environment()->clear_area_lights_if_worth();
    request.mutable_environment()->clear_transfer();
    request.mutable_environment()->clear_subtractive();
  }
  request.clear_certificate();
  request.clear_denoise();
  request.clear_filters();
  request.clear_halt();
  request.mutable_halt()->set_spp(by == TruthBy::Rays ? 1 : std::max(1u, samples));
  request.set_seed(seed);
  return request;
}

Status checkSameTruth(const v1::RenderRequest& base, const v1::RenderRequest& point, TruthBy by) {
  const auto picture = [&](const v1::RenderRequest& request) {
    v1::RenderRequest out = truthRequest(request, by, 1, 0);
    const v1::ShadowStyle style = out.shadows().style();
    out.clear_shadows();
    if (request.shadows().has_style()) *out.mutable_shadows()->mutable_style() = style;
    out.clear_integrator();
    out.clear_view_samples();
    out.clear_scheduling();
    out.clear_encoding();
    out.clear_tone_map();
    // An edit that named a shadow alone is none.
    for (auto at = out.mutable_lights()->begin(); at != out.mutable_lights()->end();)
      at = at->second.ByteSizeLong() == 0 ? out.mutable_lights()->erase(at) : std::next(at);
    if (out.has_environment()) out.mutable_environment()->clear_extract_by();
    if (out.has_environment() && out.environment().ByteSizeLong() == 0) out.clear_environment();
    return out;
  };
  const v1::RenderRequest a = picture(base), b = picture(point);
  for (int i = 0; i < v1::RenderRequest::descriptor()->field_count(); ++i) {
    const google::protobuf::FieldDescriptor* field = v1::RenderRequest::descriptor()->field(i);
    google::protobuf::util::MessageDifferencer differ;
    if (!differ.CompareWithFields(a, b, {field}, {field}))
      return invalidArgument(
          std::string("request.") + field->name() + ": a series must not change what the picture is of, all have one reference; --set is of all series",
          std::string("request.") + field->name());
  }
  return {};
}

}  // namespace gobo::cli
