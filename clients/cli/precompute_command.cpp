// SPDX-License-Identifier: Apache-2.0
// gobo precompute: a tiny picture under a map of one value asks for the transfer of the whole scene, which knows nothing of picture or map
// (docs/environment.md). The same calls as `gobo render`: what they may take, and who may make them, is said once.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <random>

#include <nlohmann/json.hpp>

#include "commands.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {

namespace {

using Plan = google::protobuf::RepeatedPtrField<v1::NodeReport>;

constexpr const char *kPoints = "transfer points", *kDirect = "transfer:direct", *kBounce = "transfer:bounce ", *kAlbedo = "transfer:albedo";

bool startsWith(const std::string& text, const std::string& begin) { return text.compare(0, begin.size(), begin) == 0; }

/// What is computed for the scene alone.
bool ofTransfer(const v1::NodeReport& n) {
  return n.state() != v1::NodeReport::PRUNED && (n.node() == kPoints || n.node() == kDirect || n.node() == kAlbedo || startsWith(n.node(), kBounce));
}

Result<v1::RenderRequest> requestOf(Session& session, const PrecomputeCommand& c) {
  GOBO_ASSIGN(v1::RenderRequest request, makeRequest(session, c.request, c.scene));
  v1::EnvironmentSettings& sky = *request.mutable_environment();
  v1::EnvironmentSettings::Transfer& transfer = *sky.mutable_transfer();
  if (c.bands >= 0) transfer.set_bands(uint32_t(c.bands));
  if (c.bounces >= 0) transfer.set_bounces(uint32_t(c.bounces));
  if (c.samples >= 0) transfer.set_samples(uint32_t(c.samples));
  if (c.points >= 0) transfer.set_points(uint32_t(c.points));
  transfer.set_lights(0);
  transfer.set_gloss(v1::EnvironmentSettings::Transfer::TRACED);  // of no part in transfer
  if (transfer.has_bounces() && transfer.bounces() > 8 && !request.integrator().has_max_bounces())
    request.mutable_integrator()->set_max_bounces(transfer.bounces());
  request.clear_outputs();
  request.add_outputs("direct_diffuse");
  if (!transfer.has_bounces() || transfer.bounces() > 0) request.add_outputs("indirect_diffuse");
  request.mutable_halt()->set_spp(1);
  request.set_view_samples(1);
  request.mutable_encoding()->set_format(v1::Encoding::RAW_HALF);
  request.mutable_scheduling()->set_ladder(false);
  return request;
}

/// Makes it a picture that nobody has rendered: one that is kept would be there without what it was made of.
void makeNew(v1::RenderRequest& request) {
  static std::mt19937_64 random{std::random_device{}()};
  std::uniform_int_distribution<uint32_t> side(8, 71);
  std::uniform_real_distribution<double> value(1.0, 2.0);
  request.set_width(side(random));
  request.set_height(side(random));
  v1::EnvironmentSettings& sky = *request.mutable_environment();
  sky.clear_path(), sky.clear_digest(), sky.clear_sky();
  const double v = value(random);
  sky.mutable_constant()->set_x(v), sky.mutable_constant()->set_y(v), sky.mutable_constant()->set_z(v);
}

Result<v1::PlanReply> planOf(Session& session, const v1::RenderRequest& request) {
  v1::PlanReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.render().Plan(&call.context, request, &reply)));
  return reply;
}

/// The plan says what its pictures are interpolated between.
uint64_t pointsOf(const Plan& plan) {
  for (const v1::NodeReport& n : plan) {
    const size_t at = n.reason().find("interpolated between ");
    if (at != std::string::npos) return std::strtoull(n.reason().c_str() + at + 21, nullptr, 10);
  }
  return 0;
}

/// How much of the planned work is done, from progress: the nodes of direct light say how far they have come together, and so do bounces.
class Work {
 public:
  explicit Work(const Plan& plan) {
    for (const v1::NodeReport& n : plan) {
      const double ms = n.state() == v1::NodeReport::RUN ? n.ms() : 0.0;
      if (n.node() == kDirect) direct_.push_back(ms);
      else if (startsWith(n.node(), kBounce)) bounces_.push_back(ms);
    }
  }
  /// False: a stage that says nothing of it.
  bool take(const v1::Progress& p) {
    const bool bounce = startsWith(p.stage(), kBounce);
    if (!bounce && p.stage() != kDirect) return false;
    double all = 0, done = 0;
    for (const auto* part : {&direct_, &bounces_})
      for (size_t i = 0; i < part->size(); ++i) {
        all += (*part)[i];
        const double at = p.fraction() * double(part->size()) - double(i);
        if (part == &direct_ ? bounce || at >= 1 : bounce && at >= 1) done += (*part)[i];
        else if ((part == &bounces_) == bounce) done += (*part)[i] * std::clamp(at, 0.0, 1.0);
      }
    if (all > 0) share_ = std::max(share_, std::min(done / all, 1.0));
    const size_t of = bounce ? bounces_.size() : direct_.size();
    const size_t which = std::min(size_t(p.fraction() * double(of)) + 1, std::max<size_t>(of, 1));
    text_ = (bounce ? "bounce " : "direct light ") + std::to_string(which) + " of " + std::to_string(of);
    if (begun_ < 0) begun_ = p.elapsed_ms();
    const double ran = p.elapsed_ms() - begun_;
    char time[32];
    std::snprintf(time, sizeof time, "  %.1f s", p.elapsed_ms() / 1000);
    text_ += time + (share_ > 0.02 && ran > 500 ? restText(ran * (1 - share_) / share_) : std::string());
    return true;
  }
  double share() const { return share_; }
  const std::string& text() const { return text_; }

 private:
  std::vector<double> direct_, bounces_;
  double share_ = 0, begun_ = -1;
  std::string text_;
};

struct Kept {
  uint64_t points = 0, bytes = 0, terms = 0, made = 0, rays = 0, lost = 0;
  double ms = 0;
};

Kept keptOf(const v1::PlanReply& planned, const v1::RenderReply& reply, const v1::PlanReply& after) {
  Kept k;
  for (const v1::NodeReport& n : planned.plan()) {
    if (!ofTransfer(n)) continue;
    ++k.terms;
    k.bytes += n.bytes();
    if (n.node() == kPoints) k.points = pointsOf(planned.plan());
  }
  for (const v1::NodeReport& n : reply.plan()) {
    if (!ofTransfer(n) || n.state() != v1::NodeReport::RUN) continue;
    ++k.made;
    k.rays += n.rays();
    k.ms += n.ms();
  }
  for (const v1::NodeReport& n : after.plan()) k.lost += ofTransfer(n) && n.state() == v1::NodeReport::RUN;
  return k;
}

void print(const Kept& k, const v1::RenderReply& reply, const PrecomputeCommand& c) {
  const v1::EnvironmentSettings::Transfer& t = reply.resolved().environment().transfer();
  const std::string& scene = reply.resolved().scene();
  const double perSecond = k.ms > 0 ? double(k.rays) / (k.ms * 1e-3) : 0;
  if (c.json) {
    nlohmann::ordered_json out = {{"scene", scene},
                                  {"points", k.points},
                                  {"bytes", k.bytes},
                                  {"terms", k.terms},
                                  {"termsMade", k.made},
                                  {"termsLost", k.lost},
                                  {"bands", t.bands()},
                                  {"samples", t.samples()},
                                  {"bounces", t.bounces()},
                                  {"ms", k.ms},
                                  {"totalMs", reply.total_ms()},
                                  {"rays", k.rays},
                                  {"raysPerSecond", perSecond}};
    for (const std::string& w : reply.warnings()) out["warnings"].push_back(w);
    std::printf("%s\n", out.dump(1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    return;
  }
  if (!c.quiet) {
    std::printf("%s: transfer of %llu points in %u bands, %u directions and %u bounces: %s in %llu terms\n", escaped(scene).c_str(),
                static_cast<unsigned long long>(k.points), t.bands(), t.samples(), t.bounces(), bytesText(k.bytes).c_str(),
                static_cast<unsigned long long>(k.terms));
    if (k.made == 0) std::printf("all of it was there: nothing was traced\n");
    else
      std::printf("%llu of them were made, in %.1f s: %llu rays, %.2f million a second\n", static_cast<unsigned long long>(k.made), k.ms * 1e-3,
                  static_cast<unsigned long long>(k.rays), perSecond * 1e-6);
  }
  for (const std::string& w : reply.warnings()) std::fprintf(stderr, "warning: %s\n", escaped(w).c_str());
  if (k.lost > 0)
    std::fprintf(stderr, "warning: %llu of them are gone again: the server's term store (engine.store_bytes) is too small for them\n",
                 static_cast<unsigned long long>(k.lost));
}

Status precompute(Session& session, const PrecomputeCommand& c) {
  GOBO_ASSIGN(v1::RenderRequest request, requestOf(session, c));
  makeNew(request);
  GOBO_ASSIGN(const v1::PlanReply planned, planOf(session, request));
  if (std::none_of(planned.plan().begin(), planned.plan().end(), ofTransfer))
    return Status(Code::FailedPrecondition, "nothing in '" + request.scene() + "' receives light: it has no surface whose transfer could be computed");
  Work work(planned.plan());
  ProgressBar bar(!c.quiet && (c.progressive || !c.json), c.progressive);
  StreamHooks hooks;
  if (!c.quiet && (c.progressive || onTerminal()))
    hooks.progress = [&](const v1::Progress& p) {
      if (p.queued()) return bar.wait(progressText(p));
      if (work.take(p)) bar.show(work.share(), work.text());
    };
  GOBO_ASSIGN(const Answer answer, renderOnce(session, request, hooks));
  bar.clear();
  makeNew(request);
  GOBO_ASSIGN(const v1::PlanReply after, planOf(session, request));
  print(keptOf(planned, answer.reply, after), answer.reply, c);
  return {};
}

}  // namespace

int runPrecompute(const SessionOptions& options, const PrecomputeCommand& command) {
  if (options.local && options.cache.empty()) return complain(invalidArgument("precompute --local: nothing is kept without --cache FOLDER"));
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = precompute(**session, command);
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
