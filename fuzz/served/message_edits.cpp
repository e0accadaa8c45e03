// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/message_edits.h"

#include <cmath>
#include <cstring>
#include <limits>

#include "gobo/v1/options.pb.h"

namespace gobo::fuzz::message_edits {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr size_t kSteps = 5;
constexpr int kMostElements = 4;  // of a list: more of a thing costs time and is no other case

struct Edit {
  uint8_t step[kSteps];
  uint8_t how;
  uint32_t value;
};

double number(const FieldDescriptor& f, const Edit& e) {
  const v1::Number range = f.options().GetExtension(v1::number);
  const bool bounded = range.has_min() && range.has_max();
  const double low = bounded ? range.min() : -2, high = bounded ? range.max() : 2;
  switch (e.how % 8) {
    case 0: return range.exclusive_min() ? low + 1e-9 : low;
    case 1: return high;
    case 2: return range.has_default_() ? range.default_() : 1;
    case 3:
      if (e.how & 24)
        return low + (high - low) * std::pow(double(e.value) / 4294967296.0, 4);  // beyond the range: at times only, or little would get past its refusal
      {
        float bits;
        std::memcpy(&bits, &e.value, 4);
        return bits;
      }
    case 4: return low + (high - low) * (double(e.value) / 4294967296.0);
    case 5: return double(e.value % 9);
    case 6: {
      constexpr double odd[] = {-0.0, -1, 1e-45, 1e-12, 1e9, 1e12, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()};
      return e.how & 8 ? odd[e.value % 8] : low + (high - low) / 2;
    }
    default: return double(e.value % 1000) / 100;
  }
}

template <typename T>
T integer(double v) {  // as C++ has no conversion for what does not fit
  if (!(v > double(std::numeric_limits<T>::min()))) return std::numeric_limits<T>::min();
  return v < double(std::numeric_limits<T>::max()) ? T(v) : std::numeric_limits<T>::max();
}

void set(Message& m, const FieldDescriptor& f, size_t depth, const Edit& e, const Texts& texts);

/// One field of the message, chosen by the step.
void descend(Message& m, size_t depth, const Edit& e, const Texts& texts) {
  const int fields = m.GetDescriptor()->field_count();
  if (depth < kSteps && fields > 0) set(m, *m.GetDescriptor()->field(e.step[depth] % fields), depth + 1, e, texts);
}

/// The value under the key that the texts give, made where there is none.
void descendMap(Message& m, const FieldDescriptor& f, size_t depth, const Edit& e, const Texts& texts) {
  const Reflection& r = *m.GetReflection();
  const FieldDescriptor &key = *f.message_type()->map_key(), &value = *f.message_type()->map_value();
  if (key.cpp_type() != FieldDescriptor::CPPTYPE_STRING || value.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return;
  const std::string name = texts(f, e.value % 251);
  Message* entry = nullptr;
  for (int i = 0; i < r.FieldSize(m, &f); ++i) {
    Message* const held = r.MutableRepeatedMessage(&m, &f, i);
    if (held->GetReflection()->GetString(*held, &key) == name) entry = held;
  }
  if (!entry && r.FieldSize(m, &f) < kMostElements) {
    entry = r.AddMessage(&m, &f);
    entry->GetReflection()->SetString(entry, &key, name);
  }
  if (entry) descend(*entry->GetReflection()->MutableMessage(entry, &value), depth, e, texts);
}

void add(Message& m, const FieldDescriptor& f, size_t depth, const Edit& e, const Texts& texts) {
  const Reflection& r = *m.GetReflection();
  const int size = r.FieldSize(m, &f);
  if (e.how >= 240) return r.ClearField(&m, &f);
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_FLOAT:  // the only list of floats is a matrix; the next one begins as if it were
      if (size == 0)
        for (int k = 0; k < 16; ++k) r.AddFloat(&m, &f, k % 5 == 0 ? 1.0f : 0.0f);
      return r.SetRepeatedFloat(&m, &f, int(e.step[kSteps - 1]) % r.FieldSize(m, &f), float(number(f, e)));
    case FieldDescriptor::CPPTYPE_MESSAGE:
      if (f.is_map()) return descendMap(m, f, depth, e, texts);
      return descend(size < kMostElements && e.how % 2 ? *r.AddMessage(&m, &f)
                     : size                            ? *r.MutableRepeatedMessage(&m, &f, e.how % size)
                                                       : *r.AddMessage(&m, &f),
                     depth, e, texts);
    default: break;
  }
  if (size >= kMostElements) return;
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING: return r.AddString(&m, &f, texts(f, e.value));
    case FieldDescriptor::CPPTYPE_ENUM: return r.AddEnumValue(&m, &f, int(e.value % uint32_t(f.enum_type()->value_count() + 1)));
    case FieldDescriptor::CPPTYPE_DOUBLE: return r.AddDouble(&m, &f, number(f, e));
    case FieldDescriptor::CPPTYPE_BOOL: return r.AddBool(&m, &f, e.value % 2 != 0);
    case FieldDescriptor::CPPTYPE_INT32: return r.AddInt32(&m, &f, integer<int32_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_INT64: return r.AddInt64(&m, &f, integer<int64_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_UINT32: return r.AddUInt32(&m, &f, integer<uint32_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_UINT64: return r.AddUInt64(&m, &f, integer<uint64_t>(number(f, e)));
    default: return;
  }
}

void set(Message& m, const FieldDescriptor& f, size_t depth, const Edit& e, const Texts& texts) {
  const Reflection& r = *m.GetReflection();
  if (f.is_repeated()) return add(m, f, depth, e, texts);
  if (e.how >= 248) return r.ClearField(&m, &f);
  switch (f.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE: return descend(*r.MutableMessage(&m, &f), depth, e, texts);
    case FieldDescriptor::CPPTYPE_STRING: return r.SetString(&m, &f, texts(f, e.value));
    case FieldDescriptor::CPPTYPE_ENUM:
      return r.SetEnumValue(&m, &f, int(e.value % uint32_t(f.enum_type()->value_count() + (e.how % 8 == 6))));  // at times one that is none
    case FieldDescriptor::CPPTYPE_DOUBLE: return r.SetDouble(&m, &f, number(f, e));
    case FieldDescriptor::CPPTYPE_FLOAT: return r.SetFloat(&m, &f, float(number(f, e)));
    case FieldDescriptor::CPPTYPE_BOOL: return r.SetBool(&m, &f, e.value % 2 != 0);
    case FieldDescriptor::CPPTYPE_INT32: return r.SetInt32(&m, &f, integer<int32_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_INT64: return r.SetInt64(&m, &f, integer<int64_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_UINT32: return r.SetUInt32(&m, &f, integer<uint32_t>(number(f, e)));
    case FieldDescriptor::CPPTYPE_UINT64: return r.SetUInt64(&m, &f, integer<uint64_t>(number(f, e)));
  }
}

}  // namespace
}  // namespace gobo::fuzz::message_edits

namespace gobo::fuzz {

void editMessage(google::protobuf::Message& message, Bytes bytes, const Texts& texts) {
  for (; bytes.size() >= kEditBytes; bytes = bytes.subspan(kEditBytes)) {
    message_edits::Edit e;
    std::memcpy(e.step, bytes.data(), message_edits::kSteps);
    e.how = bytes[message_edits::kSteps];
    std::memcpy(&e.value, &bytes[message_edits::kSteps + 1], 4);
    message_edits::descend(message, 0, e, texts);
  }
}

}  // namespace gobo::fuzz
