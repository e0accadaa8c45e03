// SPDX-License-Identifier: Apache-2.0
#include "plan/mapped_guard.h"

namespace gobo {
inline namespace plan {

Status MappedGuard::check() const {
  for (const Watched& w : files_)
    if (!w.file->intact())
      return {Code::DataLoss,
              w.what + " is not readable any more and was unloaded: its mapped file \"" + w.file->name() +
                  "\" was cut short, or the disk cannot read it; nothing that was made of it is kept. Load it again",
              w.field};
  return {};
}

std::vector<std::shared_ptr<const MappedFile>> MappedGuard::broken() const {
  std::vector<std::shared_ptr<const MappedFile>> out;
  for (const Watched& w : files_)
    if (!w.file->intact()) out.push_back(w.file);
  return out;
}

}  // namespace plan
}  // namespace gobo
