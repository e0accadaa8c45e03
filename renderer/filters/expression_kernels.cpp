// SPDX-License-Identifier: Apache-2.0
#include "filters/expression.h"

#include <algorithm>

namespace gobo {
inline namespace filters {

void Expression::hash(Hasher& h) const {
  h.add(uint64_t(code_.size()));
  for (const Instruction& i : code_) h.add(i.op).add(i.a).add(i.b).add(i.c).add(i.input).add(i.plane).add(i.value.x).add(i.value.y).add(i.value.z);
}

Status Expression::check(std::span<const TermShape> inputs) const {
  if (code_.empty()) return internalError("empty expression");
  const Extent* extent = nullptr;
  for (size_t k = 0; k < code_.size(); ++k) {
    const Instruction& i = code_[k];
    const std::string place = "expression instruction " + std::to_string(k);
    for (int operand : {i.a, i.b, i.c})
      if (operand >= int(k)) return internalError("operand " + std::to_string(operand) + " is not evaluated yet", place);
    if (i.op != Op::Plane) continue;
    if (i.input < 0 || i.input >= int(inputs.size())) return internalError("input " + std::to_string(i.input) + " does not exist", place);
    const TermShape& t = inputs[size_t(i.input)];
    const PlaneShape* plane = t.find(i.plane);
    if (!plane) return internalError("term '" + t.type + "' has no plane '" + i.plane + "'", place);
    if (plane->format != Format::F32 || (plane->channels != 1 && plane->channels != 3))
      return internalError("plane '" + i.plane + "' has neither 1 nor 3 channels of f32", place);
    if (extent && !(*extent == t.extent)) return internalError("terms of different extents", place);
    extent = &t.extent;
  }
  return {};
}

namespace {

constexpr size_t kRun = 256;  // pixels a run: 3 KiB a value

struct Buffers {
  std::vector<float> values;
  float* at(int k) { return values.data() + size_t(k) * kRun * 3; }
};

}  // namespace

void Expression::evaluate(const std::vector<TermPtr>& inputs, size_t begin, size_t end, float* out) const {
  // Planes are resolved once a call, and read in place when they have three channels.
  thread_local Buffers buffers;
  buffers.values.resize(code_.size() * kRun * 3);
  std::vector<const float*> planes(code_.size(), nullptr);
  std::vector<int> channels(code_.size(), 3);
  for (size_t k = 0; k < code_.size(); ++k) {
    if (code_[k].op != Op::Plane) continue;
    planes[k] = inputs[code_[k].input]->floats(code_[k].plane).data();
    channels[k] = inputs[code_[k].input]->channels(code_[k].plane);
  }
  std::vector<const float*> value(code_.size());
  for (size_t run = begin; run < end; run += kRun) {
    const size_t n = std::min(kRun, end - run), m = n * 3;
    for (size_t k = 0; k < code_.size(); ++k) {
      const Instruction& i = code_[k];
      float* r = k + 1 == code_.size() ? out + (run - begin) * 3 : buffers.at(int(k));
      const float* a = i.a >= 0 ? value[i.a] : nullptr;
      const float* b = i.b >= 0 ? value[i.b] : nullptr;
      const float* c = i.c >= 0 ? value[i.c] : nullptr;
      switch (i.op) {
        case Op::Constant:
          for (size_t j = 0; j < n; ++j) {
            r[3 * j] = i.value.x;
            r[3 * j + 1] = i.value.y;
            r[3 * j + 2] = i.value.z;
          }
          break;
        case Op::Plane:
          if (channels[k] == 3 && k + 1 != code_.size()) {
            value[k] = planes[k] + run * 3;
            continue;
          }
          if (channels[k] == 3) {
            std::copy(planes[k] + run * 3, planes[k] + run * 3 + m, r);
            break;
          }
          for (size_t j = 0; j < n; ++j) r[3 * j] = r[3 * j + 1] = r[3 * j + 2] = planes[k][run + j];
          break;
        case Op::Add:
          for (size_t j = 0; j < m; ++j) r[j] = a[j] + b[j];
          break;
        case Op::Multiply:
          for (size_t j = 0; j < m; ++j) r[j] = a[j] * b[j];
          break;
        case Op::Ratio:
          for (size_t j = 0; j < m; ++j) r[j] = b[j] > 0.0f ? a[j] / std::max(b[j], 1e-8f) : a[j];
          break;
        case Op::MultiplyAdd: {
          // A gain pattern of period 3 written out over 24 floats lets the compiler use whole vectors.
          alignas(32) float g[24];
          for (int j = 0; j < 24; ++j) g[j] = i.value[j % 3];
          size_t j = 0;
          for (; j + 24 <= m; j += 24)
            for (int l = 0; l < 24; ++l) r[j + l] = a[j + l] + g[l] * b[j + l];
          for (; j < m; ++j) r[j] = a[j] + g[j % 3] * b[j];
          break;
        }
        case Op::Lerp:
          for (size_t j = 0; j < m; ++j) r[j] = a[j] + (b[j] - a[j]) * c[j];
          break;
        case Op::Over:
          for (size_t j = 0; j < m; ++j) r[j] = a[j] * c[j] + b[j] * (1.0f - c[j]);
          break;
        case Op::Clamp:
          for (size_t j = 0; j < m; ++j) r[j] = std::min(std::max(a[j], i.value.x), i.value.y);
          break;
      }
      value[k] = r;
    }
  }
}

}  // namespace filters
}  // namespace gobo
