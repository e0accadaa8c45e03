// SPDX-License-Identifier: Apache-2.0
#include "scene/environment_cube.h"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "base/check.h"

namespace gobo {
inline namespace scene {
namespace {

enum Face { Right, Left, Top, Bottom, Front, Back };

struct Cell {
  int x, y;
  bool turned;
};
Cell cellOf(CubeLayout layout, Face face) {
  static constexpr Cell horizontal[6] = {{2, 1, false}, {0, 1, false}, {1, 0, false}, {1, 2, false}, {1, 1, false}, {3, 1, false}};
  static constexpr Cell vertical[6] = {{2, 1, false}, {0, 1, false}, {1, 0, false}, {1, 2, false}, {1, 1, false}, {1, 3, true}};
  switch (layout) {
    case CubeLayout::HorizontalCross: return horizontal[face];
    case CubeLayout::VerticalCross: return vertical[face];
    case CubeLayout::HorizontalStrip: return {int(face), 0, false};
    default: return {0, int(face), false};
  }
}

int faceSize(const Image& image, CubeLayout layout) {
  switch (layout) {
    case CubeLayout::HorizontalCross: return image.width / 4;
    case CubeLayout::VerticalCross: return image.width / 3;
    case CubeLayout::HorizontalStrip: return image.height;
    default: return image.width;
  }
}

}  // namespace

ExrEnvironmentKind exrEnvironmentKind(const uint8_t* bytes, size_t size) {
  static constexpr uint8_t magic[4] = {0x76, 0x2f, 0x31, 0x01};
  if (size < 8 || std::memcmp(bytes, magic, 4) != 0) return ExrEnvironmentKind::None;
  size_t at = 8;
  const auto text = [&](std::string_view& out) {
    const void* end = at < size ? std::memchr(bytes + at, 0, std::min<size_t>(size - at, 256)) : nullptr;
    if (!end) return false;
    out = {reinterpret_cast<const char*>(bytes + at), size_t(static_cast<const uint8_t*>(end) - (bytes + at))};
    at += out.size() + 1;
    return true;
  };
  std::string_view name, type;
  while (text(name) && !name.empty() && text(type) && size - at >= 4) {
    uint32_t length;
    std::memcpy(&length, bytes + at, 4);
    at += 4;
    if (length > size - at) break;
    if (name == "envmap" && type == "envmap" && length == 1)
      return bytes[at] == 0 ? ExrEnvironmentKind::LatLong : bytes[at] == 1 ? ExrEnvironmentKind::Cube : ExrEnvironmentKind::None;
    at += length;
  }
  return ExrEnvironmentKind::None;
}

CubeLayout cubeLayout(const Image& image, ExrEnvironmentKind kind) {
  const int64_t w = image.width, h = image.height;
  if (kind == ExrEnvironmentKind::LatLong) return CubeLayout::None;
  if (kind == ExrEnvironmentKind::Cube) return h == 6 * w ? CubeLayout::ExrCube : CubeLayout::None;
  if (w % 4 == 0 && 3 * w == 4 * h) return CubeLayout::HorizontalCross;
  if (w % 3 == 0 && 4 * w == 3 * h) return CubeLayout::VerticalCross;
  if (w == 6 * h) return CubeLayout::HorizontalStrip;
  if (h == 6 * w) return CubeLayout::VerticalStrip;
  return CubeLayout::None;
}

Vec2 cubePosition(CubeLayout layout, int n, const Vec3& d, Vec2& faceMin) {
  const float ax = std::fabs(d.x), ay = std::fabs(d.y), az = std::fabs(d.z);
  if (layout == CubeLayout::ExrCube) {
    // OpenEXR's frame: front is +Z and right is -X. ImfEnvmap: the outermost pixel centres lie on the cube's edges.
    const float x = -d.x, y = d.y, z = d.z, last = float(n - 1);
    const auto unit = [&](float v, float major) { return (v / major + 1.0f) * 0.5f * last; };
    Vec2 p;
    int face;
    if (ax >= ay && ax >= az) {
      const Vec2 in(unit(y, ax), unit(z, ax));
      face = x > 0 ? 0 : 1;
      p = face == 0 ? Vec2(in.y, last - in.x) : Vec2(last - in.y, last - in.x);
    } else if (ay >= az) {
      const Vec2 in(unit(x, ay), unit(z, ay));
      face = y > 0 ? 2 : 3;
      p = face == 2 ? Vec2(in.x, last - in.y) : Vec2(in.x, in.y);
    } else {
      const Vec2 in(unit(x, az), unit(y, az));
      face = z > 0 ? 4 : 5;
      p = face == 4 ? Vec2(last - in.x, last - in.y) : Vec2(in.x, last - in.y);
    }
    faceMin = Vec2(0, float(face * n));
    return faceMin + p + 0.5f;
  }
  // OpenGL 4.6, table 8.19.
  Face face;
  float s, t, major;
  if (ax >= ay && ax >= az) {
    face = d.x > 0 ? Right : Left;
    s = d.x > 0 ? -d.z : d.z;
    t = -d.y;
    major = ax;
  } else if (ay >= az) {
    face = d.y > 0 ? Top : Bottom;
    s = d.x;
    t = d.y > 0 ? d.z : -d.z;
    major = ay;
  } else {
    face = d.z > 0 ? Front : Back;
    s = d.z > 0 ? d.x : -d.x;
    t = -d.y;
    major = az;
  }
  const Cell cell = cellOf(layout, face);
  if (cell.turned) {
    s = -s;
    t = -t;
  }
  faceMin = Vec2(float(cell.x * n), float(cell.y * n));
  return faceMin + Vec2((s / major + 1.0f) * 0.5f * float(n), (t / major + 1.0f) * 0.5f * float(n));
}

Image latLongFromCube(const Image& cube, CubeLayout layout, const StopToken& stop) {
  const int n = faceSize(cube, layout);
  GOBO_CHECK(n > 0 && layout != CubeLayout::None);
  const int width = std::min(4 * n, 8192), height = width / 2;
  const int grid = 3 * ((4 * n + width - 1) / width);
  Image out(width, height, 3);
  out.names = {"R", "G", "B"};
  const auto lookUp = [&](const Vec3& d) {
    Vec2 lo;
    const Vec2 p = cubePosition(layout, n, d, lo) - lo - 0.5f;
    const float fx = std::clamp(p.x, 0.0f, float(n - 1)), fy = std::clamp(p.y, 0.0f, float(n - 1));
    const int x0 = std::min(int(fx), n - 1), y0 = std::min(int(fy), n - 1), x1 = std::min(x0 + 1, n - 1), y1 = std::min(y0 + 1, n - 1);
    const float a = fx - float(x0), b = fy - float(y0);
    const int ox = int(lo.x), oy = int(lo.y);
    // A weight of 0 must not bring in a texel that is not finite: makeEnvironment counts and repairs those.
    const auto part = [&](int x, int y, float w) { return w > 0.0f ? cube.rgb(ox + x, oy + y) * w : Vec3(0.0f); };
    return part(x0, y0, (1 - a) * (1 - b)) + part(x1, y0, a * (1 - b)) + part(x0, y1, (1 - a) * b) + part(x1, y1, a * b);
  };
  const double pi = 3.14159265358979323846;
  for (int y = 0; y < height && !stop.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) {
      DVec3 sum(0.0);
      for (int j = 0; j < grid; ++j)
        for (int i = 0; i < grid; ++i) {
          const double azimuth = 2 * pi * ((x + (i + 0.5) / grid) / width - 0.5), latitude = pi * (0.5 - (y + (j + 0.5) / grid) / height);
          const double c = std::cos(latitude);
          sum += DVec3(lookUp(Vec3(float(std::sin(azimuth) * c), float(std::sin(latitude)), float(std::cos(azimuth) * c))));
        }
      for (int k = 0; k < 3; ++k) out.at(x, y)[k] = float(sum[k] / (double(grid) * grid));
    }
  return out;
}

}  // namespace scene
}  // namespace gobo
