// SPDX-License-Identifier: Apache-2.0
#include "environment_panels.h"

#include <algorithm>
#include <cmath>

#include "base/image_io.h"
#include "pictures.h"
#include "report.h"

namespace gobo::cli {

namespace {

using transfer::EnvironmentReport;
using transfer::luminanceOf;
using transfer::SkyDisk;

/// Four panels, each with the exposure that shows the map's mean at 0.3: the map with its lights circled and what they leave; below, the harmonics of both,
/// blue where they are negative.
Image fourOf(const EnvironmentReport& report) {
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
        const double beyond = std::acos(std::clamp(glm::dot(d, disk.direction), -1.0, 1.0)) * EnvironmentPanels::kDegrees -
                              std::max(disk.radius * EnvironmentPanels::kDegrees, 2.0);
        if (beyond < 0 || beyond > 1.4) continue;
        float* p = out.at(x, y);
        p[0] = 1.0f;
        p[1] = p[2] = 0.0f;
      }
  return out;
}

}  // namespace

std::string EnvironmentPanels::list(const DVec3& v, const char* format) { return strf(format, v.x) + ", " + strf(format, v.y) + ", " + strf(format, v.z); }
std::string EnvironmentPanels::json(const DVec3& v) { return "[" + jsonNumber(v.x) + ", " + jsonNumber(v.y) + ", " + jsonNumber(v.z) + "]"; }

Result<v1::Encoding::Format> EnvironmentPanels::formatOf(const std::string& out) {
  if (out.empty()) return v1::Encoding::PNG;
  GOBO_ASSIGN(const v1::Encoding::Format format, cli::formatOf(out));
  if (format != v1::Encoding::PNG && format != v1::Encoding::EXR) return invalidArgument("--out " + out + ": must end in .png or .exr");
  return format;
}

Result<std::vector<uint8_t>> EnvironmentPanels::drawn(const EnvironmentReport& report, v1::Encoding::Format format) {
  if (format == v1::Encoding::PNG) return encodePng(fourOf(report));
  std::vector<ExrLayer> layers;
  for (const auto& [name, image] : {std::pair("", &report.whole.radiance), std::pair("harmonics", &report.whole.harmonics),
                                    std::pair("rest", &report.rest.radiance), std::pair("rest_harmonics", &report.rest.harmonics)})
    layers.push_back({name, {"R", "G", "B"}, image->data, true});
  return encodeExr(report.whole.radiance.width, report.whole.radiance.height, layers);
}

}  // namespace gobo::cli
