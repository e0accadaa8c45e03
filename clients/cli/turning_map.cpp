// SPDX-License-Identifier: Apache-2.0
#include "turning_map.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <vector>

#include "base/animated_png.h"
#include "base/image_io.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {

namespace {

constexpr int kTurns = 24;
constexpr uint32_t kShownMs = 80;

std::string planText(int degrees, const v1::RenderReply& reply) {
  std::string text = strf("%3d degrees: %.1f ms, %llu rays", degrees, reply.total_ms(), static_cast<unsigned long long>(reply.rays()));
  const char* before = "; ran";
  for (const auto& n : reply.plan())
    if (n.state() == v1::NodeReport::RUN) {
      text += strf("%s %s (%.1f ms)", before, n.node().c_str(), n.ms());
      before = ",";
    }
  return text + "\n";
}

}  // namespace

Status turnMap(Session& session, const v1::SceneInfo& info, v1::RenderRequest request, const std::string& folder) {
  request.clear_certificate();
  request.clear_lights();
  request.set_height(320 * request.height() / std::max(request.width(), 1u));
  request.set_width(320);
  // The map is seen where surfaces are not: at the view samples, or pixels of an outline would have both or neither.
  for (const char* field : {"environment.transfer.bounces=3", "environment.transfer.points=20000", "environment.transfer.samples=256", "view_samples=2",
                            "integrator.at_view_samples=true", "halt.spp=2", "encoding.format=PNG", "scheduling.ladder=false"})
    GOBO_TRY(setPath(request, field));
  for (const auto& light : info.lights())
    if (light.name() != "environment") GOBO_TRY(setPath(request, "lights." + light.name() + ".enabled=false"));
  std::vector<std::string> pictures;
  std::vector<double> turns;
  std::string plans, renderId;
  double first = 0;
  for (int i = 0; i < kTurns; ++i) {
    const int degrees = i * 360 / kTurns;
    Answer answer;
    if (i == 0) {
      GOBO_ASSIGN(answer, renderOnce(session, request));
      first = answer.reply.total_ms();
    } else {
      v1::RelightRequest relight;
      relight.set_render_id(renderId);
      relight.add_mask("environment.rotation_deg");
      GOBO_TRY(setPath(*relight.mutable_patch(), "environment.rotation_deg=" + std::to_string(degrees)));
      Session::Call call(session);
      auto reader = session.render().Relight(&call.context, relight);
      GOBO_ASSIGN(answer, receive(session, call, *reader, {}));
      turns.push_back(answer.reply.total_ms());
    }
    renderId = answer.reply.render_id();
    plans += planText(degrees, answer.reply);
    if (!answer.images.empty()) pictures.push_back(std::move(answer.images[0]));
  }
  std::nth_element(turns.begin(), turns.begin() + long(turns.size() / 2), turns.end());
  std::printf("the map turned about the scene by precomputed transfer, %u x %u: first picture %.0f ms, then %.0f ms a turn (median of %zu), PNG included\n",
              request.width(), request.height(), first, turns[turns.size() / 2], turns.size());
  if (folder.empty()) return {};
  const std::filesystem::path base(folder);
  GOBO_ASSIGN(const std::vector<uint8_t> animation, animatedPng(pictures, kShownMs));
  GOBO_TRY(writeFileAtomic((base / "turning-map.png").string(), animation.data(), animation.size()));
  GOBO_TRY(writeFileAtomic((base / "turning-map.txt").string(), plans.data(), plans.size()));
  return {};
}

}  // namespace gobo::cli
