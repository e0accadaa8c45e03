// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_news.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>

#include "server/jobs/postgres_job_store.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {
constexpr int kNewsRetryMs = 2000;
constexpr double kNewsWait = 5;
}  // namespace

JobNews::JobNews(const std::string& uri, std::function<void(bool steered)> heard)
    : db_(uri, kNewsWait), heard_(std::move(heard)), stop_{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)}, thread_([this] { listen(); }) {}

JobNews::~JobNews() {
  const uint64_t one = 1;
  (void)!::write(stop_.get(), &one, sizeof one);
  thread_.join();
}

void JobNews::listen() {
  bool told = false;
  for (;;) {
    const bool fresh = !db_.connected();
    Status status = db_.connect();
    if (status.ok() && fresh) {
      status = db_.exec(std::string("LISTEN ") + PostgresJobStore::kChannel).status();
      if (status.ok()) heard_(true);
    }
    if (!status.ok() && !told) logWarn("jobs: no news of other daemons: %s", status.toString().c_str());
    told = !status.ok();
    if (!status.ok()) db_.close();
    pollfd waits[] = {{stop_.get(), POLLIN, 0}, {db_.socket(), POLLIN, 0}};
    ::poll(waits, db_.connected() ? 2 : 1, db_.connected() ? -1 : kNewsRetryMs);
    if (waits[0].revents) return;
    if (!db_.connected()) continue;
    const auto news = db_.notifications();
    if (news.ok() && !news->empty()) heard_(std::find(news->begin(), news->end(), "steered") != news->end());
  }
}

}  // namespace jobs
}  // namespace gobo
