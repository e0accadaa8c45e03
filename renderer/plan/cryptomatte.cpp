// SPDX-License-Identifier: Apache-2.0
#include "plan/cryptomatte.h"

#include <algorithm>
#include <cstdio>
#include <set>

#include "base/murmur3.h"
#include "base/utf8.h"
#include "plan/output_plans.h"
#include "plan/outputs.h"
#include "techniques/path_traced/trace_paths.h"
#include "terms/cryptomatte.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {

constexpr uint32_t kFewestMatteSamples = 16;

/// Of each instance: of its own name, or that of its material.
std::vector<uint32_t> idsOfInstances(const Scene& scene, MatteOf of, const std::vector<std::string>& names) {
  std::vector<uint32_t> ids, out;
  for (const std::string& n : names) ids.push_back(cryptomatteId(n));
  if (of == MatteOf::Objects) return ids;
  for (const Instance& i : scene.instances) out.push_back(ids[size_t(scene.meshes[size_t(i.mesh)]->material)]);
  return out;
}

/// One node traces for both outputs, if both are asked for.
Result<OutputPlane> planCryptomatte(OutputContext& o, const std::string& output) {
  PlanContext& c = o.plan;
  const PathTracerSettings paths = pathTracerSettings(c, PathClass::Emission);
  CryptomatteSettings s;
  s.view = c.view();
  s.samples = cryptomatteSamples(c.passes(), c.share().of);
  s.share = c.share();
  s.viewSamples = paths.viewSamples;
  s.sampler = samplerOf(c.request().integrator());
  s.seed = c.pathSeed();
  for (const std::string& asked : c.request().outputs()) {
    if (findOutput(asked)->kind != OutputKind::Matte) continue;
    const MatteOf of = asked == "cryptomatte_object" ? MatteOf::Objects : MatteOf::Materials;
    const std::vector<std::string> names = matteNames(*c.scene(), of);
    if (const std::string same = cryptomatteCollisions(names); !same.empty()) c.warn(asked + ": " + same);
    (of == MatteOf::Objects ? s.objects : s.materials) = idsOfInstances(*c.scene(), of, names);
    (of == MatteOf::Objects ? s.ofObjects : s.ofMaterials) = true;
  }
  return OutputPlane{c.source(makeCryptomatteNode(std::move(s)), {}, {}, "cryptomatte", c.scene()), output == "cryptomatte_object" ? "object" : "material"};
}

}  // namespace

std::vector<std::string> matteNames(const Scene& scene, MatteOf of) {
  std::vector<std::string> names;
  if (of == MatteOf::Objects)
    for (const Instance& i : scene.instances) names.push_back(cleanUtf8(i.name));
  else
    for (const Material& m : scene.materials) names.push_back(cleanUtf8(m.name));
  std::set<std::string> taken(names.begin(), names.end());
  for (size_t i = 0; i < names.size(); ++i) {
    if (!names[i].empty()) continue;
    const std::string plain = (of == MatteOf::Objects ? "instance" : "material") + std::to_string(i);
    names[i] = plain;
    for (int k = 2; !taken.insert(names[i]).second; ++k) names[i] = plain + "#" + std::to_string(k);
  }
  return names;
}

std::vector<std::string> cryptomatteChannels(std::string_view layer) {
  std::vector<std::string> names;
  for (int c = 0; c < kCryptomatteChannels; ++c) {
    char number[8];
    std::snprintf(number, sizeof number, "%02d.%c", c / 4, "RGBA"[c % 4]);
    names.push_back(std::string(layer) + number);
  }
  return names;
}

std::map<std::string, std::string> cryptomatteAttributes(const std::string& layer, const std::vector<std::string>& names) {
  std::vector<std::string> manifest;
  std::set<std::string> listed;
  for (const std::string& n : names) {
    if (!listed.insert(n).second) continue;
    manifest.push_back(n);
    manifest.push_back(cryptomatteHex(cryptomatteId(n)));
  }
  const std::string key = "cryptomatte/" + cryptomatteHex(murmurHash3(layer)).substr(0, 7) + "/";
  return {{key + "name", layer}, {key + "hash", "MurmurHash3_32"}, {key + "conversion", "uint32_to_float32"}, {key + "manifest", jsonObject(manifest)}};
}

std::string cryptomatteCollisions(const std::vector<std::string>& names) {
  std::map<uint32_t, std::string> byId;
  std::set<std::string> told;
  std::string all;
  for (const std::string& n : names) {
    const std::string& first = byId.emplace(cryptomatteId(n), n).first->second;
    if (first != n && told.insert(n).second) all += (all.empty() ? "" : "; ") + ("names '" + first + "' and '" + n + "' have one id");
  }
  return all;
}

int cryptomatteSamples(uint32_t passes, uint32_t slices) {
  const uint64_t all = std::clamp<uint64_t>(uint64_t(samplesOf(passes)) * slices, kFewestMatteSamples, kMostCryptomatteSamples);
  return int((all + slices - 1) / slices);
}

bool cryptomatteTakesMore(uint32_t passes, uint32_t slices) { return uint64_t(samplesOf(passes)) * slices < kMostCryptomatteSamples; }

Result<OutputPlane> planCryptomatteObject(OutputContext& o, const std::string& output, const std::string&) { return planCryptomatte(o, output); }
Result<OutputPlane> planCryptomatteMaterial(OutputContext& o, const std::string& output, const std::string&) { return planCryptomatte(o, output); }

}  // namespace plan
}  // namespace gobo
