// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/solvers/change/change_detector.hpp"

namespace rangecal {

/// Writes amplitude and phase of b_c cos + b_s sin = a cos(bearing - phi), with b = (b_c, b_s) [m] of covariance C [m^2], into
/// an alarm: a = |b|, phi = atan2(b_s, b_c), var a = u^T C u, var phi = t^T C t / a^2, with u = b / a and t perpendicular to
/// it. To first order in b, so valid for an amplitude that is large against its error. A phase that is not known at all
/// gets the standard deviation of the uniform distribution on a circle, pi / sqrt(3).
inline void tell_wave(const Eigen::Vector2d& b, const Eigen::Matrix2d& C, ChangeAlarm& alarm) {
  const Eigen::Vector2d u = b.norm() > 0.0 ? b.normalized().eval() : Eigen::Vector2d(1.0, 0.0),
                        t(-u.y(), u.x());
  const double unknown = std::numbers::pi / std::sqrt(3.0), across = std::sqrt(t.dot(C * t));
  alarm.kind = ChangeKind::encoder;
  alarm.size = b.norm();
  alarm.std_dev = std::sqrt(u.dot(C * u));
  alarm.phase_rad =
      Estimate{std::atan2(u.y(), u.x()), across < unknown * alarm.size ? across / alarm.size : unknown};
}

}  // namespace rangecal
