// SPDX-License-Identifier: Apache-2.0
#include "request/style_sheet.h"

#include <string_view>

#include "request/request.h"

namespace gobo {
inline namespace request {

namespace {

bool isOfStyle(std::string_view path) {
  constexpr std::string_view all = "shadows.style", one = ".shadow.style", expressions = "expressions.";
  if (path.starts_with(expressions)) path.remove_prefix(expressions.size());
  if (path.starts_with(all)) return path.size() == all.size() || path[all.size()] == '.';
  const size_t at = path.find(one);
  return path.starts_with("lights.") && at != std::string_view::npos && (at + one.size() == path.size() || path[at + one.size()] == '.');
}

}  // namespace

Status applyStyleSheet(v1::RenderRequest& request, const std::string& json, const std::string& source) {
  v1::RenderRequest sheet;
  GOBO_TRY(messageFromJson(json, sheet, source));
  const std::vector<std::string> paths = setPaths(sheet);
  for (const std::string& path : paths)
    if (!isOfStyle(path))
      return invalidArgument(
          source + ": " + path + " is no field of a style: a style sheet has shadows.style, lights.NAME.shadow.style and expressions of these", path);
  return applyMask(request, sheet, paths);
}

}  // namespace request
}  // namespace gobo
