// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {

/// The tilted plane among leaning cylinders (leaning.hpp) as an effect of a job's own landmarks:
///
///   parameters: a = tau^2 cos 2 b0, c = tau^2 sin 2 b0 [rad^2]; for each landmark the x and y components of
///   w = tan(tau) l [rad], with l the slope of its axis
///
/// b0 = 1/2 atan2(c, a). Linear in w.
class LeaningEffect final : public Effect {
 public:
  explicit LeaningEffect(int landmarks);
  const EffectInfo& info() const override { return info_; }
  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override;
  /// Of a lean. The plane's tilt stays where all leans are 0.
  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override;

 private:
  EffectInfo info_;
};

}  // namespace rangecal
