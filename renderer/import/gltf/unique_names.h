// SPDX-License-Identifier: Apache-2.0
// Names as a file gives them, made different: of equal ones the later ones get #2, #3 and so on. Pure; one thread.
#pragma once

#include <map>
#include <set>
#include <string>

namespace gobo::gltf {

class UniqueNames {
 public:
  /// Keeps a name from being given.
  void reserve(const std::string& name) { taken_.insert(name); }
  /// `wanted`, or `stem` with the first number that makes it new. O(log n) for any number of equal names: names are never given back, so numbers up to the
  /// last one of a stem stay taken.
  std::string take(const std::string& wanted, const std::string& stem) {
    if (taken_.insert(wanted).second) return wanted;
    int& k = last_.try_emplace(stem, 1).first->second;
    std::string name;
    do name = stem + "#" + std::to_string(++k);
    while (!taken_.insert(name).second);
    return name;
  }
  std::string take(const std::string& wanted) { return take(wanted, wanted); }

 private:
  std::set<std::string> taken_;
  std::map<std::string, int> last_;  ///< numbers by stem
};

}  // namespace gobo::gltf
