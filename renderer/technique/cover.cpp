// SPDX-License-Identifier: Apache-2.0
#include "technique/cover.h"

#include <cstring>

namespace gobo {
inline namespace technique {

std::string names(PathSet set) {
  static const char* const kNames[] = {"emission",         "direct front diffuse", "direct front specular", "direct behind diffuse", "direct behind specular",
                                       "indirect diffuse", "indirect specular",    "caustic diffuse",       "caustic specular"};
  std::string out;
  for (int bit = 0; bit < 9; ++bit)
    if (uint16_t(set) >> bit & 1) out += (out.empty() ? "" : ", ") + std::string(kNames[bit]);
  return out.empty() ? "nothing" : out;
}

namespace {
std::string ofLight(int light) { return " of light " + std::to_string(light); }
}  // namespace

Cover::Claim* Cover::find(int light, const char* technique) {
  for (Claim& c : lights_[size_t(light)])
    if (std::strcmp(c.technique, technique) == 0) return &c;
  return nullptr;
}

Status Cover::claim(int light, PathSet paths, const char* technique) {
  for (const Claim& c : lights_[size_t(light)])
    if (overlaps(c.claimed, paths))
      return internalError("technique " + std::string(technique) + " claims " + names(c.claimed & paths) + ofLight(light) + ", which " + c.technique + " has");
  if (Claim* mine = find(light, technique)) mine->claimed = mine->claimed | paths;
  else lights_[size_t(light)].push_back({technique, paths});
  return {};
}

Status Cover::bring(int light, PathSet paths, const char* technique) {
  Claim* mine = find(light, technique);
  if (!mine || !contains(mine->claimed, paths))
    return internalError("technique " + std::string(technique) + " brings " + names(mine ? paths - mine->claimed : paths) + ofLight(light) +
                         " without a claim to it");
  if (overlaps(mine->brought, paths))
    return internalError("technique " + std::string(technique) + " brings " + names(mine->brought & paths) + ofLight(light) + " twice");
  mine->brought = mine->brought | paths;
  return {};
}

PathSet Cover::claimed(int light) const {
  PathSet all = PathSet::None;
  for (const Claim& c : lights_[size_t(light)]) all = all | c.claimed;
  return all;
}

PathSet Cover::claimedBy(int light, const char* technique) const {
  const Claim* mine = const_cast<Cover*>(this)->find(light, technique);
  return mine ? mine->claimed : PathSet::None;
}

Status Cover::complete() const {
  for (size_t l = 0; l < lights_.size(); ++l)
    for (const Claim& c : lights_[l])
      if (c.claimed != c.brought)
        return internalError("technique " + std::string(c.technique) + " claimed " + names(c.claimed - c.brought) + ofLight(int(l)) + " and did not bring it");
  return {};
}

}  // namespace technique
}  // namespace gobo
