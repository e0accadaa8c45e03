// SPDX-License-Identifier: Apache-2.0
// Clear sky of A. J. Preetham, P. Shirley, B. Smits, "A Practical Analytic Model for Daylight" (SIGGRAPH 1999): Perez
// distribution (eq. 3) times zenith luminance and chromaticity (appendix A.2), and a sun attenuated by Rayleigh and aerosol
// scattering (appendix A.1). 10 kcd/m^2 become radiance 1, which makes the zenith of order 1 at usual sun heights.
// The sun's energy does not depend on the resolution: the disk is cut into equal pieces and each piece's flux is spread over
// the solid angle of the texel it falls into, so that the map integrates to the same irradiance even where the disk is
// smaller than a texel. Below the horizon: groundAlbedo lit by sky and sun.
#include <algorithm>
#include <numbers>

#include "base/check.h"
#include "scene/environment.h"
#include "scene/environment_tents.h"

namespace gobo {
inline namespace scene {
namespace {

constexpr double kScale = 0.1;             // radiance per kcd/m^2
constexpr double kSunIlluminance = 133.1;  // klx outside the atmosphere: 128 klx luminous solar constant to 133; same unit as kcd/m^2 x sr

struct Perez {
  double a, b, c, d, e;
  /// The factors: of the height, which a row of the map has in common, and of the angle to the sun.
  double height(double cosTheta) const { return 1 + a * std::exp(b / std::max(cosTheta, 0.01)); }
  double aroundSun(double gamma, double cosGamma) const { return 1 + c * std::exp(d * gamma) + e * cosGamma * cosGamma; }
  double operator()(double cosTheta, double gamma, double cosGamma) const { return height(cosTheta) * aroundSun(gamma, cosGamma); }
};

double zenithChromaticity(const double (&m)[3][4], double t, double s) {
  const double sun[4] = {s * s * s, s * s, s, 1}, turbidity[3] = {t * t, t, 1};
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 4; ++k) sum += turbidity[i] * m[i][k] * sun[k];
  return sum;
}

DVec3 xyYToRgb(double x, double y, double Y) {
  const double X = x / y * Y, Z = (1 - x - y) / y * Y;
  return glm::max(
      DVec3(3.2404542 * X - 1.5371385 * Y - 0.4985314 * Z, -0.9692660 * X + 1.8760108 * Y + 0.0415560 * Z, 0.0556434 * X - 0.2040259 * Y + 1.0572252 * Z),
      DVec3(0.0));
}

/// Irradiance of the sun on a plane facing it, per channel (at 680, 550, 440 nm), sunScale not applied.
DVec3 sunIrradiance(double thetaS, double turbidity) {
  const double degrees = thetaS * 180 / std::numbers::pi;
  const double mass = 1.0 / (std::cos(thetaS) + 0.15 * std::pow(std::max(93.885 - degrees, 0.1), -1.253));
  const double beta = std::max(0.04608365822050 * turbidity - 0.04586025928522, 0.0);
  const double micrometres[3] = {0.68, 0.55, 0.44};
  DVec3 e;
  for (int i = 0; i < 3; ++i)
    e[i] = kScale * kSunIlluminance * std::exp(-mass * (0.008735 * std::pow(micrometres[i], -4.08) + beta * std::pow(micrometres[i], -1.3)));
  return e;
}

}  // namespace

EnvironmentPtr skyEnvironment(const SkyParameters& parameters, int width, const StopToken& stop) {
  GOBO_CHECK_GT(width, 1);
  const int height = std::max(width / 2, 1);
  const double length = glm::length(DVec3(parameters.sunDirection));
  const DVec3 sun = length > 0 ? DVec3(parameters.sunDirection) / length : DVec3(0, 1, 0);
  const double T = std::clamp(double(parameters.turbidity), 1.7, 10.0);  // the fit's range
  const double thetaS = std::min(std::acos(std::clamp(sun.y, -1.0, 1.0)), 0.5 * std::numbers::pi - 1e-3), cosS = std::cos(thetaS);

  const Perez Y{0.1787 * T - 1.4630, -0.3554 * T + 0.4275, -0.0227 * T + 5.3251, 0.1206 * T - 2.5771, -0.0670 * T + 0.3703};
  const Perez x{-0.0193 * T - 0.2592, -0.0665 * T + 0.0008, -0.0004 * T + 0.2125, -0.0641 * T - 0.8989, -0.0033 * T + 0.0452};
  const Perez y{-0.0167 * T - 0.2608, -0.0950 * T + 0.0092, -0.0079 * T + 0.2102, -0.0441 * T - 1.6537, -0.0109 * T + 0.0529};
  constexpr double mx[3][4] = {{0.00166, -0.00375, 0.00209, 0}, {-0.02903, 0.06377, -0.03202, 0.00394}, {0.11693, -0.21196, 0.06052, 0.25886}};
  constexpr double my[3][4] = {{0.00275, -0.00610, 0.00317, 0}, {-0.04214, 0.08970, -0.04153, 0.00516}, {0.15346, -0.26756, 0.06670, 0.26688}};
  const double chi = (4.0 / 9 - T / 120) * (std::numbers::pi - 2 * thetaS);
  const double Yz = std::max((4.0453 * T - 4.9710) * std::tan(chi) - 0.2155 * T + 2.4192, 0.05);
  const double xz = zenithChromaticity(mx, T, thetaS), yz = zenithChromaticity(my, T, thetaS);
  const double normY = Y(1, thetaS, cosS), normX = x(1, thetaS, cosS), normYc = y(1, thetaS, cosS);

  std::vector<DVec3> texels(size_t(width) * height, DVec3(0.0));
  auto solidAngle = [&](int row) {
    return 2 * std::numbers::pi / width * (std::cos(std::numbers::pi * row / height) - std::cos(std::numbers::pi * (row + 1) / height));
  };
  DVec3 horizontal(0.0);  // irradiance of sky and sun on the ground
  const int horizon = height / 2;
  std::vector<glm::dvec2> columns(size_t(width), glm::dvec2(0.0));  // cosine and sine of the azimuth
  for (int i = 0; i < width; ++i) {
    const double azimuth = ((i + 0.5) / width - 0.5) * 2 * std::numbers::pi;
    columns[size_t(i)] = {std::cos(azimuth), std::sin(azimuth)};
  }
  for (int j = 0; j < horizon; ++j) {
    if (stop.stopRequested()) return nullptr;
    const double polar = std::numbers::pi * (j + 0.5) / height, cosTheta = std::cos(polar), sinTheta = std::sin(polar);
    const double rowX = x.height(cosTheta), rowY = y.height(cosTheta), rowLuminance = Y.height(cosTheta), weight = solidAngle(j) * cosTheta;
    for (int i = 0; i < width; ++i) {
      const DVec3 d(sinTheta * columns[size_t(i)].x, cosTheta, sinTheta * columns[size_t(i)].y);
      // Angle to the sun that is used for its height, so that a sun below the horizon still gives a dusk sky.
      const double cosGamma = std::clamp(glm::dot(d, sun), -1.0, 1.0), gamma = std::acos(cosGamma);
      const DVec3 rgb = xyYToRgb(xz * (rowX * x.aroundSun(gamma, cosGamma)) / normX, yz * (rowY * y.aroundSun(gamma, cosGamma)) / normYc,
                                 kScale * Yz * (rowLuminance * Y.aroundSun(gamma, cosGamma)) / normY);
      texels[size_t(j) * width + i] = rgb;
      horizontal += rgb * weight;
    }
  }
  const double radius = std::max(double(parameters.sunRadiusDeg), 1e-3) * std::numbers::pi / 180;
  if (sun.y > 0 && parameters.sunScale > 0) {
    const DVec3 energy = sunIrradiance(thetaS, T) * double(parameters.sunScale);
    horizontal += energy * sun.y;
    const DVec3 u = glm::normalize(glm::cross(std::abs(sun.y) < 0.99 ? DVec3(0, 1, 0) : DVec3(1, 0, 0), sun)), v = glm::cross(sun, u);
    const EnvironmentTents tents(width, height);  // what a texel sends once it is looked up bilinearly
    constexpr int rings = 64, sectors = 128;      // pieces of equal solid angle on the cap
    for (int r = 0; r < rings && !stop.stopRequested(); ++r)
      for (int s = 0; s < sectors; ++s) {
        const double cosA = 1 - (r + 0.5) / rings * (1 - std::cos(radius)), sinA = std::sqrt(std::max(1 - cosA * cosA, 0.0));
        const double a = 2 * std::numbers::pi * (s + 0.5 * (r & 1)) / sectors;
        const DVec3 d = sun * cosA + (u * std::cos(a) + v * std::sin(a)) * sinA;
        double tu = 0.5 + std::atan2(d.z, d.x) / (2 * std::numbers::pi);
        tu -= std::floor(tu);
        const int i = std::min(int(tu * width), width - 1);
        const int j = std::clamp(int(std::acos(std::clamp(d.y, -1.0, 1.0)) / std::numbers::pi * height), 0, height - 1);
        texels[size_t(j) * width + i] += energy / (double(rings * sectors) * tents.weight(j));
      }
  }
  const DVec3 ground = DVec3(parameters.groundAlbedo) * horizontal / std::numbers::pi;
  for (int j = horizon; j < height; ++j)
    for (int i = 0; i < width; ++i) texels[size_t(j) * width + i] += ground;

  Image image(width, height, 3);
  for (size_t k = 0; k < texels.size(); ++k)
    for (int c = 0; c < 3; ++c) image.data[k * 3 + c] = float(texels[k][c]);
  return makeEnvironment("sky", std::move(image), stop);
}

}  // namespace scene
}  // namespace gobo
