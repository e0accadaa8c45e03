// SPDX-License-Identifier: Apache-2.0
// Directional lights in a map's place (environment.extract_lights) by each way of finding them: irradiance of planes of 26 normals (faces, edges and
// corners of a cube) without any shadow against the map's own, RMS over normals and channels by the mean, and CPU time of one thread.
// The map's irradiance is that of its texels at their centres: of maps of 256 columns and more within 1e-4 of the bilinear look-up's.
// Arguments: --env FILE,FILE,... --lights N,N,... --out PATH
#include <sys/resource.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <sstream>

#include "measure/report.h"
#include "terms/extract_lights.h"

using namespace gobo;

namespace {

double cpuSeconds() {
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

std::vector<std::string> parts(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string s; std::getline(in, s, ',');)
    if (!s.empty()) out.push_back(s);
  return out;
}

std::vector<DVec3> cubeNormals() {
  std::vector<DVec3> out;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x || y || z) out.push_back(glm::normalize(DVec3(x, y, z)));
  return out;
}

std::vector<DVec3> irradianceOf(const Environment& map) {
  const std::vector<DVec3> normals = cubeNormals();
  std::vector<DVec3> out(normals.size(), DVec3(0.0));
  const TexelCells texels(map, nullptr);
  for (size_t t = 0; t < map.texels.size(); ++t) {
    const DVec3 flux = texels.solidAngle(t) * DVec3(map.texels[t]), d = texels.direction(t);
    for (size_t i = 0; i < normals.size(); ++i) out[i] += flux * std::max(glm::dot(normals[i], d), 0.0);
  }
  return out;
}

double errorOf(const std::vector<MapLight>& lights, const std::vector<DVec3>& truth) {
  const std::vector<DVec3> normals = cubeNormals();
  double square = 0, mean = 0;
  for (size_t i = 0; i < normals.size(); ++i) {
    DVec3 sum(0.0);
    for (const MapLight& l : lights) sum += l.flux * std::max(glm::dot(normals[i], l.direction), 0.0);
    square += glm::dot(sum - truth[i], sum - truth[i]);
    mean += truth[i].x + truth[i].y + truth[i].z;
  }
  return std::sqrt(square * 3.0 * double(normals.size())) / mean;
}

}  // namespace

int main(int argc, char** argv) {
  Table table("Irradiance of planes by directional lights", {"map", "lights", "median cut", "structured", "wavelet", "ms", "ms", "ms"});
  for (const std::string& path : parts(argumentOr(argc, argv, "--env", ""))) {
    const Result<EnvironmentPtr> map = loadEnvironment(path);
    if (!map.ok()) {
      std::fprintf(stderr, "extract_bench: %s\n", map.status().toString().c_str());
      return 1;
    }
    const std::vector<DVec3> truth = irradianceOf(**map);
    for (const std::string& n : parts(argumentOr(argc, argv, "--lights", "1,4,16,64,256"))) {
      std::vector<Table::Cell> row, times;
      row.emplace_back(path.substr(path.find_last_of('/') + 1));
      row.emplace_back(std::atof(n.c_str()));
      for (const ExtractBy by : {ExtractBy::MedianCut, ExtractBy::Structured, ExtractBy::Wavelet}) {
        const double start = cpuSeconds();
        const std::vector<MapLight> lights = extractLights(**map, std::atoi(n.c_str()), by);
        times.emplace_back((cpuSeconds() - start) * 1e3);
        row.emplace_back(errorOf(lights, truth));
      }
      row.insert(row.end(), times.begin(), times.end());
      table.add(row);
    }
  }
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) {
    std::fprintf(stderr, "extract_bench: %s\n", s.toString().c_str());
    return 1;
  }
  return 0;
}
