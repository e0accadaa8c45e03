// SPDX-License-Identifier: Apache-2.0
// What environment.transfer makes of a map, without a scene: harmonics, lights, and what they miss; as text, JSON, CSV and a picture.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/image_io.h"
#include "base/transfer.h"
#include "commands.h"
#include "measure/report.h"
#include "pictures.h"
#include "report.h"
#include "techniques/transfer/environment_report.h"

namespace gobo::cli {
namespace {

using transfer::EnvironmentReport;
using transfer::luminanceOf;
using transfer::SkyDisk;

constexpr double kDegrees = 57.29577951308232;

std::string list(const DVec3& v, const char* format) { return strf(format, v.x) + ", " + strf(format, v.y) + ", " + strf(format, v.z); }
std::string jsonNumbers(const DVec3& v) { return "[" + jsonNumber(v.x) + ", " + jsonNumber(v.y) + ", " + jsonNumber(v.z) + "]"; }

/// Four panels, each with the exposure that shows the map's mean at 0.3: the map with its lights circled and what they leave; below, the harmonics of both,
/// blue where they are negative.
Image panels(const EnvironmentReport& report) {
  const int w = report.whole.radiance.width, h = report.whole.radiance.height;
  Image out(2 * w, 2 * h, 3);
  out.names = {"R", "G", "B"};
  const double mean = luminanceOf(DVec3(report.split.full[0], report.split.full[1], report.split.full[2])) * 0.28209479177387814;
  const float exposure = mean > 0 ? float(0.3 / mean) : 1.0f;
  const auto put = [&](const Image& from, int left, int top) {
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        const Vec3 c = exposure * from.rgb(x, y);
        const float dark = -(0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z);
        float* p = out.at(left + x, top + y);
        for (int k = 0; k < 3; ++k) p[k] = dark > 0.0f ? (k == 2 ? dark : 0.0f) : clamp01(c[k]);
      }
  };
  put(report.whole.radiance, 0, 0);
  put(report.rest.radiance, w, 0);
  put(report.whole.harmonics, 0, h);
  put(report.rest.harmonics, w, h);
  for (const SkyDisk& disk : report.split.lights)
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        const double theta = (y + 0.5) * double(kPi) / h, phi = ((x + 0.5) / w - 0.5) * 2 * double(kPi);
        const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
        const double beyond = std::acos(std::clamp(glm::dot(d, disk.direction), -1.0, 1.0)) * kDegrees - std::max(disk.radius * kDegrees, 2.0);
        if (beyond < 0 || beyond > 1.4) continue;
        float* p = out.at(x, y);
        p[0] = 1.0f;
        p[1] = p[2] = 0.0f;
      }
  return out;
}

Result<std::vector<uint8_t>> drawn(const EnvironmentReport& report, v1::Encoding::Format format) {
  if (format == v1::Encoding::PNG) return encodePng(panels(report));
  std::vector<ExrLayer> layers;
  for (const auto& [name, image] : {std::pair("", &report.whole.radiance), std::pair("harmonics", &report.whole.harmonics),
                                    std::pair("rest", &report.rest.radiance), std::pair("rest_harmonics", &report.rest.harmonics)})
    layers.push_back({name, {"R", "G", "B"}, image->data, true});
  return encodeExr(report.whole.radiance.width, report.whole.radiance.height, layers);
}

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
      lights += std::string(lights.empty() ? "" : ", ") + "{\"direction\": " + jsonNumbers(disk.direction) +
                ", \"irradiance\": " + jsonNumbers(disk.irradiance) + ", \"angularSizeDeg\": " + jsonNumber(2 * disk.radius * kDegrees) +
                ", \"share\": " + jsonNumber(shareOf(disk)) + "}";
    for (size_t h = 0; h < split.full.size() / 3; ++h) {
      full += (h ? ", " : "") + jsonNumbers(DVec3(split.full[3 * h], split.full[3 * h + 1], split.full[3 * h + 2]));
      rest += (h ? ", " : "") + jsonNumbers(DVec3(split.rest[3 * h], split.rest[3 * h + 1], split.rest[3 * h + 2]));
    }
    const auto part = [](const EnvironmentReport::Part& p, const std::string& coefficients) {
      return "{\"error\": " + jsonNumber(p.error) + ", \"least\": " + jsonNumber(p.least) + ", \"coefficients\": [" + coefficients + "]}";
    };
    std::printf(
        "{\"width\": %d, \"height\": %d, \"repairedTexels\": %d, \"mean\": %s, \"largest\": %s, \"lightShare\": %s, \"lights\": [%s], "
        "\"whole\": %s, \"rest\": %s}\n",
        map.width, map.height, map.repairedTexels, jsonNumbers(mean).c_str(), jsonNumber(double(largest)).c_str(), jsonNumber(report.lightShare).c_str(),
        lights.c_str(), part(report.whole, full).c_str(), part(report.rest, rest).c_str());
    return;
  }
  std::printf("%s: %d x %d, mean radiance %s W/m^2/sr, brightest texel %.4g times the mean's luminance", map.name.c_str(), map.width, map.height,
              list(mean, "%.4g").c_str(), luminanceOf(mean) > 0 ? double(largest) / luminanceOf(mean) : 0.0);
  if (map.repairedTexels > 0) std::printf(", %d broken texels taken for black", map.repairedTexels);
  std::printf("\n%u bands: the harmonics miss %.1f %% of the map (L2), and %.1f %% of what the lights leave; least %.3g and %.3g W/m^2/sr\n", c.bands,
              100 * report.whole.error, 100 * report.rest.error, report.whole.least, report.rest.least);
  std::printf("%zu lights hold %.1f %% of the luminous flux\n", split.lights.size(), 100 * report.lightShare);
  if (split.lights.empty()) return;
  std::vector<std::vector<std::string>> rows;
  for (const SkyDisk& disk : split.lights)
    rows.push_back(
        {strf("%.2f %%", 100 * shareOf(disk)), list(disk.irradiance, "%.4g"), strf("%.2f", 2 * disk.radius * kDegrees), list(disk.direction, "%.4f")});
  printTable({"share", "irradiance, W/m^2", "size, deg", "direction"}, rows, {true, false, true, false});
}

Status analyse(const EnvironmentCommand& c) {
  v1::Encoding::Format format = v1::Encoding::PNG;
  if (!c.out.empty()) {
    GOBO_ASSIGN(format, formatOf(c.out));
    if (format != v1::Encoding::PNG && format != v1::Encoding::EXR) return invalidArgument("--out " + c.out + ": must end in .png or .exr");
  }
  GOBO_TRY(checkFolder("--out", c.out));
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_ASSIGN(const EnvironmentPtr map, loadEnvironment(c.map));
  const TaskArena arena;
  const EnvironmentReport report = transfer::reportEnvironment(*map, int(c.bands), int(c.lights), c.lightShare, arena);
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
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, drawn(report, format));
    GOBO_TRY(writeFileAtomic(c.out, bytes.data(), bytes.size()));
  }
  print(c, *map, report);
  return {};
}

}  // namespace

int runEnvironment(const EnvironmentCommand& command) {
  const Status status = analyse(command);
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
