// SPDX-License-Identifier: Apache-2.0
// Chains of filters in a request: which filter it is, on what it may act, whether it changes anything, and the nodes of those that act on one term. A new
// filter is a file with its node, a message in the schema and a line in registry.cpp; nobody else knows it by name.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "filters/picture/picture_node.h"
#include "gobo/v1/render.pb.h"
#include "terms/graph.h"

namespace gobo {
inline namespace filters {

struct PictureFilterEntry {
  v1::PictureFilter::FilterCase key;
  const char* name;
  bool onShares;  ///< may act on visibility, which has one channel or three
  /// Why it would change nothing; null: it may change something.
  const char* (*identity)(const v1::PictureFilter& filter);
  NodePtr (*make)(PictureShape shape, const v1::PictureFilter& filter);
};
const std::vector<PictureFilterEntry>& pictureFilters();
/// Null: the message names no filter.
const PictureFilterEntry* findPictureFilter(v1::PictureFilter::FilterCase key);

/// A filter of request.filters that changes something.
struct ChainLink {
  int index = 0;  ///< in request.filters
  const PictureFilterEntry* entry = nullptr;
  const v1::PictureFilter* filter = nullptr;  ///< of the request
  std::string place() const { return "request.filters[" + std::to_string(index) + "]"; }
};
using Chain = std::vector<ChainLink>;

/// "beauty" where a filter names none.
std::string filteredTerm(const v1::PictureFilter& filter);
/// Those of a term, in their order, up to request.filters[last]; what changes nothing is left out.
Chain chainOf(const v1::RenderRequest& request, std::string_view term, int last = std::numeric_limits<int>::max());
/// Whether a request has any filter that changes something.
bool anyFilter(const v1::RenderRequest& request);
/// Says in the plan which filters are left out, and why.
void pruneIdentities(Graph& graph, const v1::RenderRequest& request);

/// A filter that is not linear: of the light of a part of what it filters it says nothing. Null: there is none.
const ChainLink* findNonlinear(const Chain& chain, const PictureShape& shape);

/// The chain behind node `in`, whose term has the plane of `shape`; `in` itself for an empty chain.
NodeId addChain(Graph& graph, NodeId in, const Chain& chain, const PictureShape& shape, const std::string& term);

/// The same filters in a picture of another size, `scale` times as wide: what they count in pixels is as large in it.
void scaleFilters(v1::RenderRequest& request, double scale);

}  // namespace filters
}  // namespace gobo
