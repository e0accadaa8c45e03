// SPDX-License-Identifier: Apache-2.0
// Line and scatter plots as pictures: speed against error and the like, beside the numbers. No font or plotting library.
// Pure functions; any thread.
#pragma once

#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {
inline namespace measure {

struct PlotPoint {
  double x = 0, y = 0;
  double low = 0, high = 0;  ///< an error bar from low to high in y, where high > low
};

struct PlotSeries {
  std::string name;  ///< in the legend; ASCII
  std::vector<PlotPoint> points;
  bool line = true, marks = true;
  bool gaps = false;  ///< a point that is left out interrupts the line
  double width = 2;   ///< of the line, pixels
};

struct Plot {
  std::string title, xLabel, yLabel;
  bool logX = true, logY = true;
  int width = 960, height = 600;   ///< pixels, at least 320 x 240 (CHECKed)
  std::vector<PlotSeries> series;  ///< colours and marks repeat after eight; every second eight has dashed lines
};

/// Display-referred linear RGB in 0..1. Points that are not finite, or not positive on a logarithmic axis, are left out; lines
/// join the points that are left, in their order (PlotSeries::gaps: only neighbours). A plot without points shows its axes from 1 to 10 (0 to 1 when linear).
Image drawPlot(const Plot& plot);
/// PNG, written atomically. Errors name the file.
Status writePlot(const Plot& plot, const std::string& path);

/// The values of labelled ticks that an axis from low to high gets (low < high; both positive when logarithmic).
std::vector<double> axisTicks(double low, double high, bool logarithmic);

}  // namespace measure
}  // namespace gobo
