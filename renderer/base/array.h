// SPDX-License-Identifier: Apache-2.0
// Array: a contiguous sequence that either owns its values or looks at memory that somebody else keeps alive (a mapped
// scene blob). Copies share; the first change of a shared or foreign array copies it (copy on write), so big vertex and
// texel arrays cost nothing to pass from scene to scene. Reading is thread-safe; changing needs the only reference.
#pragma once

#include <algorithm>
#include <initializer_list>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

namespace gobo {
inline namespace base {

template <typename T>
class Array {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  using value_type = T;
  Array() = default;
  Array(std::vector<T> values) { adopt(std::move(values)); }
  Array(std::initializer_list<T> values) : Array(std::vector<T>(values)) {}
  explicit Array(size_t n, const T& value = T()) : Array(std::vector<T>(n, value)) {}
  /// Looks at `values`, which must stay as they are while `owner` lives.
  Array(std::shared_ptr<const void> owner, std::span<const T> values) : keep_(std::move(owner)), data_(values.data()), size_(values.size()) {}

  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  const T* data() const { return data_; }
  const T& operator[](size_t i) const { return data_[i]; }
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }
  const T& front() const { return data_[0]; }
  const T& back() const { return data_[size_ - 1]; }
  operator std::span<const T>() const { return {data_, size_}; }
  bool operator==(const Array& o) const { return size_ == o.size_ && std::equal(begin(), end(), o.begin()); }

  // Changes. Each makes the values this array's own first: O(size) once.
  T& operator[](size_t i) { return own()[i]; }
  T* data() { return own().data(); }
  T* begin() { return own().data(); }
  T* end() { return own().data() + size_; }
  T& back() { return own()[size_ - 1]; }
  void push_back(const T& v) {
    change([&](std::vector<T>& o) { o.push_back(v); });
  }
  void pop_back() {
    change([](std::vector<T>& o) { o.pop_back(); });
  }
  void reserve(size_t n) {
    own().reserve(n);
    see();
  }
  void resize(size_t n, const T& v = T()) {
    change([&](std::vector<T>& o) { o.resize(n, v); });
  }
  void assign(size_t n, const T& v) { adopt(std::vector<T>(n, v)); }
  template <typename I>
  requires(!std::is_integral_v<I>) void assign(I first, I last) { adopt(std::vector<T>(first, last)); }
  void clear() { *this = Array(); }
  template <typename I>
  void insert(const T* at, I first, I last) {
    insertAt(size_t(at - data_), std::vector<T>(first, last));
  }
  void insert(const T* at, std::initializer_list<T> values) { insertAt(size_t(at - data_), std::vector<T>(values)); }

 private:
  void adopt(std::vector<T> values) {
    own_ = std::make_shared<std::vector<T>>(std::move(values));
    keep_.reset();
    see();
  }
  void see() {
    data_ = own_->data();
    size_ = own_->size();
  }
  std::vector<T>& own() {
    if (!own_ || own_.use_count() > 1) adopt(std::vector<T>(data_, data_ + size_));
    return *own_;
  }
  template <typename F>
  void change(F&& f) {
    f(own());
    see();
  }
  void insertAt(size_t at, const std::vector<T>& values) {
    change([&](std::vector<T>& o) { o.insert(o.begin() + std::ptrdiff_t(at), values.begin(), values.end()); });
  }
  std::shared_ptr<std::vector<T>> own_;  // null: foreign or empty
  std::shared_ptr<const void> keep_;
  const T* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace base
}  // namespace gobo
