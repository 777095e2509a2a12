// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "rangecal/solvers/study/study.hpp"

namespace rangecal {

inline constexpr int study_highest_order = 9;
inline constexpr int study_outcomes = 6;  ///< values of Outcome

/// Where a point's sums stand in one flat row of numbers: everything a study reports is a function of sums over the
/// repeats, so that a study's memory does not grow with its repeats, and rows of different repeats just add.
/// For every estimator, offsets from its first number; 'squares' are of the quantity before.
struct StudyLayout {
  StudyLayout(const Study& study, const StudyPoint& point);

  int landmarks = 0, curve = 0, estimators = 0;

  int outcome = 0;                                    ///< repeats by Outcome
  int answers = 0;                                    ///< repeats with an estimate that may be used
  int landmark_error = 0, landmark_square = 0;        ///< 2 L each [m], [m^2]
  int landmark_total = 0, landmark_total_square = 0;  ///< sum over landmarks of |error|^2 [m^2]
  int curve_error = 0, curve_square = 0;              ///< per distance [m], [m^2]
  int curve_total = 0, curve_total_square = 0;        ///< sum over distances [m^2]
  int sigma_e = 0, sigma_theta = 0;                   ///< count, sum, squares of estimated / true
  int mse = 0;                                        ///< MseSlot
  int order = 0;                                      ///< repeats by order selected
  int cover = 0;                                      ///< intervals of landmarks, held; of the curve, held
  int aic = 0;     ///< repeats in which every order has one, then sums by order
  int power = 0;   ///< repeats by best power 0 .. 3, then log-likelihoods
  int stride = 0;  ///< numbers of one estimator

  int bound = 0;  ///< from the row's start: count, sum of the landmarks' bound, of the curve's [m^2], where
                  ///< landmarks are drawn anew in every repeat
  int size = 0;   ///< numbers of the row

  int of(int estimator) const { return estimator * stride; }
};

/// Squared errors of raw and corrected readings, averaged within the repeat. Of 2016 eq. 31, 32 (relative to d) for
/// pairs where `normalised_mse` is measured, else of 2021 eq. 31 [m^2].
enum MseSlot {
  mse_count,
  mse_raw,
  mse_raw_square,
  mse_corrected,
  mse_corrected_square,
  mse_product,
  mse_ratio_sum,
  mse_ratio_square,
  mse_log,
  mse_log_square,  ///< raw / corrected, and its log10
  mse_exact_raw,
  mse_exact_corrected,  ///< the same of readings without noise, y = f(d)
  mse_slots
};

/// Sums of consecutive repeats of one point.
struct StudySums {
  int repeats = 0;
  std::vector<double> numbers;  ///< StudyLayout
  std::vector<double> seconds;  ///< processor time of the thread: simulation and problem, then every
                                ///< estimator

  void prepare(const StudyLayout& layout);
  /// Adds what stands after it; the order of additions decides the last bits.
  void add(const StudySums& other);
};

/// One repeat of one point, added to `sums`. Its numbers depend on (study, point, repeat) alone; seconds do not.
/// Nothing is shared: any thread may run any repeat.
void run_study_repeat(const Study& study, const StudyPoint& point, const StudyLayout& layout, int repeat,
                      StudySums& sums);

/// argmin over d > 0 of (f(d) - y)^2 (2016 eq. 30; 2021 eq. 30): of several roots the one nearest to y.
double least_squares_distance(const Eigen::VectorXd& alpha, double reading_m);

}  // namespace rangecal
