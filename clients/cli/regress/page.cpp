// SPDX-License-Identifier: Apache-2.0
#include "regress/page.h"

#include <algorithm>
#include <cmath>

#include "measure/change.h"
#include "server/log.h"

namespace gobo::cli {
namespace {

constexpr const char* kStyle = R"(
body{font:14px/1.45 system-ui,sans-serif;margin:2em auto;max-width:72em;padding:0 1em;background:#fafafa;color:#222}
table{border-collapse:collapse;width:100%}td,th{padding:.25em .6em;text-align:right;border-bottom:1px solid #ddd;white-space:nowrap}
td:first-child,th:first-child,td.text,th.text{text-align:left}td.text{white-space:normal}
.same,.noise{color:#1a7f37}.changed,.slower{color:#b3261e;font-weight:bold}.missing,.failed{color:#9a6700;font-weight:bold}
section{margin:2em 0;border-top:2px solid #ccc}figure{margin:0}
.view{position:relative;display:inline-block;background:#000;cursor:pointer;max-width:100%}
.view img{display:block;image-rendering:pixelated;max-width:100%}.view img+img{position:absolute;left:0;top:0}
.bar input[type=range]{vertical-align:middle;width:16em}button{margin-right:.5em}svg{background:#fff;border:1px solid #ddd}code{word-break:break-all}
)";

// Buttons show one of three pictures; the slider cuts the render off to its right; a click, or a key, flips.
constexpr const char* kScript = R"(
for(const s of document.querySelectorAll('section.case')){
  const v=s.querySelector('.view'); if(!v) continue;
  const a=v.querySelector('.reference'),b=v.querySelector('.now'),e=v.querySelector('.evidence'),r=s.querySelector('input'),label=s.querySelector('.label');
  let mode='now';
  const show=m=>{mode=m;b.style.display=m==='reference'?'none':'';e.style.display=m==='evidence'?'':'none';
    b.style.clipPath=m==='slide'?`inset(0 0 0 ${r.value}%)`:'';
    label.textContent={reference:'reference',now:'this run',evidence:'where the evidence is',slide:'left: reference, right: this run'}[m]};
  for(const k of s.querySelectorAll('button')) k.onclick=()=>show(k.dataset.mode);
  v.onclick=()=>show(mode==='now'?'reference':'now');
  r.oninput=()=>show('slide');
  show('now');
}
)";

constexpr double kMostShown = 100;  // times kChangeExcess: with the same seeds a change of 1 % stands that far above what is left of the noise

std::string number(double v) { return std::isfinite(v) ? strf("%.3g", v) : "-"; }

std::string ratio(double now, double before) { return before > 0 ? strf("%.2f", now / before) : "-"; }

/// A line over runs. Not to scale with its neighbours: its own smallest and largest value are written beside it.
std::string curve(const std::string& title, const std::vector<double>& values) {
  constexpr double width = 260, height = 60, edge = 6;
  if (values.size() < 2) return "";
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double range = *high > *low ? *high - *low : 1;
  std::string points, dots;
  for (size_t i = 0; i < values.size(); ++i) {
    const double x = edge + (width - 2 * edge) * double(i) / double(values.size() - 1), y = height - edge - (height - 2 * edge) * (values[i] - *low) / range;
    points += strf("%.1f,%.1f ", x, y);
    dots += strf("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2\"><title>%s</title></circle>", x, y, number(values[i]).c_str());
  }
  return strf("<figure style=\"display:inline-block;margin-right:1em\"><figcaption>%s: %s to %s, last %s</figcaption>", title.c_str(), number(*low).c_str(),
              number(*high).c_str(), number(values.back()).c_str()) +
         strf("<svg width=\"%.0f\" height=\"%.0f\"><polyline fill=\"none\" stroke=\"#0969da\" points=\"", width, height) + points + "\"/>" + dots +
         "</svg></figure>";
}

std::string curves(const std::string& name, const std::vector<PastRun>& history) {
  std::vector<double> ms, rays, rmse, excess;
  for (const PastRun& run : history)
    for (const PastCase& c : run.cases)
      if (c.name == name && c.ms > 0) ms.push_back(c.ms), rays.push_back(double(c.rays)), rmse.push_back(c.rmse), excess.push_back(c.excess);
  return curve("ms", ms) + curve("rays", rays) + curve("RMSE to the reference", rmse) + curve("excess", excess);
}

std::string picture(const char* kind, const std::vector<uint8_t>& png) {
  return strf("<img class=\"%s\" alt=\"%s\" src=\"data:image/png;base64,", kind, kind) + base64(png) + "\">";
}

std::string section(const CaseRecord& c, const std::vector<PastRun>& history, const CasePictures& p) {
  std::string out = strf("<section class=\"case\" id=\"%s\"><h2>%s <span class=\"%s\">%s</span></h2>\n", markup(c.name).c_str(), markup(c.name).c_str(),
                         statusName(c.status), statusName(c.status));
  out += "<p>" + markup(c.message) + "</p>\n";
  if (!p.reference.empty() && !p.now.empty()) {
    out +=
        "<p class=\"bar\"><button data-mode=\"reference\">reference</button><button data-mode=\"now\">this run</button><button "
        "data-mode=\"evidence\">evidence</button>"
        "slider <input type=\"range\" min=\"0\" max=\"100\" value=\"50\"> <span class=\"label\"></span></p>\n";
    out += "<div class=\"view\">" + picture("reference", p.reference) + picture("now", p.now) + picture("evidence", p.evidence.empty() ? p.now : p.evidence) +
           "</div>\n";
  } else if (!p.now.empty()) {
    // One of another size or samples than what is accepted has no reference beside it either.
    out += c.status == CaseStatus::Missing ? "<p>Nothing is accepted yet: this run.</p>" : "<p>This run.</p>";
    out += "<div>" + picture("now", p.now) + "</div>\n";
  }
  if (!c.referenceDigest.empty())
    out += "<p>Reference <code>" + markup(c.referenceDigest.substr(0, 16)) + "</code>, accepted by " + markup(c.by) + ", " + markup(c.when) + ": " +
           markup(c.why) + "</p>\n";
  if (!c.plan.empty()) {
    out += "<p>Plan:</p><ul>";
    for (const std::string& n : c.plan) out += "<li><code>" + markup(n) + "</code></li>";
    out += "</ul>\n";
  }
  return out + curves(c.name, history) + "</section>\n";
}

}  // namespace

std::string markup(const std::string& text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      case '\'': out += "&#39;"; break;
      case '\n':
      case '\t': out += c; break;
      default: out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
    }
  return out;
}

std::string base64(const std::vector<uint8_t>& bytes) {
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const size_t left = bytes.size() - i;
    const uint32_t v = uint32_t(bytes[i]) << 16 | (left > 1 ? uint32_t(bytes[i + 1]) << 8 : 0) | (left > 2 ? uint32_t(bytes[i + 2]) : 0);
    out += digits[v >> 18];
    out += digits[v >> 12 & 63];
    out += left > 1 ? digits[v >> 6 & 63] : '=';
    out += left > 2 ? digits[v & 63] : '=';
  }
  return out;
}

Image evidencePicture(const Image& displayed, const std::vector<float>& excess) {
  Image out(displayed.width, displayed.height, 3);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      const Vec3 v = displayed.rgb(x, y);
      const float grey = 0.25f * (v.x + v.y + v.z) / 3;
      Vec3 colour(grey);
      const size_t i = size_t(y) * out.width + x;
      if (i < excess.size()) {
        const float e = excess[i] / float(kChangeExcess);
        if (e < 1) colour += Vec3(0, 0, 0.1f) * std::max(0.0f, e);
        else {
          const float u = std::log(e) / std::log(float(kMostShown));
          colour = Vec3(0.2f + 1.6f * u, 2 * u - 0.6f, 3 * u - 2);
        }
      }
      for (int c = 0; c < 3; ++c) out.at(x, y)[c] = std::clamp(colour[c], 0.0f, 1.0f);
    }
  return out;
}

std::string reportPage(const RunRecord& run, const std::vector<PastRun>& history, const std::function<CasePictures(const std::string&)>& pictures) {
  std::string out = "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>" + markup(run.suite) + "</title><style>" + kStyle + "</style>\n";
  out += "<h1>" + markup(run.suite) + "</h1><p>" + markup(run.when) + ", build " + markup(run.build) + ", " + std::to_string(history.size()) +
         " runs so far</p>\n";
  out += "<table><tr><th>case<th class=\"text\">status<th>excess<th>mean<th>RMSE<th>of noise<th>FLIP<th>ms<th>/ ref.<th>rays<th>/ ref.</tr>\n";
  for (const CaseRecord& c : run.cases) {
    const double shift = c.meanReference != 0 ? 100 * (c.meanNow / c.meanReference - 1) : 0;
    out += strf("<tr><td><a href=\"#%s\">%s</a><td class=\"text %s\">%s", markup(c.name).c_str(), markup(c.name).c_str(), statusName(c.status),
                statusName(c.status));
    out += strf("<td>%s<td>%+.3f %%<td>%s<td>%s<td>%s<td>%.0f<td>%s<td>%llu<td>%s</tr>\n", number(c.excess).c_str(), shift, number(c.rmse).c_str(),
                number(c.noiseRmse).c_str(), number(c.flip).c_str(), c.facts.ms, ratio(c.facts.ms, c.referenceMs).c_str(),
                static_cast<unsigned long long>(c.facts.rays), ratio(double(c.facts.rays), double(c.referenceRays)).c_str());
  }
  out += strf("</table>\n<p>Excess: standard deviations of the strongest statistic above what the signs of the noise give; above %.0f is a change.</p>\n",
              kChangeExcess);
  for (const CaseRecord& c : run.cases) out += section(c, history, pictures(c.name));
  return out + "<script>" + kScript + "</script></html>\n";
}

}  // namespace gobo::cli
