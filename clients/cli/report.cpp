// SPDX-License-Identifier: Apache-2.0
#include "report.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <tuple>

#include "server/log.h"

namespace gobo::cli {

std::string jsonNumber(double v) { return std::isfinite(v) ? strf("%.9g", v) : "null"; }

std::string bytesText(uint64_t bytes) {
  if (bytes < 1024) return std::to_string(bytes) + " B";
  double v = double(bytes);
  const char* units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
  int u = 0;
  while (v >= 1024 && u < 4) v /= 1024, ++u;
  return strf("%.1f %s", v, units[u]);
}

void printTable(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows, const std::vector<bool>& right) {
  std::vector<size_t> width(head.size());
  for (size_t c = 0; c < head.size(); ++c) {
    width[c] = head[c].size();
    for (const auto& row : rows) width[c] = std::max(width[c], row[c].size());
  }
  const auto line = [&](const std::vector<std::string>& row) {
    std::string text;
    for (size_t c = 0; c < row.size(); ++c) {
      const std::string pad(width[c] - row[c].size(), ' ');
      text += (c ? "  " : "") + (right[c] ? pad + row[c] : c + 1 < row.size() ? row[c] + pad : row[c]);
    }
    std::printf("%s\n", text.c_str());
  };
  line(head);
  for (const auto& row : rows) line(row);
}

namespace {

using Nodes = google::protobuf::RepeatedPtrField<v1::NodeReport>;

/// "shadow_slopes:key:mean" is of the kind "shadow_slopes::mean": the name in the middle says which.
std::string kindOf(const std::string& node) {
  const size_t colon = node.find(':');
  if (colon == std::string::npos) return node;
  const size_t second = node.find(':', colon + 1);
  return node.substr(0, colon + 1) + (second == std::string::npos ? "" : node.substr(second));
}

/// Rows of one kind that share state and device become one in the place of the first: sums of time, rays and bytes.
Nodes folded(const Nodes& plan) {
  std::map<std::tuple<std::string, int, std::string>, std::vector<const v1::NodeReport*>> kinds;
  const auto key = [](const v1::NodeReport& n) { return std::tuple(kindOf(n.node()), int(n.state()), n.device()); };
  for (const v1::NodeReport& n : plan) kinds[key(n)].push_back(&n);
  Nodes out;
  for (const v1::NodeReport& n : plan) {
    const std::vector<const v1::NodeReport*>& all = kinds[key(n)];
    if (all.front() != &n) continue;
    v1::NodeReport& row = *out.Add();
    row = n;
    if (all.size() == 1) continue;
    std::string kind = kindOf(n.node());
    if (kind.back() == ':') kind.pop_back();
    row.set_node(kind);
    row.set_count(0);
    row.set_ms(0), row.set_rays(0), row.set_bytes(0);
    for (const v1::NodeReport* other : all) {
      row.set_ms(row.ms() + other->ms());
      row.set_rays(row.rays() + other->rays());
      row.set_bytes(row.bytes() + other->bytes());
      row.set_samples(std::max(row.samples(), other->samples()));
      row.set_count(row.count() + std::max(1u, other->count()));
      if (other->reason() != n.reason()) row.set_reason("various");
      row.set_approximate(row.approximate() || other->approximate());
    }
  }
  return out;
}

void printNodes(const Nodes& all, bool everyRow) {
  static const char* const states[] = {"?", "run", "reused", "pruned", "not needed"};
  std::vector<std::vector<std::string>> rows;
  const Nodes plan = everyRow ? all : folded(all);
  for (const v1::NodeReport& n : plan) {
    const int state = int(n.state());
    rows.push_back({escaped(n.node()) + (n.count() > 1 ? strf(" x%u", n.count()) : ""), states[state >= 0 && state < 5 ? state : 0], strf("%.1f", n.ms()),
                    std::to_string(n.rays()), bytesText(n.bytes()), n.samples() ? std::to_string(n.samples()) : "-", escaped(n.device()),
                    escaped(n.reason()) + (n.approximate() ? " [approximate]" : "")});
  }
  if (!rows.empty())
    printTable({"node", "state", "ms", "rays", "bytes", "samples", "device", "reason"}, rows, {false, false, true, true, true, true, false, false});
  if (plan.size() < all.size()) std::printf("%d rows are shown as %d; --plan-all shows each\n", all.size(), plan.size());
}

}  // namespace

void printPlan(const v1::PlanReply& reply, bool everyRow) {
  printNodes(reply.plan(), everyRow);
  std::printf("expected: %.1f ms, %llu rays; at most %s held at once\n", reply.ms(), static_cast<unsigned long long>(reply.rays()),
              bytesText(reply.pinned_bytes()).c_str());
  std::printf("expected time: %s\n", reply.time_from().empty() ? "that of the documented machine; nothing has run here yet"
                                                               : ("as measured on " + escaped(reply.time_from())).c_str());
  if (reply.error_from().empty()) std::printf("expected error: not known; this daemon has shown no snapshots and certified no picture of the scene\n");
  else
    std::printf("expected error:%s%s; from %s\n", reply.rmse() > 0 ? strf(" RMSE %.3g", reply.rmse()).c_str() : "",
                reply.standard_error() > 0 ? strf("%s noise %.3g", reply.rmse() > 0 ? "," : "", reply.standard_error()).c_str() : "",
                escaped(reply.error_from()).c_str());
  if (reply.decides_while_planning()) std::printf("some node decides what follows when it has run: this is the largest plan that it may choose\n");
  for (const std::string& text : reply.warnings()) std::printf("warning: %s\n", escaped(text).c_str());
  for (const std::string& name : reply.path_classes_missing()) std::printf("missing light paths: %s\n", escaped(name).c_str());
}

void printReply(const v1::RenderReply& reply, const std::vector<std::string>& files, bool everyRow) {
  printNodes(reply.plan(), everyRow);
  std::printf("total %.1f ms (queued %.1f ms), %llu rays, peak %s, render %s, request %s, build %s\n", reply.total_ms(), reply.queue_ms(),
              static_cast<unsigned long long>(reply.rays()), bytesText(reply.peak_bytes()).c_str(), escaped(reply.render_id()).c_str(),
              escaped(reply.request_hash()).c_str(), escaped(reply.build()).c_str());
  if (reply.has_certificate()) {
    const v1::Certificate& c = reply.certificate();
    std::printf(
        "certificate: RMSE %.4g (95 %%: %.4g..%.4g; at most %.4g without the worst %.2g of the picture), relMSE %.4g (%.4g..%.4g); %u pixels (%u certain) at "
        "%u spp, %llu rays, %.1f ms\n",
        c.rmse(), c.rmse_low(), c.rmse_high(), c.rmse_high_trimmed(), c.unseen_area(), c.rel_mse(), c.rel_mse_low(), c.rel_mse_high(), c.pixels(),
        c.certain_pixels(), c.spp(), static_cast<unsigned long long>(c.rays()), c.ms());
    for (const std::string& name : c.not_covered()) std::printf("  not covered by the reference: %s\n", escaped(name).c_str());
  }
  for (const std::string& text : reply.warnings()) std::printf("warning: %s\n", escaped(text).c_str());
  for (const std::string& name : reply.path_classes_missing()) std::printf("missing light paths: %s\n", escaped(name).c_str());
  for (size_t i = 0; i < files.size(); ++i) {
    const v1::ImageDescriptor& d = reply.images(int(i));
    std::printf("wrote %s (%s, %u x %u, %d channels, %s)\n", files[i].c_str(), escaped(d.output()).c_str(), d.width(), d.height(), d.channels_size(),
                bytesText(d.bytes()).c_str());
  }
}

namespace {

std::string vectorText(const v1::Vector3& v) { return strf("%.4g %.4g %.4g", v.x(), v.y(), v.z()); }

}  // namespace

void printScene(const v1::SceneInfo& info) {
  std::printf("%s  (%s)\n", escaped(info.id()).c_str(), escaped(info.source()).c_str());
  std::printf("  hash %s, %llu triangles, %u instances, %u materials, %u textures, %s, loaded in %.1f ms\n", info.hash().c_str(),
              static_cast<unsigned long long>(info.triangles()), info.instances(), info.materials(), info.textures(), bytesText(info.bytes()).c_str(),
              info.load_ms());
  std::printf("  bounds %s .. %s m\n", vectorText(info.bounds_min()).c_str(), vectorText(info.bounds_max()).c_str());
  if (info.has_origin())
    std::printf("  origin %.15g %.15g %.15g m in the file's coordinates; all others here are relative to it\n", info.origin().x(), info.origin().y(),
                info.origin().z());
  const auto names = [](const char* title, const auto& list) {
    if (list.empty()) return;
    std::printf("  %s:", title);
    for (const std::string& name : list) std::printf(" %s", escaped(name).c_str());
    std::printf("\n");
  };
  names("cameras", info.cameras());
  for (const v1::AnimationInfo& a : info.animations()) std::printf("  animation %s: %.4g s\n", escaped(a.name()).c_str(), a.duration_s());
  names("variants", info.variants());
  for (const v1::LightInfo& light : info.lights())
    std::printf("  light %s: %s, power %s, at %s, towards %s\n", escaped(light.name()).c_str(), escaped(light.kind()).c_str(),
                vectorText(light.power()).c_str(), vectorText(light.position()).c_str(), vectorText(light.direction()).c_str());
  names("materials", info.material_names());
  names("instances", info.instance_names());
  for (const v1::FacetInfo& facet : info.facets()) std::printf("  facet %s %s\n", facet.facet().c_str(), facet.hash().c_str());
  for (const std::string& text : info.warnings()) std::printf("  warning: %s\n", escaped(text).c_str());
}

void printStatus(const v1::StatusReply& s) {
  std::printf("gobod %s, pid %d, up %.0f s, %u threads%s\n", escaped(s.build()).c_str(), s.pid(), s.uptime_s(), s.threads(), s.draining() ? ", draining" : "");
  std::printf("renders: %u running on %u workers, %u queued, %llu finished; %llu scenes, %u being loaded\n", s.running(), s.workers(), s.queued(),
              static_cast<unsigned long long>(s.renders()), static_cast<unsigned long long>(s.scenes()), s.loads());
  std::printf("store: %s of %s in %llu terms, disk %s; resident %s\n", bytesText(s.store_bytes()).c_str(), bytesText(s.store_limit()).c_str(),
              static_cast<unsigned long long>(s.store_terms()), bytesText(s.disk_bytes()).c_str(), bytesText(s.rss_bytes()).c_str());
  std::printf("pinned by renders: %s; %u open files\n", bytesText(s.pinned_bytes()).c_str(), s.open_fds());
  uint64_t held = 0;
  std::string holders;
  for (const v1::MemoryHolder& h : s.memory()) {
    held += h.bytes();
    if (h.bytes() > 0) holders += (holders.empty() ? "" : ", ") + escaped(h.name()) + " " + bytesText(h.bytes());
  }
  std::printf("memory: %s of %s%s%s\n", bytesText(held).c_str(), bytesText(s.memory_limit()).c_str(), holders.empty() ? "" : ": ", holders.c_str());
  std::string layers;
  for (const std::string& layer : s.sandbox()) layers += (layers.empty() ? "" : ", ") + escaped(layer);
  std::printf("sandbox of the file reader: %s\n", layers.empty() ? "none" : layers.c_str());
  for (const std::string& layer : s.sandbox_missing()) std::printf("  missing: %s\n", escaped(layer).c_str());
  for (const std::string& device : s.devices()) std::printf("device: %s\n", escaped(device).c_str());
}

bool onTerminal() { return ::isatty(STDERR_FILENO) == 1; }

ProgressBar::ProgressBar(bool enabled, bool plain) : enabled_(enabled && (plain || onTerminal())), plain_(plain && !onTerminal()) {}
ProgressBar::~ProgressBar() { clear(); }

std::string restText(double ms) {
  if (!(ms > 0) || !std::isfinite(ms)) return {};
  const double s = ms / 1000;
  if (s < 9.95) return strf("  %.1f s left", s);
  if (s < 100) return strf("  %.0f s left", s);
  const auto minutes = static_cast<unsigned long long>(s / 60);
  if (s < 6000) return strf("  %llu:%02d min left", minutes, int(s) % 60);
  return strf("  %llu:%02llu h left", minutes / 60, minutes % 60);
}

std::string progressText(const v1::Progress& p) {
  if (p.queued()) {
    const std::string place = p.position() == 0 ? "next" : strf("%u before it", p.position());
    return strf("queued, %s  %.1f s", place.c_str(), p.elapsed_ms() / 1000) + restText(p.eta_ms());
  }
  return strf("%s  %u spp  %.1f s", escaped(p.stage()).substr(0, 40).c_str(), p.spp(), p.elapsed_ms() / 1000) + restText(p.eta_ms());
}

void ProgressBar::show(double fraction, const std::string& text) {
  if (!enabled_) return;
  fraction = fraction_ = std::isfinite(fraction) ? std::clamp(fraction, 0.0, 1.0) : 0.0;
  if (!plain_) {
    winsize window{};
    const size_t columns = ::ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 0 ? window.ws_col : 80;
    const size_t full = size_t(fraction * 30);
    std::string line = "[" + std::string(full, '#') + std::string(30 - full, '.') + strf("] %3.0f %%  ", fraction * 100) + text;
    if (line.size() >= columns) line.resize(columns - 1);  // a wrapped line could not be taken back
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    drawn_ = true;
    return;
  }
  const int tenth = int(fraction * 10);
  if (tenth == lastTenth_) return;
  lastTenth_ = tenth;
  std::fprintf(stderr, "%3.0f %%  %s\n", fraction * 100, text.c_str());
}

void ProgressBar::wait(const std::string& text) {
  if (!plain_) return show(fraction_, text);
  if (!enabled_ || text == waited_) return;
  waited_ = text;
  std::fprintf(stderr, "%s\n", text.c_str());
}

void ProgressBar::clear() {
  if (drawn_) std::fprintf(stderr, "\r\033[K");
  drawn_ = false;
}

}  // namespace gobo::cli
