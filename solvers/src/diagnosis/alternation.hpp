// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// On which side of a switching distance every line of sight lies: one landmark seen from one place.
///
/// An effect that jumps at a distance L makes the likelihood jump wherever an estimated distance d crosses L.
/// No gradient leads across; but one within the error of d of L costs next to nothing to move, and its
/// readings, a jump away from where the model expects them, say where it belongs. For cells of weight w,
/// residual r on the side where d lies and r' beyond, and the place's standard deviation s left by its other
/// readings,
///   cross if  sum w r'^2 / 2 + (L - d)^2 / (2 s^2) < sum w r^2 / 2.
/// Crossing moves the place by L - d along the line of sight, so that everything that follows sees one
/// geometry.
class Sides {
 public:
  /// Moves the stops of `state` to where the readings say that cells near L lie.
  void settle(const Rows& rows, const Model& model, JointState& state);
  /// Takes the sides as they are.
  void take(const Rows& rows, const Model& model, const JointState& state);
  /// After a solve that knew nothing of L: moves stops back over it to the side that the solve took for
  /// granted. Returns what the moves cost in nats.
  double restore(const Rows& rows, JointState& state) const;
  /// Models and states that differ from these by one line of sight on the other side of L, those that the
  /// jump could have misplaced, nearest first, at most eight. L moves as far as it may without another
  /// changing sides.
  static std::vector<std::pair<Model, JointState>> others(const Rows& rows, const Model& model,
                                                          const JointState& state);
  /// The view of a reading as an effect of the model gets it, on the side on which its cell is taken to be: beyond that, where it
  /// ends.
  ReadingView<double> seen_by(std::size_t effect, int cell, ReadingView<double> view) const;
  /// True if some effect of the model jumps.
  static bool matter(const Model& model);

 private:
  struct OfCells {
    double limit = 0.0;  ///< L [m]
    std::vector<char>
        near;  ///< by cell: d < L, alike along a line of sight; empty of an effect that does not jump
    bool jumps() const { return !near.empty(); }
    void put(const std::vector<int>& line, bool on_near_side);
  };
  /// Cells of every effect that jumps, their sides still open.
  void begin(const Rows& rows, const Model& model);

  std::vector<OfCells> of_cells_;  ///< by effect of the model
};

/// The alternation of taking effects out of the readings at a state and solving for what is free of it, all of it at known
/// distances, the stops alone of what is held out: twice, the second time with the effects at the new geometry (and the tails' new
/// weights); where they change fast with distance, hold a grid's part of the noise, or make it noise of 1/f, whose density has f in
/// its Jacobian, until the value stays. At known distances once is enough where curve and noise hardly moved.
///
///   Alternation alternation(model);
///   do { working = alternation.begin(rows, model, state);  ... solve: state, value ... }
///   while (alternation.another(rows, state, value));
class Alternation {
 public:
  explicit Alternation(const Model& model)
      : left_(model.empty() ? 1 : 2),
        jumps_(Sides::matter(model)),
        exact_(has_grid(model) || has_reciprocal_noise(model)) {}
  WorkingProblem begin(const Rows& rows, const Model& model, JointState& state);
  /// Puts cells that the solve moved over a switching distance back, at its cost in `value`. True where another
  /// iteration is needed.
  bool another(const Rows& rows, JointState& state, double& value);

 private:
  int left_, done_ = 0;
  bool jumps_, exact_, has_effect_slope_ = false;
  double before_ = 0.0;
  JointState begun_;  ///< of pairs: where the iteration began
  Sides sides_;
};

}  // namespace rangecal::diagnosis
