// SPDX-License-Identifier: Apache-2.0
// JobNews: a thread that listens to what other daemons commit to the store of a farm (NOTIFY gobo_jobs), so that workers need not wait for
// their next look to hear of new jobs, cancels and pauses. Only a hint: without it, or while its connection is lost, they look every half
// second for work and learn of cancels when they renew.
#pragma once

#include <functional>
#include <string>
#include <thread>

#include "base/descriptor.h"
#include "server/jobs/postgres.h"

namespace gobo {
inline namespace jobs {

class JobNews {
 public:
  /// `heard` is called on the thread; true: a running job may have been steered. After a connection is made anew too, since what was told
  /// meanwhile is lost.
  JobNews(const std::string& uri, std::function<void(bool steered)> heard);
  ~JobNews();

 private:
  void listen();
  Postgres db_;
  std::function<void(bool steered)> heard_;
  Descriptor stop_;  ///< eventfd
  std::thread thread_;
};

}  // namespace jobs
}  // namespace gobo
