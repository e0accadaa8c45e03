// SPDX-License-Identifier: Apache-2.0
// Sessions: of one viewer's edits the latest wins (scheduling.session). A session has at most one request that runs and one that waits: a newer one
// takes the waiting one's place, and ends the running one as soon as that has sent a picture, so that a drag of sixty edits a second shows
// pictures all the time and never one that is older than two edits. A request that sends nothing before its end runs to its end.
// Names belong to who uses them: two tokens with one name are two sessions. Thread-safe.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>

namespace gobo {
inline namespace server {

class Sessions {
 public:
  static constexpr uint64_t kWaiting = 64;  ///< requests that wait for their turn at once, of all callers; each holds a thread
  /// One request's part in its session, from its arrival to its end. Its methods are called by one thread.
  class Turn {
   public:
    /// `name` empty: in no session, its turn is at once.
    Turn(Sessions& sessions, const std::string& owner, const std::string& name);
    ~Turn();
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;
    enum class Begin { Now, Replaced, Gone };
    /// Waits for the running one to end, asking `gone` every few milliseconds.
    Begin begin(const std::function<bool()>& gone);
    /// A picture has been sent: from now on a newer request ends this one.
    void shown() { shown_ = true; }
    /// A newer request waits and this one has been seen.
    bool over() const;

   private:
    friend class Sessions;
    Sessions& sessions_;
    const std::string key_;  // empty: none
    bool shown_ = false, replaced_ = false;
  };

  size_t size() const;  ///< sessions with a request

 private:
  struct Session {
    Turn* running = nullptr;
    Turn* waiting = nullptr;
  };
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Session> sessions_;
};

}  // namespace server
}  // namespace gobo
