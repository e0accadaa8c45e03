// SPDX-License-Identifier: Apache-2.0
// LatestMap: a map of bounded size; of more, the keys that were least recently touched go. Not thread-safe.
#pragma once

#include <cstddef>
#include <list>
#include <map>
#include <utility>

namespace gobo {
inline namespace base {

template <class Key, class Value>
class LatestMap {
 public:
  /// `keep`: at least 1.
  explicit LatestMap(size_t keep) : keep_(keep) {}
  /// Of `key`, made if it is not there; now the last to go. Good until the next touch.
  Value& touch(const Key& key) {
    const auto [found, fresh] = entries_.try_emplace(key);
    if (!fresh) order_.erase(found->second.place);
    found->second.place = order_.insert(order_.end(), key);
    while (entries_.size() > keep_) {
      entries_.erase(order_.front());
      order_.pop_front();
    }
    return found->second.value;
  }
  /// Null where it is not known. Touches nothing.
  const Value* find(const Key& key) const {
    const auto found = entries_.find(key);
    return found == entries_.end() ? nullptr : &found->second.value;
  }
  /// Forgets it. Of what is not there: a new Value.
  Value take(const Key& key) {
    const auto found = entries_.find(key);
    if (found == entries_.end()) return Value();
    Value value = std::move(found->second.value);
    order_.erase(found->second.place);
    entries_.erase(found);
    return value;
  }
  void clear() {
    entries_.clear();
    order_.clear();
  }

 private:
  struct Entry {
    Value value;
    typename std::list<Key>::iterator place;
  };
  size_t keep_;
  std::map<Key, Entry> entries_;
  std::list<Key> order_;  // least recently touched first
};

}  // namespace base
}  // namespace gobo
