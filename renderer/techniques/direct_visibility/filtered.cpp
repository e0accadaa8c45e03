// SPDX-License-Identifier: Apache-2.0
#include "techniques/direct_visibility/filtered.h"

#include "filters/picture/chain.h"

namespace gobo {
inline namespace techniques {

NodeId planFilteredVisibility(PlanContext& c, NodeId v, const std::string& light) {
  const std::string term = "visibility:" + light;
  const Chain chain = chainOf(c.request(), term);
  if (chain.empty()) return v;
  const TermShape& of = c.graph().at(v).shape;
  const PlaneShape* plane = of.find("V");
  PictureShape shape{of.extent, of.domain, "V", plane ? plane->channels : 1, true};
  return addChain(c.graph(), v, chain, shape, term);
}

}  // namespace techniques
}  // namespace gobo
