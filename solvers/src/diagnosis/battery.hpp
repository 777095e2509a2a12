// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/null_draws.hpp"
#include "diagnosis/rates.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/scalar_tests.hpp"

namespace rangecal::diagnosis {

/// One question asked of the residuals: null hypothesis "no structure of this shape in this channel".
struct Question {
  std::string channel, covariate, shape, group;
  std::string family;  ///< id of the effect, or channel and covariate: shares one part of the alarm rate
  std::optional<double> from, to;
  int dof = 1;
  int first_column = -1;  ///< into the mean columns, or the variance columns
  enum class Of { mean, variance, scalar } of = Of::mean;
  const Effect* effect = nullptr;  ///< of the catalogue, with its start; null for a shape of no effect
  Eigen::VectorXd start;
  std::optional<double> z;              ///< of a scalar test, before it is centred and scaled
  double statistic = 0.0;               ///< chi-square with `dof` degrees of freedom under the null
  std::vector<double> third_cumulants;  ///< of a variance's scores (skewed_score.hpp)
  double size = 0.0;  ///< RMS of the fitted shape over the readings [m], [rad], or change of log variance
  /// Nats that a fit of the shape would gain, the spreads free; statistic / 2 for scalars.
  double gain = 0.0;
  double log_p = 0.0;  ///< natural log of the p-value, before correction
};

/// The scan: score statistics for every channel x covariate x shape, projected onto what is left after the
/// calibration and the model's own parameters, with one rate for the whole battery.
class Battery {
 public:
  /// `known`: the rates of the recording's first battery, for all that follow it.
  Battery(const Rows& rows, const Model& model, const JointState& state, const Rates& known = {});
  /// Asks about all but the catalogue's effects on the means.
  static Battery of_shapes(const Rows& rows, const Model& model, const JointState& state, const Rates& known);
  /// Asks about nothing by itself.
  static Battery of_nothing(const Rows& rows, const Model& model, const JointState& state,
                            const Rates& known);

  /// About one effect, at every point of its start grid in turn; none of them is kept.
  std::vector<Question> questions_of(const Effect& effect) const;

  std::vector<Question> questions;
  Rates rates;  ///< what the questions' p-values are worth together; `calibrate` finds it
  /// p-value of the question corrected for everything that was asked.
  double corrected(const Question& q) const { return rates.corrected(q.family, q.log_p); }
  /// Simulates the battery under the fitted model: the laws of its scalar tests and of its smallest p-values;
  /// sets the rates. Once: the columns of the questions, most of a battery's memory, are gone afterwards.
  void calibrate(int draws, std::uint64_t seed);
  /// The question of the smallest corrected p-value; there has to be one.
  const Question& strongest() const;
  /// Its corrected p-value; 1 where nothing can be asked.
  double alarm_p() const { return questions.empty() ? 1.0 : corrected(strongest()); }
  const Projector& projector() const { return projector_; }
  const WorkingProblem& working() const { return working_; }
  const RowChanges& changes() const { return changes_; }
  /// chi-square of the cell means and its degrees of freedom
  double cell_chi_sq = 0.0, cell_dof = 0.0;
  VarianceUnits range_units, bearing_units;

 private:
  /// A question with its answer, and the columns that its score is of.
  struct Asked {
    Question question;
    std::vector<Eigen::VectorXd> mean_projected;  ///< P x, normalised, per column; of pairs without bearings
    std::vector<Signature> mean_within;           ///< rows' parts of normalised columns (empty if none)
    std::vector<Eigen::VectorXd> variance_columns;  ///< normalised slopes over the units of a channel
    bool variance_of_bearing = false;
  };
  /// A shape over the rows, and by cells the same where these are moved as the projector says; empty where it does not follow them, or
  /// jumps.
  struct Shape {
    Eigen::VectorXd at, moved;
  };
  using ShapeOf = std::function<Shape()>;  ///< made where it is asked about, by many threads
  class Values;
  class MeanQuestions;
  struct Unasked {};
  /// Has its questions still to ask.
  Battery(Unasked, const Rows& rows, const Model& model, const JointState& state, const Rates& known);
  Asked asked_of_rows(Question question, const std::vector<ShapeOf>& shapes, bool bearing) const;
  double fitted_gain(const Question& question, const Signature& fitted) const;
  Asked asked_of_mean(Question about, std::vector<Signature> block) const;
  Asked asked_of_variance(Question about, const std::vector<Eigen::VectorXd>& unit_shape, bool bearing) const;
  /// Keeps the question, if its shapes leave anything to ask.
  void add(Asked asked);
  std::vector<Asked> asked_of_effect(const Effect& effect) const;
  void add_scalar(const ScalarTest& test);
  void standardise(Question& question) const;
  class NullLargest;
  void draw_statistics(int draws, std::uint64_t seed, NullLargest& largest);
  /// Scalar tests of draws standardised by their own mean and spread. `scalar`: questions; `statistics`: draws x these.
  void standardise_by(const std::vector<std::vector<ScalarTest>>& drawn,
                      const std::vector<std::size_t>& scalar, Eigen::MatrixXd& statistics);
  void keep(Question question);
  void ask_variance_of_rows(const Question& question, const std::vector<Eigen::VectorXd>& range,
                            const std::vector<Eigen::VectorXd>& bearing, std::vector<Asked>& asked) const;
  void ask_means();
  enum class Of { all, spreads };  ///< effects of the catalogue
  void ask(Of catalogue);
  void ask_catalogue(Of of);
  void fill_variance_units();
  void ask_variances();
  void ask_between_cells();
  void ask_scalars();
  void ask_periods();
  void score_rows(const Model& model);
  void remove_model_directions(const Model& model);

  const Rows& rows_;
  JointState state_;
  WorkingProblem working_;
  Projector projector_;
  RowChanges changes_;
  /// Deviations from the cell means as normal scores under the model: variance 1 - 1/R.
  Eigen::VectorXd range_scores_, bearing_scores_;
  /// Residuals of the ranges of the cells in units of their standard deviations, independent; beside tails, of a cell of one reading
  /// the normal score of its error.
  Eigen::VectorXd range_cell_scores_;
  bool rescored_ = false;          ///< the model has tails or correlation: scores are not deviations / s
  std::vector<Signature> active_;  ///< orthonormal in the projected metric
  std::vector<Eigen::VectorXd> active_projected_;
  std::vector<Eigen::VectorXd> mean_projected_;    ///< P x, normalised, per column
  std::vector<Signature> mean_within_;             ///< rows' parts of normalised columns (empty if none)
  std::vector<Eigen::VectorXd> variance_columns_;  ///< normalised slopes over the units of a channel
  std::vector<char> variance_of_bearing_;
  std::optional<ScalarTests> scalar_tests_;
};

/// ln of the chi-square survival function, finite far into the tail.
double log_chi_sq_survival(double statistic, int dof);

}  // namespace rangecal::diagnosis
