// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_hub.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace gobo {
inline namespace jobs {

void JobHub::changed() {
  {
    const std::lock_guard lock(mutex_);
    ++version_;
    for (auto& [job, topic] : topics_) {
      ++topic.version;
      topic.wake.notify_all();
    }
  }
  wake_.notify_all();
}

void JobHub::changed(int64_t job) {
  {
    const std::lock_guard lock(mutex_);
    ++version_;
    tell(job);
  }
  wake_.notify_all();
}

void JobHub::tell(int64_t job) {
  const auto it = topics_.find(job);
  if (it == topics_.end()) return;
  ++it->second.version;
  it->second.wake.notify_all();
}

JobHub::Watch::Watch(JobHub& hub, int64_t job) : hub_(hub), job_(job) {
  const std::lock_guard lock(hub_.mutex_);
  Topic& topic = hub_.topics_[job_];
  ++topic.watches;
  seen_ = topic.version;
}

JobHub::Watch::~Watch() {
  const std::lock_guard lock(hub_.mutex_);
  const auto it = hub_.topics_.find(job_);
  if (--it->second.watches == 0) hub_.topics_.erase(it);
}

bool JobHub::Watch::wait(double seconds) {
  std::unique_lock lock(hub_.mutex_);
  Topic& topic = hub_.topics_.find(job_)->second;
  topic.wake.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return topic.version != seen_; });
  return std::exchange(seen_, topic.version) != topic.version;
}

void JobHub::steered() {
  control_.fetch_add(1);
  {
    const std::lock_guard lock(mutex_);
    ++news_.steered;
  }
  newsWake_.notify_all();
  changed();
}

void JobHub::queued() {
  {
    const std::lock_guard lock(mutex_);
    ++news_.queued;
  }
  newsWake_.notify_all();
  changed();
}

JobHub::News JobHub::news() const {
  const std::lock_guard lock(mutex_);
  return news_;
}

JobHub::News JobHub::waitNews(const News& seen, double seconds) const {
  std::unique_lock lock(mutex_);
  newsWake_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return news_ != seen; });
  return news_;
}

uint64_t JobHub::version() const {
  const std::lock_guard lock(mutex_);
  return version_;
}

void JobHub::wait(uint64_t& seen, double seconds) {
  std::unique_lock lock(mutex_);
  wake_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return version_ != seen; });
  seen = version_;
}

void JobHub::setLive(TaskId task, const Live& live) {
  const std::lock_guard lock(mutex_);
  live_[task] = live;
  tell(task.job);
}

void JobHub::clearLive(TaskId task) {
  const std::lock_guard lock(mutex_);
  live_.erase(task);
}

void JobHub::clearLive(TaskId task, uint64_t token) {
  const std::lock_guard lock(mutex_);
  if (const auto at = live_.find(task); at != live_.end() && at->second.token == token) {
    tell(at->first.job);
    live_.erase(at);
  }
}

std::map<TaskId, JobHub::Live> JobHub::live() const {
  const std::lock_guard lock(mutex_);
  return live_;
}

std::map<TaskId, JobHub::Live> JobHub::live(int64_t job) const {
  const std::lock_guard lock(mutex_);
  return {live_.lower_bound({job, INT64_MIN}), live_.upper_bound({job, INT64_MAX})};
}

void JobHub::overlay(JobRecord& record) const {
  if (jobIsOver(record.job.state())) return;
  double more = 0;
  for (const auto& [task, l] : live(record.id)) {
    const bool part = placeOf(task.index, int64_t(record.job.frames_total()), record.parts).part.has_value();
    const double share = l.progress / (record.parts + 1);  // of a part in its frame; what is stored of a frame counts its finished ones
    more += part ? share : std::max(0.0, l.progress - l.stored);
    for (v1::Frame& f : *record.job.mutable_frames()) {
      if (f.frame() != l.frame || f.state() != v1::Frame::RUNNING) continue;
      if (part) {
        f.set_progress(std::min(1.0, f.progress() + share));
        continue;
      }
      f.set_progress(std::max(f.progress(), l.progress));
      f.set_spp(std::max(f.spp(), l.spp));
    }
  }
  record.job.set_progress(std::min(1.0, record.job.progress() + more / double(std::max<uint64_t>(1, record.job.frames_total()))));
}

}  // namespace jobs
}  // namespace gobo
