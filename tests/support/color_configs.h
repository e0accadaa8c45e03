// SPDX-License-Identifier: Apache-2.0
// OpenColorIO configs whose views have closed forms, written into a folder.
#pragma once

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

namespace gobo::test {

/// What a config is made of beside the views that all have.
struct ColorConfigParts {
  std::string linear = "lin_rec709";  ///< name of the reference space
  std::string alias;                  ///< of it
  std::string roles = "  scene_linear: reference_name\n";
  std::string colorspaces;  ///< more of them
  std::string more;         ///< at the end
  float lutTop = 0.5f;      ///< where the file's curve takes 1
};

inline void writeText(const std::string& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

/// `folder`/config.ocio and `folder`/half.spi1d. Displays and views: Monitor (Power, Swapped, Log, sRGB, Graded, Half, Raw; Hidden is not active), Projector
/// (Cinema). Looks: doubled, warm.
inline std::string writeColorConfig(const std::string& folder, ColorConfigParts parts = {}) {
  const std::string path = folder + "/config.ocio";
  const size_t at = parts.roles.find("reference_name");
  if (at != std::string::npos) parts.roles.replace(at, 14, '"' + parts.linear + '"');
  const auto space = [](const std::string& name, const std::string& fromReference) {
    return "  - !<ColorSpace>\n    name: " + name + "\n    from_scene_reference: " + fromReference + "\n";
  };
  writeText(path, "ocio_profile_version: 2\nenvironment: {}\nsearch_path: .\nroles:\n  default: raw\n" + parts.roles +
                      "file_rules:\n  - !<Rule> {name: Default, colorspace: default}\n"
                      "displays:\n  Monitor:\n"
                      "    - !<View> {name: Hidden, colorspace: raw}\n"
                      "    - !<View> {name: Power, colorspace: power22}\n"
                      "    - !<View> {name: Swapped, colorspace: swapped}\n"
                      "    - !<View> {name: Log, colorspace: log}\n"
                      "    - !<View> {name: sRGB, colorspace: srgb}\n"
                      "    - !<View> {name: Graded, colorspace: power22, looks: doubled}\n"
                      "    - !<View> {name: Half, colorspace: half}\n"
                      "    - !<View> {name: Raw, colorspace: raw}\n"
                      "  Projector:\n    - !<View> {name: Cinema, colorspace: power26}\n"
                      "active_displays: [Monitor, Projector]\nactive_views: [Power, Swapped, Log, sRGB, Graded, Half, Raw, Cinema]\n"
                      "looks:\n"
                      "  - !<Look> {name: doubled, process_space: \"" +
                      parts.linear +
                      "\", transform: !<CDLTransform> {slope: [2, 2, 2]}}\n"
                      "  - !<Look> {name: warm, process_space: \"" +
                      parts.linear +
                      "\", transform: !<CDLTransform> {slope: [1.5, 1, 0.5]}}\n"
                      "colorspaces:\n  - !<ColorSpace>\n    name: \"" +
                      parts.linear + "\"\n" + (parts.alias.empty() ? "" : "    aliases: [\"" + parts.alias + "\"]\n") +
                      "  - !<ColorSpace>\n    name: raw\n    isdata: true\n" + space("power22", "!<ExponentTransform> {value: 2.2, direction: inverse}") +
                      space("power26", "!<ExponentTransform> {value: 2.6, direction: inverse}") +
                      space("swapped", "!<MatrixTransform> {matrix: [0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1]}") +
                      space("log", "!<LogAffineTransform> {base: 10, log_side_slope: 0.25, log_side_offset: 0.5, lin_side_slope: 1, lin_side_offset: 0.01}") +
                      space("srgb", "!<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055, direction: inverse}") +
                      space("half", "!<FileTransform> {src: half.spi1d, interpolation: linear}") + parts.colorspaces + parts.more);
  writeText(folder + "/half.spi1d", "Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{\n0.0\n" + std::to_string(parts.lutTop) + "\n}\n");
  return path;
}

/// Views of it, of channel c of a colour, 0..1.
inline double expectedView(const std::string& view, const double* rgb, int c) {
  const double x = rgb[c];
  const auto power = [](double v, double gamma) { return v > 0 ? std::pow(v, 1 / gamma) : 0; };
  double out = x;
  if (view == "Power") out = power(x, 2.2);
  else if (view == "Cinema") out = power(x, 2.6);
  else if (view == "Swapped") out = rgb[2 - c];
  else if (view == "Log") out = 0.25 * std::log10(std::max(x + 0.01, 1e-38)) + 0.5;
  else if (view == "sRGB") {  // the library's: the line meets the power where their slopes agree, which the standard's rounded 0.0031308 and 12.92 miss by 1e-5
    const double gamma = 2.4, offset = 0.055, at = std::pow(offset * gamma / ((gamma - 1) * (1 + offset)), gamma);
    out = x < at ? x * offset / (gamma - 1) / at : (1 + offset) * std::pow(x, 1 / gamma) - offset;
  }
  if (view == "Graded") out = power(2 * x, 2.2);
  else if (view == "Half") out = 0.5 * std::clamp(x, 0.0, 1.0);
  return std::clamp(out, 0.0, 1.0);
}

}  // namespace gobo::test
