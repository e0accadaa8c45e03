// SPDX-License-Identifier: Apache-2.0
// An occlusion plot: the visibility of one light along a line of the picture, by several shadow techniques and by shadow rays, all from the
// same view samples. It shows what an error figure does not: where a technique leaks, rings or widens an edge.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "base/image_io.h"
#include "commands.h"
#include "filters/shadow_technique.h"
#include "measure/plot.h"
#include "measure/report.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {
namespace {

struct Named {
  std::string text;
  v1::ShadowTechnique technique;
};

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  for (size_t begin = 0;;) {
    const size_t end = text.find(by, begin);
    parts.push_back(text.substr(begin, end == std::string::npos ? end : end - begin));
    if (end == std::string::npos) return parts;
    begin = end + 1;
  }
}

/// "exponential.c=80,map.blur=2": fields of one technique; `base` says what it does not (the map of --set shadows.map...).
Result<Named> parseTechnique(const std::string& text, const v1::ShadowTechnique& base) {
  v1::RenderRequest scratch;
  if (base.has_map()) *scratch.mutable_shadows()->mutable_map() = base.map();
  for (const std::string& field : split(text, ',')) {
    if (field.empty()) return invalidArgument("--techniques: an empty name in \"" + text + "\"");
    const Status set = setPath(scratch, "shadows." + field + (field.find('=') == std::string::npos ? "=" : ""));
    if (!set.ok()) return set.at("--techniques " + text);
  }
  Named named{text, scratch.shadows()};
  const auto key = named.technique.technique_case();
  if (key == v1::ShadowTechnique::TECHNIQUE_NOT_SET) return invalidArgument("--techniques " + text + ": names no technique");
  if (!findShadowTechnique(key)) return invalidArgument("--techniques " + text + ": has no visibility of its own");
  return named;
}

/// The light that is meant and its kind ("rect"): of the request where it adds the light or changes the kind, else of the scene.
Result<std::pair<std::string, std::string>> findLight(const v1::SceneInfo& scene, const v1::RenderRequest& request, const std::string& asked) {
  std::vector<std::pair<std::string, std::string>> all;
  for (const v1::LightInfo& light : scene.lights()) all.emplace_back(light.name(), light.kind());
  for (const auto& [name, edit] : request.lights()) {
    auto at = std::find_if(all.begin(), all.end(), [&](const auto& l) { return l.first == name; });
    if (at == all.end()) at = all.insert(all.end(), {name, ""});
    if (edit.kind() == v1::LightEdit::KIND_UNSPECIFIED) continue;
    at->second = v1::LightEdit::Kind_Name(edit.kind());
    std::transform(at->second.begin(), at->second.end(), at->second.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  }
  std::string names;
  for (const auto& light : all) {
    if (light.first == asked) return light;
    names += (names.empty() ? "" : ", ") + light.first;
  }
  if (!asked.empty()) return notFound("--light " + asked + ": the scene has no such light (has: " + names + ")");
  if (all.size() != 1) return invalidArgument(all.empty() ? "the scene has no light" : "--light: which one? (has: " + names + ")");
  return all[0];
}

bool supports(const ShadowTechniqueEntry& entry, const std::string& kind) {
  static const std::pair<const char*, LightKind> kinds[] = {
      {"point", LightKind::Point},   {"spot", LightKind::Spot}, {"directional", LightKind::Directional}, {"rect", LightKind::Rect}, {"disk", LightKind::Disk},
      {"sphere", LightKind::Sphere}, {"mesh", LightKind::Mesh}, {"environment", LightKind::Environment}};
  for (const auto& [name, value] : kinds)
    if (kind == name) return entry.supports(value);
  return true;  // a kind of later versions: the server knows
}

struct Line {
  Image visibility;
  std::vector<double> values;
  double ms = 0;
};  ///< NaN where no surface is seen

Status occlusion(Session& session, const OcclusionCommand& c) {
  if (!c.plot.empty()) {
    GOBO_ASSIGN(const v1::Encoding::Format format, formatOf(c.plot));
    if (format != v1::Encoding::PNG) return invalidArgument("--plot " + c.plot + ": must end in .png");
  }
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_TRY(checkFolder("--plot", c.plot));
  GOBO_ASSIGN(v1::RenderRequest base, makeRequest(session, c.request, c.scene));
  v1::SceneInfo scene;
  {
    Session::Call call(session);
    v1::InspectSceneRequest request;
    request.set_scene(base.scene());
    GOBO_TRY(session.statusOf(session.scenes().Inspect(&call.context, request, &scene)));
  }
  GOBO_ASSIGN(const auto light, findLight(scene, base, c.light));
  const std::string& name = light.first;
  if (light.second == "environment") return invalidArgument("--light " + name + ": an environment has no single visibility");
  base.clear_outputs();
  base.add_outputs("visibility:" + name);
  base.add_outputs("alpha");
  base.clear_certificate();
  base.mutable_encoding()->Clear();
  base.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);

  const auto own = base.lights().find(name);
  const v1::ShadowTechnique settings = own != base.lights().end() && own->second.has_shadow() ? own->second.shadow() : base.shadows();
  std::vector<Named> techniques;
  if (c.techniques.empty()) {
    for (const ShadowTechniqueEntry& entry : shadowTechniques()) {
      if (entry.key == v1::ShadowTechnique::kRayTraced || entry.key == v1::ShadowTechnique::kAuto || !supports(entry, light.second)) continue;
      GOBO_ASSIGN(Named named, parseTechnique(entry.name, settings));
      techniques.push_back(std::move(named));
    }
    if (techniques.empty()) return invalidArgument("--light " + name + ": no shadow technique but rays does this kind of light (" + light.second + ")");
  } else {
    for (const std::string& text : split(c.techniques, ';')) {
      GOBO_ASSIGN(Named named, parseTechnique(text, settings));
      if (!supports(*findShadowTechnique(named.technique.technique_case()), light.second))
        return invalidArgument("--techniques " + text + ": does not do the kind of light '" + name + "' (" + light.second + ")");
      techniques.push_back(std::move(named));
    }
  }
  const bool vertical = c.column >= 0;
  const auto along = [&](const v1::ShadowTechnique& technique) -> Result<Line> {
    v1::RenderRequest request = base;
    *(*request.mutable_lights())[name].mutable_shadow() = technique;
    GOBO_ASSIGN(const Answer answer, renderOnce(session, request));
    for (const std::string& warning : answer.reply.warnings()) std::fprintf(stderr, "gobo: warning: %s\n", warning.c_str());
    Line line;
    GOBO_ASSIGN(line.visibility, rawImage(answer, 0));
    GOBO_ASSIGN(const Image alpha, rawImage(answer, 1));
    const Image& v = line.visibility;
    const int lines = vertical ? v.width : v.height, at = vertical ? c.column : c.row >= 0 ? c.row : v.height / 2;
    if (at >= lines) return invalidArgument(std::string(vertical ? "--column " : "--row ") + std::to_string(at) + ": the picture has " + std::to_string(lines));
    for (int i = 0; i < (vertical ? v.height : v.width); ++i) {
      const int x = vertical ? at : i, y = vertical ? i : at;
      line.values.push_back(alpha.at(x, y)[0] > 0 ? double(v.at(x, y)[0]) : std::numeric_limits<double>::quiet_NaN());
    }
    line.ms = answer.reply.total_ms() - answer.reply.queue_ms();
    return line;
  };
  v1::ShadowTechnique rays;
  rays.mutable_ray_traced()->set_samples(c.referenceSamples);
  GOBO_ASSIGN(const Line truth, along(rays));
  std::vector<Line> lines;
  std::vector<std::vector<std::string>> rows;
  for (const Named& t : techniques) {
    auto line = along(t.technique);
    if (!line.ok()) return line.status().at(t.text);
    double square = 0, bright = 0, dark = 0;
    size_t n = 0;
    for (size_t i = 0; i < truth.values.size(); ++i) {
      const double d = line->values[i] - truth.values[i];
      if (!std::isfinite(d)) continue;
      square += d * d;
      (d > 0 ? bright : dark) += std::fabs(d);
      ++n;
    }
    const double pixels = double(std::max<size_t>(n, 1));
    rows.push_back({t.text, strf("%.1f", line->ms), strf("%.4f", std::sqrt(square / pixels)), strf("%.4f", bright / pixels), strf("%.4f", dark / pixels)});
    lines.push_back(std::move(*line));
  }
  printTable({"technique", "ms", "RMSE", "too bright", "too dark"}, rows, {false, true, true, true, true});

  std::vector<std::string> columns{"pixel", "truth"};
  for (const Named& t : techniques) columns.push_back(t.text);
  Table table("occlusion", columns);
  for (size_t i = 0; i < truth.values.size(); ++i) {
    const auto cell = [](double v) { return std::isfinite(v) ? Table::Cell(v) : Table::Cell(std::string()); };
    std::vector<Table::Cell> row{double(i), cell(truth.values[i])};
    for (const Line& line : lines) row.push_back(cell(line.values[i]));
    table.add(std::move(row));
  }
  if (!c.csv.empty()) {
    const std::string csv = table.csv();
    GOBO_TRY(writeFileAtomic(c.csv, csv.data(), csv.size()));
  }
  if (!c.plot.empty()) {
    Plot plot;
    plot.title = scene.id() + ": light " + name + ", " + (vertical ? "column " : "row ") +
                 std::to_string(vertical     ? c.column
                                : c.row >= 0 ? c.row
                                             : truth.visibility.height / 2);
    plot.xLabel = vertical ? "y [px]" : "x [px]";
    plot.yLabel = "visibility";
    plot.logX = plot.logY = false;
    plot.width = 1280;
    plot.height = std::max(600, 140 + 22 * int(lines.size()));
    const auto add = [&](const std::string& series, const std::vector<double>& values, double width) {
      PlotSeries s{series, {}, true, false, true, width};
      for (size_t i = 0; i < values.size(); ++i) s.points.push_back({double(i), values[i]});
      plot.series.push_back(std::move(s));
    };
    add("rays: truth", truth.values, 4);
    for (size_t k = 0; k < lines.size(); ++k) add(techniques[k].text, lines[k].values, 1.6);
    GOBO_TRY(writePlot(plot, c.plot));
  }
  return {};
}

}  // namespace

int runOcclusion(const SessionOptions& options, const OcclusionCommand& command) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = occlusion(**session, command);
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
