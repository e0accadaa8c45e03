// SPDX-License-Identifier: Apache-2.0
// Command line of shadow_bench, common to its subcommands.
#pragma once

#include <memory>
#include <string>

#include "shadow/runner.h"
#include "shadow/scenes.h"
#include "shadow/truth.h"

namespace gobo::shadowbench {

struct Options {
  std::string scene = "fence", light = "sun", camera = "front";
  int width = 0, height = 0;  ///< 0: the subcommand's default
  bool soft = false;          ///< an area light as it is; else its centre
  int truth = 0;              ///< rays a pixel of the truth; 0: the subcommand's default
  int repeat = 3;
  int temporal = 0;                 ///< camera places for the temporal variance; 0: none
  int map = 1024, denseMap = 4096;  ///< ladder: S, and the map of R2
  Runner::Clock clock = Runner::Clock::Wall;
  double sun = 0;          ///< filtered: the scene's sun, this many degrees wide, in the place of its area light
  bool cameraFit = false;  ///< maps fitted to what the camera sees (map.fit = CAMERA)
  bool quick = false, list = false;
  std::string out = "out/bench";
  std::string only;  ///< claims, pareto: techniques or claims whose name contains it
};

/// Scene, light and camera of the options; the light made hard unless `soft`.
Result<std::unique_ptr<Runner>> makeRunner(const Options& o, bool soft);
std::string baseName(const Options& o);  ///< "fence-sun-front"

int pareto(Options o);
int filtered(Options o);
int modes(Options o);
int table31(Options o);
int ladder(Options o);
int claims(Options o);
int regret(Options o);
int costs(Options o);
int scenes(Options o);
int sheared(Options o);

}  // namespace gobo::shadowbench
