// SPDX-License-Identifier: Apache-2.0
// What the CLI prints for people: plan table, totals, certificate, scenes, status, progress.
#pragma once

#include <string>
#include <vector>

#include "gobo/v1/service.pb.h"

namespace gobo::cli {

/// `everyRow`: of the plan; else rows of one kind ("visibility:LIGHT" of twelve lights) are one, with their sums.
void printReply(const v1::RenderReply& reply, const std::vector<std::string>& files, bool everyRow);
void printPlan(const v1::PlanReply& reply, bool everyRow);
void printScene(const v1::SceneInfo& info);
void printStatus(const v1::StatusReply& status);
/// Rows under headings; columns marked in `right` are flush right. The last column is not padded.
void printTable(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows, const std::vector<bool>& right);
/// JSON has no NaN or infinity: null.
std::string jsonNumber(double v);
/// "1.2 MiB".
std::string bytesText(uint64_t bytes);

/// "  35 s left"; empty where nothing is known (0).
std::string restText(double ms);
/// Stage, samples, time, and what is expected of the rest; or the place in the queue.
std::string progressText(const v1::Progress& progress);
/// Standard error is a terminal.
bool onTerminal();

/// On a terminal one line on standard error that is redrawn; otherwise, with `plain`, a line at every tenth.
class ProgressBar {
 public:
  ProgressBar(bool enabled, bool plain);
  ~ProgressBar();
  void show(double fraction, const std::string& text);
  /// The same without an advance: who waits. Without a terminal a line whenever the text changes.
  void wait(const std::string& text);
  void clear();

 private:
  bool enabled_, plain_, drawn_ = false;
  int lastTenth_ = -1;
  double fraction_ = 0;
  std::string waited_;
};

}  // namespace gobo::cli
