// SPDX-License-Identifier: Apache-2.0
// The table of the source's evaluation (DeCoro's thesis, 4.6) with scenes and maps of one's own: for each scene under each map, additive and subtractive
// shadows by lights and resolution of the shadows, what they cost and how far they are off; and its model of time, fitted to the subtractive rows of each:
//   t = t_C + n_L (t_geom + t_px / r^2)
// CPU seconds stand where frames per second did; RMS twice, of 1 - exp(-x / mean), as the source's pictures may have been shown, and of light by its mean.
#pragma once

#include <array>

#include "direct_light.h"

namespace gobo::bench {

/// By least squares over rows of lights, resolution and seconds; nothing where they do not tell the three apart.
struct TimeModel {
  double c = 0, geometry = 0, pixels = 0, deviation = 0;

  explicit TimeModel(const std::vector<std::array<double, 3>>& rows) {
    double m[3][4] = {};
    for (const auto& [lights, r, seconds] : rows) {
      const double x[3] = {1, lights, lights / (r * r)};
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) m[i][j] += x[i] * x[j];
        m[i][3] += x[i] * seconds;
      }
    }
    for (int i = 0; i < 3; ++i) {  // Gauss, Jordan: positive definite, or singular
      if (!(m[i][i] > 1e-9)) return;
      for (int j = 0; j < 3; ++j) {
        if (j == i) continue;
        const double f = m[j][i] / m[i][i];
        for (int k = i; k < 4; ++k) m[j][k] -= f * m[i][k];
      }
    }
    c = m[0][3] / m[0][0], geometry = m[1][3] / m[1][1], pixels = m[2][3] / m[2][2];
    for (const auto& [lights, r, seconds] : rows) {
      const double wrong = c + lights * (geometry + pixels / (r * r)) - seconds;
      deviation += wrong * wrong / double(rows.size());
    }
    deviation = std::sqrt(deviation);
  }
};

/// `made(scene, map)`: a bench of that scene under that map alone. Prints as it goes.
template <class Made>
void table46(const std::vector<std::string>& scenes, const std::vector<std::string>& maps, const std::vector<std::string>& lights,
             const std::vector<std::string>& resolutions, const std::string& bright, const std::string& reference, Made&& made) {
  const auto name = [](const std::string& path) { return path.substr(path.find_last_of('/') + 1); };
  std::printf("| scene (map) | method | lights | shadow res | CPU s | Mrays | RMS | RMSE / mean |\n|---|---|---|---|---|---|---|---|\n");
  std::string fits = "\n| scene (map) | form | t_C, ms | t_geom, ms a light | t_px, ms a light at r = 1 | deviation, ms |\n|---|---|---|---|---|---|\n";
  for (const std::string& scene : scenes)
    for (const std::string& map : maps) {
      const Bench bench = made(scene, map);
      const Run a = bench.render({"halt.spp=" + reference, "seed=1001"}, "a"), b = bench.render({"halt.spp=" + reference, "seed=1002"}, "b");
      const Run albedo = bench.render({"halt.spp=1", "outputs=albedo"}, "albedo");
      const Errors errors(a.image, b.image, albedo.image);
      const std::string label = name(scene) + " (" + name(map) + ")";
      const auto row = [&](const std::string& method, const std::string& n, const std::string& share, const Run& run) {
        std::printf("| %s | %s | %s | %s | %.3f | %.3f | %.4f | %.4f |\n", label.c_str(), method.c_str(), n.c_str(), share.c_str(), run.seconds,
                    1e-6 * run.rays, errors.displayed(run.image), errors.relative(run.image));
        std::fflush(stdout);
      };
      for (const std::string& n : lights)
        row("additive", n, "1", bench.render({"environment.extract_lights=" + n, "shadows.ray_traced.samples=1", "halt.spp=1"}, "additive"));
      for (const std::string form : {"DIFFERENCE", "RATIO"}) {
        std::vector<std::array<double, 3>> rows;
        for (const std::string& n : lights)
          for (const std::string& r : resolutions) {
            const Run run = bench.render({"environment.subtractive.lights=" + n, "environment.subtractive.resolution=" + r,
                                          "environment.subtractive.form=" + form, "environment.subtractive.bright_lights=" + bright, "halt.spp=1"},
                                         form);
            const int side = std::atoi(r.c_str());
            row(form == "RATIO" ? "ratio" : "subtractive", n, side == 1 ? "1" : "1/" + std::to_string(side * side), run);
            rows.push_back({std::atof(n.c_str()), double(side), run.seconds});
          }
        const TimeModel t(rows);
        char text[256];
        std::snprintf(text, sizeof text, "| %s | %s | %.0f | %.2f | %.2f | %.0f |\n", label.c_str(), form == "RATIO" ? "ratio" : "subtractive", 1e3 * t.c,
                      1e3 * t.geometry, 1e3 * t.pixels, 1e3 * t.deviation);
        fits += text;
      }
      row("reference", std::string("path traced, 2 x ") + reference, "1", a);
    }
  std::printf("%s", fits.c_str());
}

}  // namespace gobo::bench
