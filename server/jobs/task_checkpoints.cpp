// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/task_checkpoints.h"

#include <algorithm>

#include "server/log.h"
#include "terms/term_file.h"

namespace gobo {
inline namespace jobs {

TaskCheckpoints::TaskCheckpoints(TaskStore& store, JobFiles& files, const Lease& lease, std::vector<CheckpointRow> rows)
    : store_(store), files_(files), lease_(lease) {
  for (CheckpointRow& row : rows) rows_[row.recipe] = row;
}

TermPtr TaskCheckpoints::load(const Hash128& recipe, uint32_t blocks) {
  const std::lock_guard lock(mutex_);
  active_ = Clock::now();
  kept_ = false;
  if (const auto it = states_.find(recipe); it != states_.end()) return it->second.blocks <= blocks ? it->second.term : nullptr;
  const auto row = rows_.find(recipe.hex());
  if (row == rows_.end() || row->second.blocks > blocks) return nullptr;
  const std::string path = files_.checkpointPath(lease_.task, row->second.digest);
  const auto bytes = files_.read(path);
  TermPtr term;
  if (bytes.ok() && hashBytes(bytes->data(), bytes->size()).hex() == row->second.digest) term = parseTerm(bytes->data(), bytes->size(), recipe);
  if (!term) {
    const bool otherVersion = bytes.ok() && isOtherTermVersion(bytes->data(), bytes->size());
    const std::string why = !bytes.ok() ? bytes.status().message() : otherVersion ? otherTermVersion(bytes->data()) : "damaged";
    logWarn("jobs: checkpoint %s cannot be used (%s): the frame starts anew", path.c_str(), why.c_str());
    return nullptr;
  }
  states_[recipe] = {row->second.blocks, term, true};
  ++resumed_;
  return term;
}

void TaskCheckpoints::save(const Hash128& recipe, uint32_t blocks, TermPtr state) {
  const std::lock_guard lock(mutex_);
  active_.reset();
  // A run that begins with few samples is past the state of one that got further: that one waits until as many are asked for again.
  const auto had = states_.find(recipe);
  const auto row = rows_.find(recipe.hex());
  if (had != states_.end() ? had->second.blocks > blocks : row != rows_.end() && row->second.blocks > blocks) return;
  kept_ = true;
  State& s = states_[recipe];
  const bool same = s.term == state && s.blocks == blocks;
  s = {blocks, std::move(state), same && s.written};
}

bool TaskCheckpoints::kept() const {
  const std::lock_guard lock(mutex_);
  return kept_;
}

std::optional<TaskCheckpoints::Clock::time_point> TaskCheckpoints::activeSince() const {
  const std::lock_guard lock(mutex_);
  return active_;
}

void TaskCheckpoints::begin() {
  const std::lock_guard lock(mutex_);
  active_.reset();
}

bool TaskCheckpoints::pending() const {
  const std::lock_guard lock(mutex_);
  for (const auto& [recipe, s] : states_)
    if (!s.written) return true;
  return false;
}

double TaskCheckpoints::samples() const {
  double most = 0;
  const std::lock_guard lock(mutex_);
  for (const auto& [recipe, s] : states_) {
    if (!s.term->hasPlane("samples")) continue;
    double sum = 0;
    const auto counts = s.term->plane<uint32_t>("samples");
    for (const uint32_t n : counts) sum += n;
    most = std::max(most, counts.empty() ? 0.0 : sum / double(counts.size()));
  }
  return most;
}

Status TaskCheckpoints::flush(double progress, uint32_t spp) {
  for (;;) {
    Hash128 recipe;
    State state;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [r, s] : states_)
        if (!s.written) recipe = r, state = s;
    }
    if (!state.term) return {};
    const std::vector<uint8_t> bytes = serializeTerm(*state.term, recipe);
    const CheckpointRow row{recipe.hex(), hashBytes(bytes.data(), bytes.size()).hex(), state.blocks, bytes.size()};
    const std::string path = files_.checkpointPath(lease_.task, row.digest);
    GOBO_TRY(files_.write(path, bytes.data(), bytes.size()));
    auto old = store_.checkpoint(lease_, row, progress, spp);
    if (!old.ok()) {
      if (old.status().code() == Code::FailedPrecondition) files_.remove(path);
      return old.status();
    }
    for (const CheckpointRow& o : *old) files_.remove(files_.checkpointPath(lease_.task, o.digest));
    ++written_;
    const std::lock_guard lock(mutex_);
    rows_[row.recipe] = row;
    if (State& s = states_[recipe]; s.term == state.term && s.blocks == state.blocks) s.written = true;
  }
}

void TaskCheckpoints::drop() {
  const std::lock_guard lock(mutex_);
  files_.removeCheckpoints(lease_.task);  // by name: a cancel may have taken the rows before they were read
  rows_.clear();
  states_.clear();
}

}  // namespace jobs
}  // namespace gobo
