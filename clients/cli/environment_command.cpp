// SPDX-License-Identifier: Apache-2.0
// What environment.transfer makes of a map, without a scene: harmonics, lights, and what they miss; as text, JSON, CSV and a picture.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/image_io.h"
#include "commands.h"
#include "environment_panels.h"
#include "measure/report.h"
#include "pictures.h"
#include "report.h"
#include "techniques/transfer/environment_report.h"

namespace gobo::cli {
namespace {

using transfer::EnvironmentReport;
using transfer::luminanceOf;
using transfer::SkyDisk;
constexpr double kDegrees = EnvironmentPanels::kDegrees;

void print(const EnvironmentCommand& c, const Environment& map, const EnvironmentReport& report) {
  const auto& split = report.split;
  const DVec3 mean = DVec3(split.full[0], split.full[1], split.full[2]) * 0.28209479177387814;
  float largest = 0;
  for (const Vec3& texel : map.texels) largest = std::max(largest, float(luminanceOf(DVec3(texel))));
  const double flux = 4 * double(kPi) * luminanceOf(mean);
  const auto shareOf = [&](const SkyDisk& disk) { return flux > 0 ? luminanceOf(disk.flux) / flux : 0.0; };
  if (c.json) {
    std::string lights, full, rest;
    for (const SkyDisk& disk : split.lights)
      lights += std::string(lights.empty() ? "" : ", ") + "{\"direction\": " + EnvironmentPanels::json(disk.direction) +
                ", \"irradiance\": " + EnvironmentPanels::json(disk.irradiance) + ", \"angularSizeDeg\": " + jsonNumber(2 * disk.radius * kDegrees) +
                ", \"share\": " + jsonNumber(shareOf(disk)) + "}";
    for (size_t h = 0; h < split.full.size() / 3; ++h) {
      full += (h ? ", " : "") + EnvironmentPanels::json(DVec3(split.full[3 * h], split.full[3 * h + 1], split.full[3 * h + 2]));
      rest += (h ? ", " : "") + EnvironmentPanels::json(DVec3(split.rest[3 * h], split.rest[3 * h + 1], split.rest[3 * h + 2]));
    }
    const auto part = [](const EnvironmentReport::Part& p, const std::string& coefficients) {
      return "{\"error\": " + jsonNumber(p.error) + ", \"least\": " + jsonNumber(p.least) + ", \"coefficients\": [" + coefficients + "]}";
    };
    std::printf(
        "{\"width\": %d, \"height\": %d, \"repairedTexels\": %d, \"mean\": %s, \"largest\": %s, \"lightShare\": %s, \"lights\": [%s], "
        "\"whole\": %s, \"rest\": %s}\n",
        map.width, map.height, map.repairedTexels, EnvironmentPanels::json(mean).c_str(), jsonNumber(double(largest)).c_str(),
        jsonNumber(report.lightShare).c_str(), lights.c_str(), part(report.whole, full).c_str(), part(report.rest, rest).c_str());
    return;
  }
  std::printf("%s: %d x %d, mean radiance %s W/m^2/sr, brightest texel %.4g times the mean's luminance", map.name.c_str(), map.width, map.height,
              EnvironmentPanels::list(mean, "%.4g").c_str(), luminanceOf(mean) > 0 ? double(largest) / luminanceOf(mean) : 0.0);
  if (map.repairedTexels > 0) std::printf(", %d broken texels taken for black", map.repairedTexels);
  std::printf("\n%u bands: the harmonics miss %.1f %% of the map (L2), and %.1f %% of what the lights leave; least %.3g and %.3g W/m^2/sr\n", c.bands,
              100 * report.whole.error, 100 * report.rest.error, report.whole.least, report.rest.least);
  std::printf("%zu lights hold %.1f %% of the luminous flux\n", split.lights.size(), 100 * report.lightShare);
  if (split.lights.empty()) return;
  std::vector<std::vector<std::string>> rows;
  for (const SkyDisk& disk : split.lights)
    rows.push_back({strf("%.2f %%", 100 * shareOf(disk)), EnvironmentPanels::list(disk.irradiance, "%.4g"), strf("%.2f", 2 * disk.radius * kDegrees),
                    EnvironmentPanels::list(disk.direction, "%.4f")});
  printTable({"share", "irradiance, W/m^2", "size, deg", "direction"}, rows, {true, false, true, false});
}

Status analyse(const EnvironmentCommand& c) {
  for (const auto& [name, text] : {std::pair("--window", &c.window), std::pair("--radius", &c.radius), std::pair("--refine", &c.refine),
                                   std::pair("--power", &c.power), std::pair("--fit", &c.fit)})
    if (!text->empty()) return invalidArgument(std::string(name) + ": of --method published alone");
  for (const auto& [name, given] : {std::pair("--weber", c.weber > 0), std::pair("--radius-deg", c.radiusDeg > 0), std::pair("--terms", c.terms > 0)})
    if (given) return invalidArgument(std::string(name) + ": of --method published alone");
  GOBO_ASSIGN(const v1::Encoding::Format format, EnvironmentPanels::formatOf(c.out));
  GOBO_TRY(checkFolder("--out", c.out));
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_ASSIGN(const EnvironmentPtr map, loadEnvironment(c.map));
  const TaskArena arena;
  const EnvironmentReport report = transfer::reportEnvironment(*map, int(c.bands), int(c.lights), c.lightShare < 0 ? 0.02 : c.lightShare, arena);
  if (!c.csv.empty()) {
    Table table("coefficients", {"band", "order", "R", "G", "B", "rest R", "rest G", "rest B"});
    for (int l = 0, h = 0; l < int(c.bands); ++l)
      for (int m = -l; m <= l; ++m, ++h) {
        const double *full = report.split.full.data() + 3 * h, *rest = report.split.rest.data() + 3 * h;
        table.add({double(l), double(m), full[0], full[1], full[2], rest[0], rest[1], rest[2]});
      }
    const std::string csv = table.csv();
    GOBO_TRY(writeFileAtomic(c.csv, csv.data(), csv.size()));
  }
  if (!c.out.empty()) {
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, EnvironmentPanels::drawn(report, format));
    GOBO_TRY(writeFileAtomic(c.out, bytes.data(), bytes.size()));
  }
  print(c, *map, report);
  return {};
}

}  // namespace

int runEnvironment(const EnvironmentCommand& command) {
  const Status status = command.method.empty() || command.method == "moments" ? analyse(command)
                        : command.method == "published"                       ? analysePublished(command)
                                                        : invalidArgument("--method " + command.method + ": must be moments or published");
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
