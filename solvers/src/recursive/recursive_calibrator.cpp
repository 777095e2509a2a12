// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "rangecal/core/errors.hpp"
#include "recursive/count_up.hpp"
#include "recursive/take_row.hpp"

namespace rangecal {
namespace {

/// Weights are relative to an origin that moves on before they grow beyond e^30.
constexpr double largest_log_weight = 30.0;
/// Times the largest distance tracked: a reading beyond is no reading, and its square would end every sum.
constexpr double beyond_any = 1e3;

}  // namespace

void RecursiveOptions::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("options of the stream: " + what); };
  if (!(range_min_m > 0.0 && range_max_m > range_min_m && range_max_m / range_min_m <= 1e12))
    refuse(fmt::format("range_min_m = {}, range_max_m = {}: not 0 < min < max <= 1e12 min", range_min_m,
                       range_max_m));
  if (order && (*order < 0 || *order > 8)) refuse(fmt::format("order = {} is outside of 0 .. 8", *order));
  if (max_order < 1 || max_order > 8) refuse(fmt::format("max_order = {} is outside of 1 .. 8", max_order));
  if (!(forget > 0.0)) refuse(fmt::format("forget = {} is not a positive time constant", forget));
  if (noise_order < 0 || noise_order > 8)
    refuse(fmt::format("noise_order = {} is outside of 0 .. 8", noise_order));
}

RecursiveCalibrator::RecursiveCalibrator(const RecursiveOptions& options)
    : options_((options.check(), options)),
      moments_(options.range_min_m, options.range_max_m),
      cells_(options.range_min_m, options.range_max_m) {
  const int size = options_.columns() + 1;
  triangle_ = Eigen::MatrixXd::Zero(size + 1, size);
}

bool RecursiveCalibrator::add(double true_m, double reading_m, double time_s) {
  const bool timed = !std::isnan(time_s);
  if (timed && !std::isfinite(time_s)) throw InputError("RecursiveCalibrator: time_s is not finite");
  if (timed_ && *timed_ != timed)
    throw InputError("RecursiveCalibrator: some readings have a time and some have none");
  count_up(counts_.read);
  const char* reason = std::isnan(reading_m) || std::isnan(true_m)           ? "missing"
                       : !std::isfinite(reading_m) || !std::isfinite(true_m) ? "not finite"
                       : reading_m == 0.0                                    ? "zero"
                       : reading_m < 0.0                                     ? "negative"
                       : reading_m > beyond_any * options_.range_max_m       ? "beyond any distance tracked"
                       : !moments_.holds(true_m) ? "true distance outside the range tracked"
                                                 : nullptr;
  if (reason) {
    count_up(counts_.dropped[reason]);
    return false;
  }
  const double at = timed ? time_s : static_cast<double>(moments_.used);
  if (!timed_) {
    timed_ = timed;
    origin_ = now_ = at;
    low_m_ = high_m_ = true_m;
  }
  now_ = std::max(now_, at);
  low_m_ = std::min(low_m_, true_m);
  high_m_ = std::max(high_m_, true_m);
  const bool forgets = std::isfinite(options_.forget);
  if (forgets && (now_ - origin_) / options_.forget > largest_log_weight) {
    rescale((origin_ - now_) / options_.forget);
    origin_ = now_;
  }
  const double w = forgets ? std::exp((at - origin_) / options_.forget) : 1.0;
  sum_w_ += w;
  sum_w_sq_ += w * w;
  moments_.add(true_m, reading_m, w);
  if (looks_for_outliers()) cells_.add(true_m, reading_m, w);
  count_up(counts_.used);

  const Eigen::Index size = triangle_.cols(), row = size;
  double value = std::sqrt(w) / (true_m * true_m);
  triangle_(row, size - 1) = reading_m * value;
  for (Eigen::Index i = 0; i + 1 < size; ++i, value *= true_m) triangle_(row, i) = value;
  take_last_row(triangle_);
  return true;
}

void RecursiveCalibrator::rescale(double log_factor) {
  const double factor = std::exp(log_factor);
  triangle_ *= std::sqrt(factor);
  moments_.scale(factor);
  cells_.scale(factor);
  sum_w_ *= factor;
  sum_w_sq_ *= factor * factor;
}

double RecursiveCalibrator::effective_readings() const {
  return sum_w_sq_ > 0.0 ? sum_w_ * sum_w_ / sum_w_sq_ : 0.0;
}

}  // namespace rangecal
