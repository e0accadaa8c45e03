// SPDX-License-Identifier: Apache-2.0
// Shadows: speed against error, where the error comes from, and the thesis's claims (T. Annen, "Efficient Shadow Map Filtering", 2008).
//
//   shadow_bench scenes [--list]
//       The scenes that the others are run on, their triangles, and ray-traced truth against closed forms where there is one.
//       --list: only name, hard light, soft light and camera, a line each (bench/run).
//   shadow_bench pareto SCENE LIGHT CAMERA [--soft] [--size 512x384] [--truth 1024] [--temporal 64] [--repeat 3] [--quick] [--only TEXT]
//       Every technique and its main parameter: milliseconds by pass, bytes in light space, RMSE against ray-traced truth (main: hard shadows
//       against the pixel's area, soft ones against its centre; the other beside it), RMSE in the penumbra, false lit and dark area,
//       temporal variance over cameras shifted inside the pixel. Table, CSV, JSON and a plot; the Pareto front by name. Without --soft an
//       area light casts from its centre. The rivals are in it: rays (hard: view samples of one ray, soft: rays at the centre), rays with
//       a joint bilateral filter, axis-aligned filtering.
//   shadow_bench ladder SCENE LIGHT CAMERA [--soft] [--size 256x192] [--truth 4096] [--map 1024] [--dense-map 4096]
//       Oracle ladder: which step adds which error. Camera, visibility factoring, the map's model at high and at the map's resolution,
//       the basis in float64 with the same kernel, what ships, a Vulkan device.
//   shadow_bench filtered [--only SCENE] [--size 256x256] [--truth 2048] [--repeat 3] [--quick] [--sun DEGREES]
//       Soft shadows of every scene: axis-aligned filtering (default and published), joint bilateral filters and plain rays, three seeds each; rays
//       and milliseconds that plain rays need at equal RMSE. --sun: of the scenes' suns, made that wide, instead of their area lights.
//   shadow_bench modes [--only SCENE] [--size 256x256] [--truth 1024] [--repeat 3] [--quick]
//       The published filter and its released code taken apart by name (filters/axis_aligned/literal.h) on grids, fence and sponza: rays,
//       milliseconds and RMSE of every mode, and whether errors come in the order that the digest of the source expects.
//   shadow_bench table31 [--only SCENE] [--size 640x480] [--truth 1024] [--repeat 3] [--quick]
//       The source's table 3.1 and figure 3.6 in their own columns, beside the printed numbers; the figure as CSV.
//   shadow_bench sheared [--only SCENE] [--size 256x256] [--truth 2048] [--repeat 3] [--quick]
//       The successors of axis-aligned filtering beside it and plain rays: sheared, and multiple axis-aligned filters; seeds 11 to 13, --quick 1 and 2.
//   shadow_bench claims [--only NAME] [--quick]
//       The source's claims as ratios measured in one run, asked figures beside them: esm-csm, pcf-taps, flagged, bleeding, penumbra, lights.
//   shadow_bench regret [--only SCENE] [--size 640x480] [--truth 512] [--quick]
//       shadows.auto against the whole sweep: time of its choice, with the probe and with it remembered, over the best time at equal error of what a request
//       can name, per scene and budget; beside it the time of bilaterally filtered rays, which none can.
//   shadow_bench costs [--only SCENE] [--size 640x480] [--truth 512] [--repeat 3]
//       Predicted time and error of every candidate of shadows.auto beside the measured ones, on the scenes that it is tuned on.
//   Common: --clock wall|cpu (cpu: of all threads; other programs then disturb less), --out FOLDER (out/bench), --fit scene|camera
//   (map.fit of every map). Truths are kept in FOLDER/truth and computed once (minutes); delete them freely.
//   Errors count only surfaces that the light can shine on.
#include <cstdio>
#include <cstring>

#include "measure/report.h"
#include "shadow/options.h"

using namespace gobo;
using namespace gobo::shadowbench;

namespace gobo::shadowbench {

Result<std::unique_ptr<Runner>> makeRunner(const Options& o, bool soft) {
  GOBO_ASSIGN(ScenePtr scene, benchScene(o.scene));
  const int light = scene->findLight(o.light), camera = scene->findCamera(o.camera);
  if (light < 0 || camera < 0) {
    std::string names;
    for (const Light& l : scene->lights) names += " " + l.name;
    names += "; cameras:";
    for (const Camera& c : scene->cameras) names += " " + c.name;
    return invalidArgument("scene '" + o.scene + "' has no light '" + o.light + "' or camera '" + o.camera + "'; lights:" + names);
  }
  if (!soft) { GOBO_ASSIGN(scene, withHardLight(*scene, light)); }
  if (o.sun > 0) { GOBO_ASSIGN(scene, withSunSize(*scene, light, o.sun)); }
  auto runner = std::make_unique<Runner>(scene, light, scene->cameras[size_t(camera)], o.width, o.height, o.repeat, o.clock);
  runner->setCameraFit(o.cameraFit);
  return runner;
}

std::string baseName(const Options& o) {
  std::string s = o.scene;
  if (const size_t slash = s.rfind('/'); slash != std::string::npos) s = s.substr(slash + 1);
  if (const size_t dot = s.rfind('.'); dot != std::string::npos) s = s.substr(0, dot);
  return s + "-" + o.light + "-" + o.camera;
}

}  // namespace gobo::shadowbench

int main(int argc, char** argv) {
  Options o;
  const std::string command = argc > 1 ? argv[1] : "";
  int at = 2;
  if (command == "pareto" || command == "ladder") {
    if (argc < 5 || argv[2][0] == '-') {
      std::fprintf(stderr, "shadow_bench %s SCENE LIGHT CAMERA ...; `shadow_bench scenes` lists them\n", command.c_str());
      return 2;
    }
    o.scene = argv[2];
    o.light = argv[3];
    o.camera = argv[4];
    at = 5;
  }
  for (; at < argc; ++at) {
    const std::string flag = argv[at];
    const char* value = at + 1 < argc ? argv[at + 1] : nullptr;
    if (flag == "--soft") {
      o.soft = true;
      continue;
    }
    if (flag == "--list") {
      o.list = true;
      continue;
    }
    if (flag == "--quick") {
      o.quick = true;
      continue;
    }
    if (!value) {
      std::fprintf(stderr, "%s needs a value\n", flag.c_str());
      return 2;
    }
    ++at;
    const int number = std::atoi(value);
    if (flag == "--size") {
      if (std::sscanf(value, "%dx%d", &o.width, &o.height) != 2 || o.width < 16 || o.height < 16) {
        std::fprintf(stderr, "--size %s: not WxH of at least 16x16\n", value);
        return 2;
      }
    } else if (flag == "--truth") o.truth = std::max(number, 2);
    else if (flag == "--repeat") o.repeat = std::max(number, 1);
    else if (flag == "--temporal") o.temporal = number;
    else if (flag == "--map") o.map = std::max(number, 1);
    else if (flag == "--dense-map") o.denseMap = std::max(number, 1);
    else if (flag == "--clock") o.clock = std::strcmp(value, "cpu") ? Runner::Clock::Wall : Runner::Clock::Cpu;
    else if (flag == "--fit") o.cameraFit = !std::strcmp(value, "camera");
    else if (flag == "--out") o.out = value;
    else if (flag == "--sun") o.sun = std::atof(value);
    else if (flag == "--only") o.only = value;
    else {
      std::fprintf(stderr, "unknown option %s\n", flag.c_str());
      return 2;
    }
  }
  if (command == "pareto") return pareto(o);
  if (command == "filtered") return filtered(o);
  if (command == "modes") return modes(o);
  if (command == "table31") return table31(o);
  if (command == "ladder") return ladder(o);
  if (command == "claims") return claims(o);
  if (command == "regret") return regret(o);
  if (command == "costs") return costs(o);
  if (command == "scenes") return scenes(o);
  if (command == "sheared") return sheared(o);
  std::fprintf(
      stderr,
      "shadow_bench scenes | pareto SCENE LIGHT CAMERA | ladder SCENE LIGHT CAMERA | filtered | modes | table31 | claims | regret | costs   (the head of "
      "bench/shadow_bench.cpp "
      "has the options)\n");
  return 2;
}
