// SPDX-License-Identifier: Apache-2.0
#include "color/files_of_config.h"

#include <sys/stat.h>

#include <cctype>
#include <fstream>
#include <functional>
#include <set>
#include <sstream>

#include "base/hash.h"

namespace gobo::color {
namespace {

namespace ocio = OCIO_NAMESPACE;

FileStamp stampOf(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return {};
  return {uint64_t(info.st_dev), uint64_t(info.st_ino), uint64_t(info.st_size), int64_t(info.st_mtim.tv_sec) * 1000000000 + info.st_mtim.tv_nsec, true};
}

/// Names of files, as the config has them.
std::set<std::string> namedFiles(const ocio::ConstConfigRcPtr& config) {
  std::set<std::string> names;
  const std::function<void(const ocio::ConstTransformRcPtr&)> visit = [&](const ocio::ConstTransformRcPtr& transform) {
    if (!transform) return;
    if (const auto group = OCIO_DYNAMIC_POINTER_CAST<const ocio::GroupTransform>(transform)) {
      for (int i = 0; i < group->getNumTransforms(); ++i) visit(group->getTransform(i));
    } else if (const auto file = OCIO_DYNAMIC_POINTER_CAST<const ocio::FileTransform>(transform)) {
      if (file->getSrc() && *file->getSrc()) names.insert(file->getSrc());
    }  // other kinds hold numbers, or names of what is visited itself
  };
  const int spaces = config->getNumColorSpaces(ocio::SEARCH_REFERENCE_SPACE_ALL, ocio::COLORSPACE_ALL);
  for (int i = 0; i < spaces; ++i) {
    const auto space = config->getColorSpace(config->getColorSpaceNameByIndex(ocio::SEARCH_REFERENCE_SPACE_ALL, ocio::COLORSPACE_ALL, i));
    if (!space) continue;
    visit(space->getTransform(ocio::COLORSPACE_DIR_TO_REFERENCE));
    visit(space->getTransform(ocio::COLORSPACE_DIR_FROM_REFERENCE));
  }
  for (int i = 0; i < config->getNumLooks(); ++i) {
    const auto look = config->getLook(config->getLookNameByIndex(i));
    if (!look) continue;
    visit(look->getTransform());
    visit(look->getInverseTransform());
  }
  for (int i = 0; i < config->getNumViewTransforms(); ++i) {
    const auto view = config->getViewTransform(config->getViewTransformNameByIndex(i));
    if (!view) continue;
    visit(view->getTransform(ocio::VIEWTRANSFORM_DIR_TO_REFERENCE));
    visit(view->getTransform(ocio::VIEWTRANSFORM_DIR_FROM_REFERENCE));
  }
  for (int i = 0; i < config->getNumNamedTransforms(ocio::NAMEDTRANSFORM_ALL); ++i) {
    const auto named = config->getNamedTransform(config->getNamedTransformNameByIndex(ocio::NAMEDTRANSFORM_ALL, i));
    if (!named) continue;
    visit(named->getTransform(ocio::TRANSFORM_DIR_FORWARD));
    visit(named->getTransform(ocio::TRANSFORM_DIR_INVERSE));
  }
  return names;
}

/// Whether `text` has $name, ${name} or %name%.
bool usesVariable(const std::string& text, const std::string& name) {
  for (size_t at = text.find(name); at != std::string::npos; at = text.find(name, at + 1)) {
    const char before = at > 0 ? text[at - 1] : ' ', after = at + name.size() < text.size() ? text[at + name.size()] : ' ';
    const bool ends = !std::isalnum(static_cast<unsigned char>(after)) && after != '_';
    if (ends && (before == '$' || before == '%' || (before == '{' && at > 1 && text[at - 2] == '$'))) return true;
  }
  return false;
}

}  // namespace

std::string ConfigFiles::changed() const {
  for (const auto& [path, stamp] : stamps)
    if (stampOf(path) != stamp) return path;
  return {};
}

ConfigFiles filesOf(const ocio::ConstConfigRcPtr& config, const std::string& text) {
  ConfigFiles files;
  Hasher hasher("ocio config");
  hasher.add(text);
  const ocio::ConstContextRcPtr context = config->getCurrentContext();
  for (const std::string& name : namedFiles(config)) {
    std::string place = name;
    try {
      place = context->resolveFileLocation(name.c_str());
    } catch (const ocio::Exception&) {}  // missing: whoever asks for it is told
    // The stamp comes first: what is written while the file is read shows in the next look at it.
    const FileStamp& stamp = files.stamps[place] = stampOf(place);
    std::ostringstream bytes;
    if (stamp.there) bytes << std::ifstream(place, std::ios::binary).rdbuf();
    hasher.add(name).add(stamp.there).add(bytes.str());
  }
  std::map<std::string, std::string> variables;
  for (int i = 0; i < context->getNumStringVars(); ++i) variables[context->getStringVarNameByIndex(i)] = context->getStringVarByIndex(i);
  for (const auto& [name, value] : variables)
    if (usesVariable(text, name)) hasher.add(name).add(value);
  files.hash = hasher.digest().hex();
  return files;
}

}  // namespace gobo::color
