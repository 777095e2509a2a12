// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace rangecal {

/// Distances d [m] in bins of equal ratio, 1.15 at most; a place in a bin is u = (d - c) / h with centre c and half
/// width h.
class DistanceBins {
 public:
  DistanceBins(double low_m, double high_m) : low_(low_m), high_(high_m) {
    const double count = std::ceil(std::log(high_m / low_m) / std::log(largest_ratio));
    size_ = static_cast<std::size_t>(std::max(1.0, count));
    log_ratio_ = std::log(high_m / low_m) / static_cast<double>(size_);
  }

  struct Bin {
    double centre_m, half_width_m;
    double place_of(double d) const { return (d - centre_m) / half_width_m; }
  };

  std::size_t size() const { return size_; }
  bool hold(double d) const { return d >= low_ && d <= high_; }
  /// Precondition: hold(d).
  std::size_t index_of(double d) const {
    return std::min(static_cast<std::size_t>(std::max(0.0, std::log(d / low_) / log_ratio_)), size_ - 1);
  }
  Bin operator[](std::size_t index) const {
    const double a = low_ * std::exp(log_ratio_ * static_cast<double>(index)), b = a * std::exp(log_ratio_);
    return {0.5 * (a + b), 0.5 * (b - a)};
  }

 private:
  static constexpr double largest_ratio = 1.15;
  double low_, high_, log_ratio_;
  std::size_t size_;
};

}  // namespace rangecal
