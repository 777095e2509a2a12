// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstring>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "rangecal/core/errors.hpp"

namespace rangecal::python {

/// Bytes of a result for pickle, exact to the last bit; read back by the version that wrote them. `Archive` either
/// writes what it is called with, or fills it. A structure is its members in order: archive_fields.hpp lists them.
class Archive {
 public:
  Archive() = default;                                                             ///< writes
  explicit Archive(std::string bytes) : bytes_(std::move(bytes)), reads_(true) {}  ///< reads
  const std::string& bytes() const { return bytes_; }
  bool at_end() const { return at_ == bytes_.size(); }

  template <typename... Values>
  void operator()(Values&... values) {
    (one(values), ...);
  }

 private:
  template <typename T>
  void one(T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      raw(&value, sizeof(T));
    } else {
      archive_fields(*this, value);
    }
  }
  void one(std::string& text) {
    text.resize(size(text.size()));
    raw(text.data(), text.size());
  }
  template <typename T>
  void one(std::vector<T>& items) {
    items.resize(size(items.size()));
    if constexpr (std::is_arithmetic_v<T>) {
      raw(items.data(), items.size() * sizeof(T));
    } else {
      for (T& item : items) one(item);
    }
  }
  template <typename K, typename V>
  void one(std::map<K, V>& map) {
    const std::size_t count = size(map.size());
    if (!reads_) {
      for (auto& [key, value] : map) {
        K copy = key;
        one(copy), one(value);
      }
      return;
    }
    map.clear();
    for (std::size_t i = 0; i < count; ++i) {
      K key{};
      one(key), one(map[key]);
    }
  }
  template <typename A, typename B>
  void one(std::pair<A, B>& both) {
    one(both.first), one(both.second);
  }
  template <typename T>
  void one(std::optional<T>& value) {
    bool there = value.has_value();
    one(there);
    if (reads_) value.reset();
    if (reads_ && there) value.emplace();
    if (there) one(*value);
  }
  template <int Rows, int Columns>
  void one(Eigen::Matrix<double, Rows, Columns>& matrix) {
    const auto rows = static_cast<Eigen::Index>(size(static_cast<std::size_t>(matrix.rows())));
    const auto columns = static_cast<Eigen::Index>(size(static_cast<std::size_t>(matrix.cols())));
    if (reads_) matrix.resize(rows, columns);
    raw(matrix.data(), static_cast<std::size_t>(matrix.size()) * sizeof(double));
  }
  std::size_t size(std::size_t own) {
    raw(&own, sizeof(own));
    if (reads_ && own > bytes_.size()) throw InputError("the pickled bytes are damaged");
    return own;
  }
  void raw(void* data, std::size_t count) {
    if (!reads_) {
      bytes_.append(static_cast<const char*>(data), count);
      return;
    }
    if (count > bytes_.size() - at_) throw InputError("the pickled bytes end too early");
    if (count > 0) std::memcpy(data, bytes_.data() + at_, count);
    at_ += count;
  }

  std::string bytes_;
  std::size_t at_ = 0;
  bool reads_ = false;
};

}  // namespace rangecal::python
