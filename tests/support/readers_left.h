// SPDX-License-Identifier: Apache-2.0
// Which processes of gobo-ingest are below this one, by /proc: a nursery is two (server/reader_process.h), whatever is below it reads.
#pragma once

#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <system_error>
#include <thread>

namespace gobo {

/// Readers and their guards, and zombies that are this process's to wait for.
inline int readersNow() {
  struct Process {
    std::string name;
    int parent = 0;
    bool dead = false;
  };
  std::map<int, Process> all;
  std::error_code error;
  for (auto it = std::filesystem::directory_iterator("/proc", error); !error && it != std::filesystem::directory_iterator(); it.increment(error)) {
    const std::string folder = it->path().filename();
    if (folder.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream in(it->path() / "status");
    Process p;
    for (std::string word; in >> word;) {
      if (word == "Name:") in >> p.name;
      if (word == "State:") {
        in >> word;
        p.dead = word == "Z";
      }
      if (word == "PPid:") {
        in >> p.parent;
        break;
      }
    }
    all[std::stoi(folder)] = p;
  }
  int found = 0;
  for (const auto& [pid, p] : all) {
    if (p.name != "gobo-ingest") continue;
    int above = 0, up = p.parent;
    while (up != ::getpid() && all.count(up) && above < 8) {
      ++above;
      up = all[up].parent;
    }
    found += up == ::getpid() && (above >= 2 || (above == 0 && p.dead));
  }
  return found;
}

/// After a load has been answered: its guard may still be on its way out.
inline bool noReaderIsLeft() {
  for (int tries = 0; tries < 2000; ++tries) {
    if (readersNow() == 0) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

}  // namespace gobo
