// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// What the calibration and the effects of a model leave of a change of the readings: means projected, log
/// variances with their level taken out. The noncentrality of a likelihood-ratio test against a change is its
/// information here. The spreads are held at their fitted values: what the spread says about distances would
/// otherwise tell a change of the mean alone from one of alpha or the landmarks, although effects before the
/// curve and of the stops carry it along.
class Space {
 public:
  struct Direction {
    Signature mean;
    Eigen::VectorXd projected;  ///< P x of the mean
    Eigen::VectorXd range_variance,
        bearing_variance;      ///< centred changes of log variance per row; empty: none
    double raw = 0.0;          ///< information before projection, means
    double information = 0.0;  ///< noncentrality of the change
  };

  Space(const Rows& rows, const Model& model, const JointState& state);
  Space(const Space&) = delete;  ///< the projector refers to the working problem

  /// The change that `model` makes at its parameters, the model's own directions removed.
  Direction change(const Model& model) const;
  /// The difference of two changes, times `factor`: a derivative.
  Direction difference(const Model& up, const Model& down, double factor) const;
  /// Effects of these ids do not act on the readings of stop `first_stop` and later.
  void mute(std::set<std::string> ids, int first_stop);
  /// The derivative with respect to parameter `index` of `active`.
  Direction slope(const ActiveEffect& active, int index) const;
  Direction of_signature(Signature mean) const;
  double inner(const Direction& a, const Direction& b) const;
  /// Information of `a` left after taking out its shares along `span`.
  double left(Direction a, std::vector<Direction> span) const;

  const Rows& rows() const { return rows_; }
  const Projector& projector() const { return projector_; }
  const CellGeometry& geometry() const {
    return geometry_;
  }  ///< with the fitted spreads, unlike the projector's
  const Model& model() const { return model_; }

 private:
  struct Changes;
  Changes changes(const Model& model) const;
  Direction finish(Signature mean, Eigen::VectorXd range_variance, Eigen::VectorXd bearing_variance) const;
  void take_out(Direction& a, const Direction& unit) const;

  const Rows& rows_;
  Model model_;
  CellGeometry geometry_;
  WorkingProblem working_;
  Projector projector_;
  std::vector<Direction> active_;  ///< orthonormal
  std::set<std::string> muted_;
  int muted_from_ = -1;
};

/// Twice the divergence between the readings' law with and without what `active` does to dependence, tails,
/// skew and the spread of the stops, all of which leave the means alone: the noncentrality of their test.
double shape_noncentrality(const Space& space, const ActiveEffect& active);

/// Twice the divergence between what the readings tell of the stops' errors under two sets of priors.
double stops_noncentrality(const Space& space, const std::vector<StopPrior>& before,
                           const std::vector<StopPrior>& after);

/// An effect at its typical size: one linear parameter at its typical value, at the point of the start grid
/// where it shows most.
struct TypicalEffect {
  ActiveEffect active;
  int index = -1;  ///< the parameter that was set; -1: all non-linear ones, scaled together
  Space::Direction direction;
  double noncentrality = 0.0;  ///< of the means, variances and shapes together
};
/// None for effects whose trace is not a matter of size (labels, grids) or which the recording's columns do
/// not carry.
std::optional<TypicalEffect> typical_effect(const Space& space, const Effect& effect);

/// The effect with everything that was set at its typical value multiplied by `factor`.
ActiveEffect scaled(const TypicalEffect& typical, double factor);

/// RMS over the calibrated distances of the error in the corrected distance [m] that the change costs if
/// ignored: the change of the curve that absorbs it, less the change of the curve that is real (effects of
/// the range alone), divided by f'.
double range_error_of(const Space& space, const TypicalEffect& typical);

}  // namespace rangecal::diagnosis
