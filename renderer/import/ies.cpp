// SPDX-License-Identifier: Apache-2.0
#include "import/ies.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <numbers>
#include <vector>

#include "base/utf8.h"

namespace gobo {
inline namespace imports {
namespace {

/// Angles of a whole turn, in degrees, and which column of the file each has.
using Turn = std::map<double, size_t>;

/// Numbers behind the TILT line, separated by blanks, line ends or commas.
class IesNumbers {
 public:
  IesNumbers(std::string_view text, size_t line) : text_(text), line_(line) {}
  Status problem;

  /// Where the problem is said of: "name" or "name i".
  double next(const char* name, size_t index = SIZE_MAX) {
    while (at_ < text_.size() && (std::isspace(uint8_t(text_[at_])) || text_[at_] == ',')) line_ += text_[at_++] == '\n';
    size_t end = at_;
    while (end < text_.size() && !std::isspace(uint8_t(text_[end])) && text_[end] != ',') ++end;
    std::string_view word = text_.substr(at_, end - at_);
    at_ = end;
    if (word.empty()) {
      fail(name, index, "is missing: the file ends");
      return 0;
    }
    if (word[0] == '+') word.remove_prefix(1);
    double value = 0;
    const auto read = std::from_chars(word.data(), word.data() + word.size(), value);
    if (read.ec != std::errc() || read.ptr != word.data() + word.size() || !std::isfinite(value)) {
      fail(name, index, "\"" + cleanUtf8(std::string(word.substr(0, 40))) + "\" is not a finite number");
      return 0;
    }
    return value;
  }
  size_t count(const char* name, size_t lo, size_t hi) {
    const double n = next(name);
    if (problem.ok() && !(n >= double(lo) && n <= double(hi) && n == std::floor(n)))
      fail(name, SIZE_MAX, shown(n) + " is not a whole number within " + std::to_string(lo) + " .. " + std::to_string(hi));
    return problem.ok() ? size_t(n) : lo;
  }
  double positive(const char* name) {
    const double v = next(name);
    if (problem.ok() && !(v >= 0.0 && v <= 1e12)) fail(name, SIZE_MAX, shown(v) + " is not within 0 .. 1e12");
    return v;
  }
  void fail(const char* name, size_t index, const std::string& what) {
    if (problem.ok())
      problem = invalidArgument("line " + std::to_string(line_) + ": " + name + (index == SIZE_MAX ? "" : " " + std::to_string(index)) + ": " + what);
  }
  static std::string shown(double v) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", v);
    return text;
  }

 private:
  std::string_view text_;
  size_t at_ = 0, line_;
};

std::vector<double> readAngles(IesNumbers& in, const char* name, size_t n, double most) {
  std::vector<double> out(n);
  for (size_t i = 0; i < n && in.problem.ok(); ++i) {
    out[i] = in.next(name, i);
    if (in.problem.ok() && !(out[i] >= 0.0 && out[i] <= most)) in.fail(name, i, IesNumbers::shown(out[i]) + " is not within 0 .. " + IesNumbers::shown(most));
    if (in.problem.ok() && i > 0 && !(out[i] > out[i - 1])) in.fail(name, i, IesNumbers::shown(out[i]) + " is not above the one before it");
  }
  return out;
}

/// Mirrors what the file leaves out. False: the angles stop where no symmetry does.
bool wholeTurn(const std::vector<double>& angles, Turn& out) {
  const double first = angles.front(), last = angles.back();
  for (size_t i = 0; i < angles.size(); ++i) out.emplace(angles[i] == 360.0 ? 360.0 : angles[i], i);
  const auto mirror = [&](double sum) {
    for (size_t i = 0; i < angles.size(); ++i) out.emplace(std::fmod(sum - angles[i] + 360.0, 360.0), i);
  };
  if (first == 0.0 && last == 90.0) {
    mirror(180.0);
    const Turn half = out;
    for (const auto& [angle, column] : half) out.emplace(std::fmod(360.0 - angle, 360.0), column);
  } else if (first == 0.0 && last == 180.0) {
    mirror(360.0);
  } else if (first == 90.0 && last == 270.0) {
    mirror(180.0);
  } else if (first != 0.0 || last <= 180.0) {
    return false;
  }
  return true;
}

}  // namespace

Result<IesPhotometry> readIes(std::string_view text, const std::string& name) {
  // Keywords and labels of any kind stand before TILT=, the first thing that all versions have.
  size_t at = 0, line = 1;
  std::string_view tilt;
  for (; at < text.size() && tilt.empty(); ++line) {
    size_t end = std::min(text.find('\n', at), text.size());
    std::string_view row = text.substr(at, end - at);
    at = std::min(end + 1, text.size());
    if (row.substr(0, 5) == "TILT=") tilt = row;
  }
  if (tilt.empty()) return invalidArgument("there is no line TILT=: this is no IES LM-63 file");
  tilt.remove_prefix(5);
  while (!tilt.empty() && std::isspace(uint8_t(tilt.back()))) tilt.remove_suffix(1);
  IesNumbers in(text.substr(at), line);
  if (tilt == "INCLUDE") {
    in.next("lamp to luminaire geometry");
    const size_t pairs = in.count("number of tilt angles", 0, 10000);
    for (size_t i = 0; i < 2 * pairs && in.problem.ok(); ++i) in.next("tilt table", i);
  } else if (tilt != "NONE") {
    return invalidArgument("TILT=" + cleanUtf8(std::string(tilt.substr(0, 60))) + ": only NONE and INCLUDE are read");
  }
  in.next("number of lamps");
  in.next("lumens per lamp");
  double scale = in.positive("candela multiplier");
  const size_t rows = in.count("number of vertical angles", 2, size_t(kLargestProfileSide)),
               columns = in.count("number of horizontal angles", 1, kLargestProfileSide);
  const size_t type = in.count("photometric type", 1, 3);
  if (in.problem.ok() && type != 1) in.fail("photometric type", SIZE_MAX, std::to_string(type) + (type == 2 ? " (B)" : " (A)") + " is not read; type C is 1");
  in.count("units type", 1, 2);
  for (const char* size : {"width", "length", "height"}) in.next(size);
  scale *= in.positive("ballast factor");
  // Files from LM-63-2019 on, which call themselves IES and no longer IESNA, have here a code of how they came about (1.00001, 1.1 ...).
  if (text.substr(text.starts_with("\xef\xbb\xbf") ? 3 : 0).starts_with("IES:LM-63-")) in.next("file generation type");
  else scale *= in.positive("ballast-lamp photometric factor");
  in.next("input watts");
  if (!in.problem.ok()) return in.problem;
  const std::vector<double> vertical = readAngles(in, "vertical angle", rows, 180.0), horizontal = readAngles(in, "horizontal angle", columns, 360.0);
  if (!in.problem.ok()) return in.problem;
  Turn turn;
  if (columns == 1) {
    if (horizontal[0] != 0.0) in.fail("horizontal angle", 0, IesNumbers::shown(horizontal[0]) + " is the only one and not 0");
  } else if (!wholeTurn(horizontal, turn)) {
    in.fail("horizontal angle", columns - 1,
            "angles from " + IesNumbers::shown(horizontal.front()) + " to " + IesNumbers::shown(horizontal.back()) +
                " are not 0, 0 .. 90, 0 .. 180, 90 .. 270 or a whole turn");
  }
  if (!in.problem.ok()) return in.problem;
  std::vector<double> candela(rows * columns);  // vertical angles of one horizontal angle after those of another
  double most = 0;
  for (size_t i = 0; i < candela.size() && in.problem.ok(); ++i) {
    candela[i] = in.positive("candela value");
    most = std::max(most, candela[i]);
  }
  if (!in.problem.ok()) return in.problem;

  auto profile = std::make_shared<LightProfile>();
  profile->name = cleanUtf8(name);
  profile->kind = ProfileKind::Photometry;
  const double radian = std::numbers::pi / 180;
  std::vector<float> down, round{0.0f};
  for (const double v : vertical) down.push_back(float(v * radian));
  std::vector<std::vector<double>> table;  // by angle of the turn
  const auto column = [&](size_t c) {
    return std::vector<double>(candela.begin() + std::ptrdiff_t(c * rows), candela.begin() + std::ptrdiff_t((c + 1) * rows));
  };
  if (columns == 1) {
    table = {column(0)};
  } else {
    if (turn.begin()->first > 0.0) {  // the seam lies between two angles
      const auto [after, b] = *turn.begin();
      const auto [before, a] = *turn.rbegin();
      const double t = (360.0 - before) / (after + 360.0 - before);
      std::vector<double> seam = column(a);
      for (size_t i = 0; i < rows; ++i) seam[i] += t * (column(b)[i] - seam[i]);
      table.push_back(seam);
    }
    for (const auto& [angle, c] : turn) {
      if (angle > 0.0) round.push_back(float(angle * radian));
      table.push_back(column(c));
    }
    if (turn.rbegin()->first < 360.0) {
      round.push_back(float(2.0 * std::numbers::pi));
      table.push_back(table.front());
    } else {
      round.back() = float(2.0 * std::numbers::pi);
    }
  }
  if (table.size() > size_t(kLargestProfileSide)) return invalidArgument("horizontal angles: a turn of " + std::to_string(table.size()) + " is too fine");
  std::vector<Vec3> values;
  values.reserve(rows * table.size());
  for (size_t v = 0; v < rows; ++v)
    for (const auto& c : table) values.emplace_back(most > 0.0 ? float(c[v] / most) : 0.0f);
  profile->width = int(table.size());
  profile->height = int(rows);
  profile->values = std::move(values);
  profile->vertical = std::move(down);
  profile->horizontal = std::move(round);
  GOBO_TRY(sealProfile(*profile));
  return IesPhotometry{std::move(profile), most * scale};
}

}  // namespace imports
}  // namespace gobo
