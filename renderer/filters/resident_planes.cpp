// SPDX-License-Identifier: Apache-2.0
#include "filters/resident_planes.h"

#include <algorithm>
#include <map>
#include <memory>

namespace gobo {
inline namespace filters {

namespace {

const Plane& planeNamed(const Term& term, std::string_view name) {
  const auto found = std::ranges::find(term.planes(), name, &Plane::name);
  GOBO_CHECK(found != term.planes().end());
  return *found;
}
size_t elementBytes(const Plane& p) { return formatSize(p.format) * size_t(p.channels); }

}  // namespace

ResidentPlanes& ResidentPlanes::of(const ComputeDevicePtr& device) {
  static std::mutex mutex;
  static auto* const all = new std::map<const ComputeDevice*, std::unique_ptr<ResidentPlanes>>;  // never destroyed, as the devices
  const std::lock_guard lock(mutex);
  std::unique_ptr<ResidentPlanes>& found = (*all)[device.get()];
  if (!found) found = std::make_unique<ResidentPlanes>(device);
  return *found;
}

Result<ComputeBufferPtr> ResidentPlanes::get(const TermPtr& term, std::string_view plane, size_t first, size_t count) {
  {
    const std::lock_guard lock(mutex_);
    sweep();
    for (auto e = entries_.begin(); e != entries_.end(); ++e) {
      if (e->address != term.get() || e->plane != plane || e->first != first || (e->count != count && !(first == 0 && e->count > count))) continue;
      entries_.splice(entries_.begin(), entries_, e);
      return e->buffer;
    }
  }
  const Plane& p = planeNamed(*term, plane);
  const size_t size = elementBytes(p);
  GOBO_CHECK((first + count) * size <= p.bytes.size());
  Result<ComputeBufferPtr> made = device_->upload(std::span<const uint8_t>(p.bytes.data() + first * size, count * size));
  if (!made.ok()) return checked(made.status());
  const std::lock_guard lock(mutex_);
  uploaded_ += count * size;
  insert({term, term.get(), std::string(plane), first, count, *made});
  return made;
}

void ResidentPlanes::adopt(const TermPtr& term, std::string_view plane, ComputeBufferPtr buffer) {
  const Plane& p = planeNamed(*term, plane);
  GOBO_CHECK(buffer->bytes() >= p.bytes.size() && buffer->of(*device_));
  const std::lock_guard lock(mutex_);
  sweep();
  insert({term, term.get(), std::string(plane), 0, p.bytes.size() / elementBytes(p), std::move(buffer)});
}

void ResidentPlanes::insert(Entry entry) {
  const uint64_t size = entry.buffer->bytes();
  if (size > most_) return;
  while (bytes_ + size > most_) {
    bytes_ -= entries_.back().buffer->bytes();
    entries_.pop_back();
  }
  bytes_ += size;
  entries_.push_front(std::move(entry));
}

void ResidentPlanes::sweep() {
  for (auto e = entries_.begin(); e != entries_.end();) {
    if (!e->term.expired()) {
      ++e;
      continue;
    }
    bytes_ -= e->buffer->bytes();
    e = entries_.erase(e);
  }
}

Status ResidentPlanes::checked(Status status) {
  if (!status.ok()) clear();
  return status;
}

uint64_t ResidentPlanes::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

uint64_t ResidentPlanes::uploaded() const {
  const std::lock_guard lock(mutex_);
  return uploaded_;
}

void ResidentPlanes::clear() {
  Entries gone;  // freed without the lock
  const std::lock_guard lock(mutex_);
  gone.swap(entries_);
  bytes_ = 0;
}

}  // namespace filters
}  // namespace gobo
