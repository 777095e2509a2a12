// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/extended_design.hpp"

namespace rangecal::diagnosis {

/// A pair at a known distance [m], of the target of that index; without the columns the first target, direction 0.
struct PairAt {
  double true_m = 0.0;
  int landmark = 0;
  double bearing_rad = 0.0;
};

/// The recording and the estimate, stop by stop (pairs: batch by batch), in a form that is easily lengthened.
struct DraftDesign {
  Recording recording;
  std::vector<StopPrior>
      priors;  ///< of every stop: recording and chain, which a Recording cannot say per stop
  JointState state;
  double period_s = 0.0;  ///< from stop to stop; of pairs from reading to reading, 1 s without times
  int batches = 0;        ///< of pairs: every cell is a batch of its own

  DraftDesign(const Rows& rows, const JointState& at);

  /// A reading as the estimate predicts it.
  void add(int stop, int landmark, double time_s, const double* covariates, const Rows& rows);
  /// A pair as the estimate predicts it.
  void add_pair(int batch, const PairAt& at, double time_s, const double* covariates, const Rows& rows);
  /// Its index.
  int add_stop(const StopPrior& prior, const Pose2& pose);
  int new_place() const;
  /// Once more the readings of stop k from another stop, `shift_s` later; of landmark l as of `landmark_of[l]`.
  void repeat_stop(const Rows& rows, int k, int at_stop, double shift_s, const std::vector<int>& landmark_of);

 private:
  void add_stop_record(const StopPrior& prior, double sigma_xy);
};

/// When the first reading of a stop was taken [s]; 0 without times.
double first_time_of_stop(const Rows& rows, int stop);

/// All stops once more in the given order, driven to anew, `pause_s` after the end; the first new stop.
int repeat_all(DraftDesign& draft, const Rows& rows, const std::vector<int>& order, double pause_s,
               const std::vector<int>& landmark_of);

/// Readings of more repeats at a stop, spread over as much time as the first ones take each.
void more_sweeps(DraftDesign& draft, const Rows& rows, int k, int sweeps);

/// A new landmark seen from every stop as often as the others.
void add_landmark(DraftDesign& draft, const Rows& rows, const Eigen::Vector2d& at, double radius);

/// The design that the draft has become, its readings as predicted.
ExtendedDesign finished(DraftDesign draft, const Rows& rows, ExtendedDesign design);

}  // namespace rangecal::diagnosis
