// SPDX-License-Identifier: Apache-2.0
// gobo environment --method published: what the decomposition of the thesis of 2007 and what it tried beside it make of a map.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/image_io.h"
#include "commands.h"
#include "environment_panels.h"
#include "measure/report.h"
#include "pictures.h"
#include "report.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/published/published_report.h"

namespace gobo::cli {
namespace {

using namespace transfer::published;
using transfer::luminanceOf;
using Panels = EnvironmentPanels;

template <typename T>
Result<T> chosen(const char* option, const std::string& text, const std::vector<std::pair<const char*, T>>& choices) {
  if (text.empty()) return choices[0].second;
  std::string names;
  for (const auto& [name, value] : choices) {
    if (text == name) return value;
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return invalidArgument(std::string(option) + " " + text + ": must be one of " + names);
}

Result<PublishedSettings> settingsOf(const EnvironmentCommand& c) {
  PublishedSettings s;
  s.bands = int(c.bands);
  s.lights = c.lights;
  if (c.weber > 0) s.weber = c.weber;
  if (c.radiusDeg > 0) s.peaks.fixed = c.radiusDeg / Panels::kDegrees;
  GOBO_ASSIGN(s.window,
              chosen<Window>("--window", c.window, {{"none", Window::None}, {"hann", Window::Hann}, {"lanczos", Window::Lanczos}, {"least", Window::Least}}));
  GOBO_ASSIGN(s.peaks.radius, chosen<Radius>("--radius", c.radius,
                                             {{"fixed", Radius::Fixed}, {"basin", Radius::Basin}, {"best", Radius::Best}, {"curvature", Radius::Curvature}}));
  GOBO_ASSIGN(s.peaks.refine, chosen<Refine>("--refine", c.refine, {{"log", Refine::LogQuadric}, {"quadric", Refine::Quadric}, {"none", Refine::None}}));
  GOBO_ASSIGN(s.power, chosen<Power>("--power", c.power, {{"published", Power::Published}, {"residual", Power::Residual}}));
  if (c.radiusDeg > 0 && s.peaks.radius != Radius::Fixed) return invalidArgument("--radius-deg: of --radius fixed alone");
  if (c.fit == "l2" || c.fit == "nnls") {
    if (!c.power.empty()) return invalidArgument("--power: of --fit greedy alone");
    if (s.window != Window::None) return invalidArgument("--window: of --fit greedy alone");
    s.power = c.fit == "l2" ? Power::Least : Power::NonNegative;
  }
  return s;
}

/// Numbers of wavelets that are told: powers of two, the number asked for, all.
std::vector<size_t> countsOf(size_t terms, size_t all) {
  std::vector<size_t> counts;
  for (size_t k = 1; k < all; k *= 2) counts.push_back(k);
  counts.push_back(all);
  if (std::find(counts.begin(), counts.end(), terms) == counts.end()) counts.insert(std::upper_bound(counts.begin(), counts.end(), terms), terms);
  return counts;
}

Status haar(const EnvironmentCommand& c) {
  for (const auto& [name, text] :
       {std::pair("--window", &c.window), std::pair("--radius", &c.radius), std::pair("--refine", &c.refine), std::pair("--power", &c.power)})
    if (!text->empty()) return invalidArgument(std::string(name) + ": not of --fit haar");
  if (c.weber > 0) return invalidArgument("--weber: not of --fit haar");
  if (c.radiusDeg > 0) return invalidArgument("--radius-deg: not of --fit haar");
  if (!c.out.empty()) return invalidArgument("--out: --fit haar has no picture");
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_ASSIGN(const EnvironmentPtr map, loadEnvironment(c.map));
  const TaskArena arena;
  const EnvironmentCells cells(*map, {}, &arena);
  const CubeHaar wavelets(cells);
  const size_t terms = c.terms > 0 ? c.terms : size_t(c.bands) * c.bands;
  const double smooth = harmonicsError(cells, transfer::environmentHarmonics(*map, int(c.bands), arena), int(c.bands));
  if (!c.csv.empty()) {
    Table table("haar", {"terms", "error"});
    for (size_t k = 0; k <= wavelets.terms().size(); ++k) table.add({double(k), wavelets.error(k)});
    const std::string csv = table.csv();
    GOBO_TRY(writeFileAtomic(c.csv, csv.data(), csv.size()));
  }
  const std::vector<size_t> counts = countsOf(terms, wavelets.terms().size());
  if (c.json) {
    std::string errors, kept;
    for (const size_t k : counts)
      errors += (errors.empty() ? "" : ", ") + std::string("{\"terms\": ") + std::to_string(k) + ", \"error\": " + jsonNumber(wavelets.error(k)) + "}";
    for (size_t k = 0; k < terms; ++k)
      kept += (k ? ", " : "") + std::string("{\"index\": ") + std::to_string(wavelets.terms()[k].index) +
              ", \"value\": " + Panels::json(wavelets.terms()[k].value) + "}";
    std::printf(
        "{\"method\": \"published\", \"fit\": \"haar\", \"width\": %d, \"height\": %d, \"repairedTexels\": %d, \"errors\": [%s], \"harmonicsError\": %s, "
        "\"terms\": [%s]}\n",
        map->width, map->height, map->repairedTexels, errors.c_str(), jsonNumber(smooth).c_str(), kept.c_str());
    return {};
  }
  std::printf("%s: %zu Haar wavelets miss %.1f %% of the map's cells (L2), %u harmonics %.1f %%\n", map->name.c_str(), terms, 100 * wavelets.error(terms),
              c.bands * c.bands, 100 * smooth);
  std::vector<std::vector<std::string>> rows;
  for (const size_t k : counts) rows.push_back({std::to_string(k), strf("%.2f %%", 100 * wavelets.error(k))});
  printTable({"wavelets", "missed"}, rows, {true, true});
  return {};
}

void printJson(const EnvironmentCommand& c, const Environment& map, const PublishedReport& report) {
  const PublishedSplit& split = report.split;
  std::string lights, full, used, maximum, factors;
  for (const PublishedLight& l : split.lights)
    lights += std::string(lights.empty() ? "" : ", ") + "{\"direction\": " + Panels::json(l.direction) + ", \"irradiance\": " + Panels::json(l.irradiance) +
              ", \"radiance\": " + Panels::json(l.radiance) + ", \"seen\": " + Panels::json(l.seen) + ", \"difference\": " + jsonNumber(l.difference) +
              ", \"angularSizeDeg\": " + jsonNumber(2 * l.radius * Panels::kDegrees) + "}";
  for (size_t h = 0; h < split.full.size() / 3; ++h) {
    full += (h ? ", " : "") + Panels::json(DVec3(split.full[3 * h], split.full[3 * h + 1], split.full[3 * h + 2]));
    used += (h ? ", " : "") + Panels::json(DVec3(split.used[3 * h], split.used[3 * h + 1], split.used[3 * h + 2]));
  }
  for (const double v : split.maximum) maximum += (maximum.empty() ? "" : ", ") + jsonNumber(v);
  for (const double v : split.factors) factors += (factors.empty() ? "" : ", ") + jsonNumber(v);
  std::printf(
      "{\"method\": \"published\", \"fit\": \"%s\", \"width\": %d, \"height\": %d, \"repairedTexels\": %d, \"flux\": %s, \"given\": %s, \"lightShare\": %s, "
      "\"candidates\": %zu, \"lights\": [%s], \"window\": {\"factors\": [%s], \"damping\": %s}, \"maximum\": [%s], \"missed\": %s, "
      "\"whole\": {\"error\": %s, \"least\": %s, \"coefficients\": [%s]}, \"used\": {\"least\": %s, \"coefficients\": [%s]}}\n",
      c.fit.empty() ? "greedy" : c.fit.c_str(), map.width, map.height, map.repairedTexels, Panels::json(split.flux).c_str(), Panels::json(split.given).c_str(),
      jsonNumber(report.pictures.lightShare).c_str(), split.candidates, lights.c_str(), factors.c_str(), jsonNumber(split.damping).c_str(), maximum.c_str(),
      jsonNumber(split.squared).c_str(), jsonNumber(report.pictures.whole.error).c_str(), jsonNumber(report.pictures.whole.least).c_str(), full.c_str(),
      jsonNumber(report.pictures.rest.least).c_str(), used.c_str());
}

void printText(const EnvironmentCommand& c, const Environment& map, const PublishedReport& report) {
  const PublishedSplit& split = report.split;
  const double flux = luminanceOf(split.flux), given = luminanceOf(split.given);
  std::printf("%s: %d x %d, flux %s W/m^2", map.name.c_str(), map.width, map.height, Panels::list(split.flux, "%.4g").c_str());
  if (map.repairedTexels > 0) std::printf(", %d broken texels taken for black", map.repairedTexels);
  std::printf("\n%u bands and %zu lights of %zu maxima give %+.1f %% of the flux too much; lights hold %.1f %% of it\n", c.bands, split.lights.size(),
              split.candidates, flux > 0 ? 100 * (given / flux - 1) : 0.0, 100 * report.pictures.lightShare);
  std::printf("of the smoothed map %.1f %% are missed (L2), at most %.4g W/m^2/sr; least of the harmonics %.3g, without lights and window %.3g W/m^2/sr\n",
              100 * split.squared, split.maximum.back(), report.pictures.rest.least, report.pictures.whole.least);
  if (split.damping > 0) std::printf("least window: 1 / (1 + %.4g l^2 (l + 1)^2)\n", split.damping);
  if (split.lights.empty()) return;
  std::vector<std::vector<std::string>> rows;
  for (const PublishedLight& l : split.lights)
    rows.push_back(
        {strf("%.4g", l.difference), Panels::list(l.irradiance, "%.4g"), strf("%.2f", 2 * l.radius * Panels::kDegrees), Panels::list(l.direction, "%.4f")});
  printTable({"difference", "irradiance, W/m^2", "size, deg", "direction"}, rows, {true, false, true, false});
}

}  // namespace

Status analysePublished(const EnvironmentCommand& c) {
  if (c.lightShare >= 0) return invalidArgument("--light-share: of --method moments alone; --weber ends this one's list");
  if (c.fit == "haar") return haar(c);
  if (!c.fit.empty() && c.fit != "greedy" && c.fit != "l2" && c.fit != "nnls")
    return invalidArgument("--fit " + c.fit + ": must be one of greedy, l2, nnls, haar");
  if (c.terms > 0) return invalidArgument("--terms: of --fit haar alone");
  GOBO_ASSIGN(const PublishedSettings settings, settingsOf(c));
  GOBO_ASSIGN(const v1::Encoding::Format format, Panels::formatOf(c.out));
  GOBO_TRY(checkFolder("--out", c.out));
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_ASSIGN(const EnvironmentPtr map, loadEnvironment(c.map));
  const TaskArena arena;
  const PublishedReport report = reportPublished(*map, settings, arena);
  if (!c.csv.empty()) {
    Table table("coefficients", {"band", "order", "R", "G", "B", "used R", "used G", "used B"});
    for (int l = 0, h = 0; l < int(c.bands); ++l)
      for (int m = -l; m <= l; ++m, ++h) {
        const double *full = report.split.full.data() + 3 * h, *used = report.split.used.data() + 3 * h;
        table.add({double(l), double(m), full[0], full[1], full[2], used[0], used[1], used[2]});
      }
    const std::string csv = table.csv();
    GOBO_TRY(writeFileAtomic(c.csv, csv.data(), csv.size()));
  }
  if (!c.out.empty()) {
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, Panels::drawn(report.pictures, format));
    GOBO_TRY(writeFileAtomic(c.out, bytes.data(), bytes.size()));
  }
  (c.json ? printJson : printText)(c, *map, report);
  return {};
}

}  // namespace gobo::cli
