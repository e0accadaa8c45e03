// SPDX-License-Identifier: Apache-2.0
#include "plan/outputs.h"

#include <algorithm>
#include <charconv>
#include <cstdio>

#include "plan/cryptomatte.h"
#include "plan/output_plans.h"

namespace gobo {
inline namespace plan {

namespace {

constexpr PathSet kScattered = PathSet::Direct | PathSet::Indirect | PathSet::Caustic, kIndirect = PathSet::Indirect | PathSet::Caustic;

const OutputInfo kTable[] = {
    {"beauty", OutputKind::Radiance, planComposite, PathSet::All},
    {"emission", OutputKind::Radiance, planComposite, PathSet::Emission},
    {"direct", OutputKind::Radiance, planComposite, PathSet::Direct},
    {"indirect", OutputKind::Radiance, planComposite, kIndirect},
    {"diffuse", OutputKind::Radiance, planComposite, kScattered& PathSet::Diffuse},
    {"specular", OutputKind::Radiance, planComposite, kScattered& PathSet::Specular},
    {"direct_diffuse", OutputKind::Radiance, planComposite, PathSet::Direct& PathSet::Diffuse},
    {"direct_specular", OutputKind::Radiance, planComposite, PathSet::Direct& PathSet::Specular},
    {"indirect_diffuse", OutputKind::Radiance, planComposite, kIndirect& PathSet::Diffuse},
    {"indirect_specular", OutputKind::Radiance, planComposite, kIndirect& PathSet::Specular},
    {"negative_light", OutputKind::Radiance, planNegativeLight, PathSet::All},
    {"albedo", OutputKind::Colour, planAlbedo},
    {"normal", OutputKind::Vector, planNormal, PathSet::None, "XYZ"},
    {"position", OutputKind::Range, planPosition, PathSet::None, "XYZ", false, true, GBufferPart::HitsAndPositions},
    {"depth", OutputKind::Range, planDepth, PathSet::None, "Z", false, true, GBufferPart::Hits},
    {"z_depth", OutputKind::Range, planZDepth, PathSet::None, "Z", false, true, GBufferPart::HitsAndPositions},
    {"alpha", OutputKind::Plain, planAlpha, PathSet::None, "A", false, false, GBufferPart::Hits},
    {"object_id", OutputKind::Id, planObjectId, PathSet::None, "X", false, true, GBufferPart::Hits},
    {"material_id", OutputKind::Id, planMaterialId, PathSet::None, "X", false, true, GBufferPart::Hits},
    {"cryptomatte_object", OutputKind::Matte, planCryptomatteObject, PathSet::None, "crypto_object", false, true, GBufferPart::Hits},
    {"cryptomatte_material", OutputKind::Matte, planCryptomatteMaterial, PathSet::None, "crypto_material", false, true, GBufferPart::Hits},
    {"motion", OutputKind::Vector, planMotion, PathSet::None, "XY", false, true},
    {"sample_count", OutputKind::Range, planSampleCount, PathSet::All, "X", false, true},
    {"variance", OutputKind::Range, planVariance, PathSet::All, "RGB", false, true},
    {"filtered", OutputKind::Radiance, planFilteredStage, PathSet::All, "RGB", false, false, GBufferPart::All, true},
    {"group", OutputKind::Radiance, planComposite, PathSet::All, "RGB", true},
    {"unoccluded", OutputKind::Radiance, planUnoccludedOutput, PathSet::None, "RGB", true},
    {"visibility", OutputKind::Plain, planVisibilityOutput, PathSet::None, "Y", true},
    {"shadow_distance", OutputKind::Range, planShadowDistance, PathSet::None, "X", true, true},
    {"shadow_flags", OutputKind::Plain, planShadowFlags, PathSet::None, "Y", true},
    {"shadow_rays", OutputKind::Range, planShadowRays, PathSet::None, "X", true, true},
    {"shadow_width", OutputKind::Range, planShadowWidth, PathSet::None, "X", true, true},
    {"shadow_basis", OutputKind::Plain, planShadowBasis, PathSet::None, "Y", true, true},  // depths have more bits than half
};

}  // namespace

std::vector<std::string> OutputInfo::channelNames() const {
  if (kind == OutputKind::Matte) return cryptomatteChannels(channels);
  std::vector<std::string> names;
  for (const char* c = channels; *c; ++c) names.emplace_back(1, *c);
  return names;
}

std::span<const OutputInfo> outputTable() { return kTable; }

const OutputInfo* findOutput(std::string_view output) {
  const size_t colon = output.find(':');
  const std::string_view name = output.substr(0, colon);
  for (const OutputInfo& o : kTable)
    if (name == o.name && o.named() == (colon != std::string_view::npos)) return &o;
  return nullptr;
}

std::string_view outputLight(std::string_view output) {
  const size_t colon = output.find(':');
  return colon == std::string_view::npos ? std::string_view{} : output.substr(colon + 1);
}

Result<int> filterOfOutput(const v1::RenderRequest& request, std::string_view output) {
  const std::string_view text = outputLight(output);
  int n = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), n);
  if (error == std::errc() && end == text.data() + text.size() && n >= 0 && n < request.filters_size()) return n;
  return invalidArgument("request.outputs: '" + std::string(output) + "': request.filters has " +
                             (request.filters_size() == 0 ? "no element" : "elements 0 to " + std::to_string(request.filters_size() - 1)) +
                             ", and N is one's number",
                         "request.outputs");
}

bool sumsLight(const OutputInfo& o) { return o.plan == planComposite && !o.perLight; }
bool needsRadiance(const OutputInfo& o) { return o.shows != PathSet::None; }
bool needsLobes(const OutputInfo& o) { return overlaps(o.shows, PathSet::Diffuse) != overlaps(o.shows, PathSet::Specular); }
bool showsFirstHits(const OutputInfo& o) { return !needsRadiance(o) && !o.perLight; }
bool needsClasses(const OutputInfo& o) { return needsRadiance(o) && o.shows != PathSet::All && !needsLobes(o); }

Status checkOutputs(const Scene& scene, const v1::RenderRequest& request) {
  for (const std::string& o : request.outputs()) {
    const OutputInfo* info = findOutput(o);
    if (!info) {
      std::string list;
      for (const OutputInfo& row : kTable) list += (list.empty() ? "" : ", ") + std::string(row.name) + (row.perLight ? ":LIGHT" : row.perFilter ? ":N" : "");
      return invalidArgument("request.outputs: no output '" + o + "' (has: " + list + ")", "request.outputs");
    }
    if (info->perFilter) GOBO_TRY(filterOfOutput(request, o).status());
    if (info->kind == OutputKind::Matte && request.encoding().format() == v1::Encoding::RAW_HALF)
      return invalidArgument("request.encoding.format = RAW_HALF: 16 bits do not hold the ids of '" + o + "'; ask for EXR or RAW_FLOAT",
                             "request.encoding.format");
    if (!info->perLight) continue;
    const v1::CameraSettings& k = request.camera();
    if (std::string_view(info->name) != "group" && (k.has_f_number() || k.lens_radius() > 0.0))
      return invalidArgument("request.outputs: '" + o + "' is what one point sees, and request.camera has a lens", "request.outputs");
    const std::string name(outputLight(o));
    const int light = scene.findLight(name);
    if (light < 0) return notFound("request.outputs: no light '" + name + "' in the scene", "request.outputs");
    if (std::string_view(info->name) != "group" && scene.lights[light].shape.kind == LightKind::Environment)
      return invalidArgument("request.outputs: '" + o + "': an environment has no single visibility; ask for group:" + name, "request.outputs");
    if (std::string_view(info->name) == "shadow_basis" && request.encoding().layers())
      for (const std::string& other : request.outputs())
        if (other != o)
          return invalidArgument("request.outputs: '" + o + "' has the size of its map and cannot be a layer beside '" + other +
                                     "'; ask for it alone or leave out encoding.layers",
                                 "request.outputs");
  }
  return {};
}

Status checkEncoding(const v1::Encoding& e) {
  if (e.layers() && e.format() != v1::Encoding::EXR && e.format() != v1::Encoding::FORMAT_UNSPECIFIED)
    return invalidArgument("request.encoding.layers: only EXR holds layers, encoding.format is " + v1::Encoding::Format_Name(e.format()),
                           "request.encoding.layers");
  if (e.has_png_bits() && e.png_bits() != 8 && e.png_bits() != 16)
    return invalidArgument("request.encoding.png_bits = " + std::to_string(e.png_bits()) + ": must be 8 or 16", "request.encoding.png_bits");
  if (!v1::Encoding::Compression_IsValid(e.compression()))
    return invalidArgument("request.encoding.compression = " + std::to_string(int(e.compression())) + " is not known", "request.encoding.compression");
  if (!v1::Encoding::Transfer_IsValid(e.transfer()))
    return invalidArgument("request.encoding.transfer = " + std::to_string(int(e.transfer())) + " is not known", "request.encoding.transfer");
  return {};
}

std::string jsonObject(std::span<const std::string> namesAndValues) {
  const auto quoted = [](const std::string& text) {
    std::string out = "\"";
    for (const char c : text) {
      char code[8];
      if (c == '"' || c == '\\') (out += '\\') += c;
      else if (static_cast<unsigned char>(c) < 0x20) {
        std::snprintf(code, sizeof code, "\\u%04x", c);
        out += code;
      } else out += c;
    }
    return out + '"';
  };
  std::string out = "{";
  for (size_t i = 0; i + 1 < namesAndValues.size(); i += 2) out += (i ? "," : "") + quoted(namesAndValues[i]) + ":" + quoted(namesAndValues[i + 1]);
  return out + "}";
}

std::string nameTable(std::span<const std::string> names) {
  std::vector<std::string> pairs;
  for (size_t i = 0; i < names.size(); ++i) {
    pairs.push_back(std::to_string(i));
    pairs.push_back(names[i]);
  }
  return jsonObject(pairs);
}

}  // namespace plan
}  // namespace gobo
