// SPDX-License-Identifier: Apache-2.0
// ResidentPlanes: planes of terms that lie on a compute device, so that a chain of kernels, and the next request over the same view or map, uploads nothing
// again. The host's copy stays the term: what lies here is a second one, of the same bits, and may go at any time (least recently used first beyond a
// bound; with its term, at the next call; all of it with any error of the device). Nothing but time depends on it. Thread-safe.
// Cost: a plane is uploaded once as long as it stays; bytes on the device up to the bound (a software device's are the host's).
#pragma once

#include <cstdint>
#include <list>
#include <mutex>
#include <string>
#include <string_view>

#include "device/compute_device.h"
#include "terms/term.h"

namespace gobo {
inline namespace filters {

class ResidentPlanes {
 public:
  static constexpr uint64_t kMostBytes = uint64_t(192) << 20;  ///< G-buffer places and ids of 8 M view samples, and a map
  explicit ResidentPlanes(ComputeDevicePtr device, uint64_t most = kMostBytes) : device_(std::move(device)), most_(most) {}
  /// Those of a device that lives as long as the process (VulkanDevice::shared(), EglDevice::shared()).
  static ResidentPlanes& of(const ComputeDevicePtr& device);

  ComputeDevice& device() const { return *device_; }
  /// Elements [first, first + count) of a plane, on the device; uploaded unless they are there, alone or as part of an adopted whole plane with first = 0.
  /// The buffer is for reading. Errors: the device's.
  Result<ComputeBufferPtr> get(const TermPtr& term, std::string_view plane, size_t first, size_t count);
  /// A kernel wrote the whole plane into `buffer`, and nothing writes it from now on.
  void adopt(const TermPtr& term, std::string_view plane, ComputeBufferPtr buffer);
  /// Passes a status on; any error empties everything, since buffers of a lost device are no good.
  Status checked(Status status);

  uint64_t bytes() const;     ///< on the device
  uint64_t uploaded() const;  ///< bytes since the beginning
  void clear();

 private:
  struct Entry {
    std::weak_ptr<const Term> term;
    const Term* address;  // of one that lives: another may lie there later
    std::string plane;
    size_t first, count;
    ComputeBufferPtr buffer;
  };
  using Entries = std::list<Entry>;
  void insert(Entry entry);  // under mutex_
  void sweep();              // under mutex_: what belongs to no term any more
  mutable std::mutex mutex_;
  ComputeDevicePtr device_;
  const uint64_t most_;
  Entries entries_;  // most recent first
  uint64_t bytes_ = 0, uploaded_ = 0;
};

}  // namespace filters
}  // namespace gobo
