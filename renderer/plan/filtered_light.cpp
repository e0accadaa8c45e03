// SPDX-License-Identifier: Apache-2.0
#include "plan/filtered_light.h"

#include <algorithm>

#include "filters/shadow_technique.h"
#include "plan/denoised.h"
#include "plan/outputs.h"
#include "techniques/direct_visibility/visibility.h"

namespace gobo {
inline namespace plan {

namespace {

constexpr int kMostFilters = 64;
constexpr const char* kVisibility = "visibility";

/// A term of light that the request filters, but for the beauty as a whole.
struct FilteredTerm {
  std::string name;
  PathSet paths;
  Chain chain;
};

std::vector<FilteredTerm> filteredTerms(const v1::RenderRequest& request, std::string_view staged = {}, int last = std::numeric_limits<int>::max()) {
  std::vector<FilteredTerm> terms;
  for (const v1::PictureFilter& f : request.filters()) {
    const std::string name = filteredTerm(f);
    const OutputInfo* info = findOutput(name);
    if (!info || !sumsLight(*info) || name == "beauty") continue;
    if (std::any_of(terms.begin(), terms.end(), [&](const FilteredTerm& t) { return t.name == name; })) continue;
    if (Chain chain = name == staged ? chainOf(request, name, last) : chainOf(request, name); !chain.empty())
      terms.push_back({name, info->shows, std::move(chain)});
  }
  return terms;
}

std::string termList() {
  std::string list;
  for (const OutputInfo& o : outputTable())
    if (sumsLight(o)) list += std::string(o.name) + ", ";
  return list + "visibility:LIGHT";
}

Status refused(const ChainLink& link, const std::string& term, const std::string& why) {
  return invalidArgument(link.place() + ".term = '" + term + "': " + link.entry->name + " " + why, link.place() + ".term");
}

/// Of a light's visibility.
Status checkVisibilityTerm(PlanContext& c, const std::string& name, const std::string& place, const std::string& text) {
  const int l = c.scene()->findLight(name);
  if (l < 0) return invalidArgument(text + ": no light '" + name + "' in the scene", place);
  const auto without = [&](const std::string& why) { return invalidArgument(text + ": " + why, place); };
  if (c.scene()->lights[size_t(l)].shape.kind == LightKind::Environment) return without("an environment has no single visibility");
  if (c.view().camera.hasLens()) return without("visibility is what one point sees, and request.camera has a lens");
  if (!findShadowTechnique(shadowTechniqueOf(c, l, c.scene(), name).technique_case()))
    return without("the light is path traced: there is no visibility that light is made of; give it a shadow technique (lights." + name +
                   ".shadow), or filter 'direct'");
  return {};
}

}  // namespace

PictureShape pictureShape(int width, int height) { return {{width, height, 1}, Domain::Pixel, "rgb", 3, false}; }

Status checkFilters(PlanContext& c) {
  const v1::RenderRequest& request = c.request();
  if (request.filters_size() > kMostFilters)
    return invalidArgument("request.filters: " + std::to_string(request.filters_size()) + " filters, at most " + std::to_string(kMostFilters),
                           "request.filters");
  std::vector<std::pair<std::string, PathSet>> before;
  for (int k = 0; k < request.filters_size(); ++k) {
    const v1::PictureFilter& f = request.filters(k);
    const std::string where = "request.filters[" + std::to_string(k) + "]", place = where + ".term", term = filteredTerm(f), text = place + " = '" + term + "'";
    const PictureFilterEntry* entry = findPictureFilter(f.filter_case());
    if (!entry) {
      std::string list;
      for (const PictureFilterEntry& e : pictureFilters()) list += (list.empty() ? "" : ", ") + std::string(e.name);
      return invalidArgument(where + ": names no filter (has: " + list + ")", where);
    }
    const OutputInfo* info = findOutput(term);
    if (!info) return invalidArgument(text + ": there is no such term (has: " + termList() + ")", place);
    if (info->name == std::string_view(kVisibility)) {
      GOBO_TRY(checkVisibilityTerm(c, std::string(outputLight(term)), place, text));
      if (!entry->onShares) return invalidArgument(text + ": " + entry->name + " is of light, not of visibility", place);
      continue;
    }
    if (!sumsLight(*info)) return invalidArgument(text + ": filters act on light and on visibility (" + termList() + ")", place);
    if (term == "beauty") continue;
    for (const auto& [other, paths] : before)
      if (other != term && overlaps(paths, info->shows))
        return invalidArgument(text + ": has light in common with '" + other + "', which a filter before it names: one of both, or what is apart", place);
    before.emplace_back(term, info->shows);
  }
  return {};
}

FilterDistinctions filterDistinctions(const v1::RenderRequest& request) {
  FilterDistinctions apart;
  for (const FilteredTerm& t : filteredTerms(request)) {
    apart.classes = apart.classes || needsClasses(*findOutput(t.name));
    apart.lobes = apart.lobes || needsLobes(*findOutput(t.name));
  }
  return apart;
}

Status checkDenoisedSlices(const PlanContext& c, PathSet shows) {
  for (const FilteredTerm& t : filteredTerms(c.request()))
    if (overlaps(shows, t.paths))
      return refused(
          t.chain[0], t.name,
          "is of a part of the light, and the moments of a shutter (request.camera.shutter_s) are denoised as one picture: filter the beauty, or leave out "
          "denoise");
  return {};
}

Result<NodeId> planFilteredLight(PlanContext& c, std::span<const Contribution> shown, const ShownLight& what) {
  const auto plain = [&](std::span<const Contribution> light, const std::string& label) -> Result<NodeId> {
    if (c.request().has_denoise()) return planDenoised(c, light, label);
    return planSum(c, light, label);
  };
  const PictureShape shape = pictureShape(c.view().width, c.view().height);
  std::vector<Contribution> rest(shown.begin(), shown.end()), filtered;
  for (const FilteredTerm& t : filteredTerms(c.request(), what.output, what.last)) {
    if (!overlaps(what.shows, t.paths)) continue;
    const ChainLink* nonlinear = findNonlinear(t.chain, shape);
    if (nonlinear && (what.ofOneLight || !contains(what.shows, t.paths)))
      return refused(*nonlinear, t.name, "is not linear: there is no part of what it makes that request.outputs '" + what.output + "' could show");
    if (nonlinear && c.share().of > 1)
      return refused(*nonlinear, t.name,
                     "is not linear, and the light of a shutter's picture (request.camera.shutter_s) is the mean of its moments: filter the beauty");
    std::vector<Contribution> light, others;
    for (Contribution& k : rest) {
      if (cuts(t.paths, k.paths)) return internalError("a plane of the beauty holds more than '" + t.name + "'", c.graph().at(k.node).label);
      (overlaps(t.paths, k.paths) ? light : others).push_back(std::move(k));
    }
    rest = std::move(others);
    if (light.empty()) continue;
    PathSet paths = PathSet::None;
    for (const Contribution& k : light) paths = paths | k.paths;
    const std::string label = what.output == t.name ? t.name : what.output + " " + t.name;
    GOBO_ASSIGN(const NodeId sum, plain(light, label));
    Contribution part;
    part.node = addChain(c.graph(), sum, t.chain, shape, what.ofOneLight ? label : t.name);
    part.plane = shape.plane;
    part.paths = paths;
    filtered.push_back(std::move(part));
  }
  if (filtered.empty()) return plain(rest, what.output);
  if (rest.empty() && filtered.size() == 1) return filtered[0].node;
  if (c.request().has_denoise() && !rest.empty()) {
    Contribution without;
    GOBO_ASSIGN(without.node, planDenoised(c, rest, what.output + " not filtered"));
    without.plane = shape.plane;
    rest = {without};
  }
  rest.insert(rest.end(), filtered.begin(), filtered.end());
  return planSum(c, rest, what.output);
}

}  // namespace plan
}  // namespace gobo
