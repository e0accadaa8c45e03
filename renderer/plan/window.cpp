// SPDX-License-Identifier: Apache-2.0
#include "plan/window.h"

#include <algorithm>

namespace gobo {
inline namespace plan {

std::vector<bool> nodesOfView(const Graph& graph, const Extent& view) {
  std::vector<bool> out(size_t(graph.size()), false);
  for (NodeId id = 0; id < graph.size(); ++id) {
    const GraphNode& n = graph.at(id);
    const bool pixels =
        (n.shape.domain == Domain::Pixel || n.shape.domain == Domain::ViewSample) && n.shape.extent.width == view.width && n.shape.extent.height == view.height;
    const bool reads = std::any_of(n.inputs.begin(), n.inputs.end(), [&](NodeId i) { return out[size_t(i)]; });
    out[size_t(id)] = pixels && (n.inputs.empty() || reads);
  }
  return out;
}

Result<PixelWindow> windowOf(const v1::RenderRequest& request) {
  if (!request.has_window()) return PixelWindow{};
  const v1::Window& w = request.window();
  const auto fits = [&](const char* axis, uint32_t from, uint32_t size, uint32_t whole) -> Status {
    if (size > 0 && from < whole && size <= whole - from) return {};
    return invalidArgument("request.window: " + std::to_string(size) + " pixels from " + std::to_string(from) + " do not lie within the picture's " + axis +
                               ", which is " + std::to_string(whole),
                           std::string("request.window.") + axis);
  };
  GOBO_TRY(fits("width", w.x(), w.width(), request.width()));
  GOBO_TRY(fits("height", w.y(), w.height(), request.height()));
  return PixelWindow{int(w.x()), int(w.y()), int(w.width()), int(w.height())};
}

Result<int> haloOf(const Graph& graph, std::span<const NodeId> outputs, const Extent& view) {
  const std::vector<bool> pixels = nodesOfView(graph, view);
  std::vector<int> need(size_t(graph.size()), -1);
  for (const NodeId id : outputs) need[size_t(id)] = 0;
  int most = 0;
  for (NodeId id = graph.size() - 1; id >= 0; --id) {  // readers come after what they read
    if (need[size_t(id)] < 0) continue;
    const GraphNode& n = graph.at(id);
    const NodeTraits traits = n.node->traits();
    for (const NodeId input : n.inputs) {
      int at = need[size_t(id)];
      if (pixels[size_t(input)]) {
        if (!traits.tileable || !pixels[size_t(id)])
          return invalidArgument("request.window: " + n.label + " reads a whole picture (" + n.node->type() + ")", "request.window");
        at += traits.halo;
      }
      need[size_t(input)] = std::max(need[size_t(input)], at);
    }
    if (pixels[size_t(id)]) most = std::max(most, need[size_t(id)]);
  }
  return most;
}

PixelWindow grown(const PixelWindow& w, int halo, int filmWidth, int filmHeight) {
  PixelWindow out;
  out.x = std::max(w.x - halo, 0);
  out.y = std::max(w.y - halo, 0);
  out.width = std::min(w.x + w.width + halo, filmWidth) - out.x;
  out.height = std::min(w.y + w.height + halo, filmHeight) - out.y;
  return out;
}

}  // namespace plan
}  // namespace gobo
