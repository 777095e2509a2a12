// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace rangecal {

/// Of things that come one by one, all of the first `most` - 1, of more every 2^n-th: from most / 2 to most - 1 of them, evenly
/// spread, in constant memory.
template <class T>
class Thinned {
 public:
  /// `most`: even.
  explicit Thinned(std::size_t most) : most_(most) {}

  /// Counts the next one; true if it is to be kept: `keep` it then.
  bool next() { return seen_++ % stride_ == 0; }
  void keep(T one) {
    kept_.push_back(std::move(one));
    if (kept_.size() < most_) return;
    for (std::size_t i = 1; 2 * i < kept_.size(); ++i) kept_[i] = std::move(kept_[2 * i]);
    kept_.resize(kept_.size() / 2);
    stride_ *= 2;
  }
  const std::vector<T>& kept() const { return kept_; }

 private:
  std::size_t most_, seen_ = 0, stride_ = 1;
  std::vector<T> kept_;
};

}  // namespace rangecal
