// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/battery.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal::diagnosis {

double log_chi_sq_survival(double statistic, int dof) {
  const double half = 0.5 * statistic, shape = 0.5 * dof;
  if (half < 300.0) return std::log(std::max(chi_squared_upper(statistic, dof), 1e-300));
  return (shape - 1.0) * std::log(half) - half - log_gamma(shape);  // leading term of the tail
}

Battery::Battery(Unasked, const Rows& rows, const Model& model, const JointState& state, const Rates& known)
    : rates(known),
      rows_(rows),
      state_(state),
      working_(working_problem(rows, model, state)),
      projector_(rows, working_, state) {
  changes_ = row_changes(rows, projector_.geometry(), model);
  score_rows(model);
  remove_model_directions(model);
  fill_variance_units();
}

Battery::Battery(const Rows& rows, const Model& model, const JointState& state, const Rates& known)
    : Battery(Unasked{}, rows, model, state, known) {
  ask(Of::all);
}

Battery Battery::of_shapes(const Rows& rows, const Model& model, const JointState& state,
                           const Rates& known) {
  Battery battery(Unasked{}, rows, model, state, known);
  battery.ask(Of::spreads);
  return battery;
}

void Battery::ask(Of catalogue) {
  ask_variances();
  ask_means();
  ask_periods();
  ask_catalogue(catalogue);
  ask_between_cells();
  ask_scalars();
}

Battery Battery::of_nothing(const Rows& rows, const Model& model, const JointState& state,
                            const Rates& known) {
  return {Unasked{}, rows, model, state, known};
}

std::vector<Question> Battery::questions_of(const Effect& effect) const {
  std::vector<Question> answered;
  for (Asked& asked : asked_of_effect(effect)) {
    if (asked.question.dof == 0) continue;
    asked.question.family = effect.info().id;
    answered.push_back(std::move(asked.question));
  }
  return answered;
}

void Battery::score_rows(const Model& model) {
  const double range_rho = working_.range_whitening.rho, bearing_rho = working_.bearing_whitening.rho;
  rescored_ = range_rho != 0.0 || bearing_rho != 0.0;
  const auto whiten = [&](const Eigen::VectorXd& rows, const Eigen::VectorXd& information,
                          const Eigen::VectorXd& log_variance, double rho) {
    Eigen::VectorXd scores =
        rows.cwiseProduct((information.array() * (-log_variance).array().exp()).sqrt().matrix());
    const Whitening dependence{{}, rho};
    if (rho != 0.0)
      for (int c = 0; c < rows_.cell_count; ++c) {
        auto of_cell = scores.segment(rows_.cell_begin[c], rows_.cell_begin[c + 1] - rows_.cell_begin[c]);
        of_cell = dependence.of_cell(of_cell, 0);
      }
    return scores;
  };
  // Deviations as read: what a tail's law makes of one is its score, not its weight.
  const Cells& c = working_.problem.cells;
  Eigen::VectorXd range(working_.range.size()), bearing(working_.range.size());
  for (Eigen::Index i = 0; i < range.size(); ++i) {
    const int cell = rows_.cell[i];
    const bool alone = rows_.cell_begin[cell + 1] - rows_.cell_begin[cell] == 1;
    const double home = projector_.geometry().bearing[cell];
    range[i] = alone ? 0.0 : working_.range_with_tail(i) - c.range_mean[cell];
    bearing[i] = alone || !rows_.reads_bearings()
                     ? 0.0
                     : wrap_angle(working_.bearing[i] + home - c.bearing_mean[cell]);
  }
  range_scores_ = whiten(range, projector_.row_range_information, changes_.range_log_variance, range_rho);
  bearing_scores_ =
      whiten(bearing, projector_.row_bearing_information, changes_.bearing_log_variance, bearing_rho);
  range_cell_scores_ = projector_.whitened(projector_.range_residual);
  TailLaws laws(rows_, projector_.geometry(), model);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const TailLaw& tails = laws.of(i);
    if (tails.empty()) continue;
    rescored_ = true;
    const auto at = static_cast<Eigen::Index>(i);
    const int cell = rows_.cell[i];
    const double spread = projector_.geometry().spread[cell] * working_.tail_spread_factor(at);
    if (rows_.cell_begin[cell + 1] - rows_.cell_begin[cell] > 1) {
      range_scores_[at] = tails.normal_score(range_scores_[at] * spread, spread);
      continue;
    }
    const double centre = working_.tail_centre.size() > 0 ? working_.tail_centre[at] : 0.0;
    const double error = projector_.range_residual[cell] + working_.tail_shift[at] - centre;
    range_cell_scores_[cell] = tails.normal_score(error, spread);
  }
}

void Battery::remove_model_directions(const Model& model) {
  for (const ActiveEffect& active : model)
    for (int j = 0; j < static_cast<int>(active.parameters.size()); ++j) {
      if (active.effect->info().parameters[j].discrete) continue;
      Signature x = effect_signature(rows_, projector_, active, j);
      const double raw = projector_.raw_information(x);
      if (!(raw > 0.0)) continue;
      for (std::size_t a = 0; a < active_.size(); ++a)
        x.take_out(projector_.inner(x, active_projected_[a], active_[a]), active_[a]);
      Eigen::VectorXd projected = projector_.project(x);
      const double information = projector_.inner(x, projected, x);
      if (information < 1e-9 * raw) continue;
      x.see_whether_it_turns(information);
      const double scale = 1.0 / std::sqrt(information);
      x.scale(scale);
      active_.push_back(x);
      active_projected_.push_back(scale * projected);
    }
}

void Battery::add(Asked asked) {
  if (asked.question.dof == 0) return;
  const bool of_mean = asked.question.of == Question::Of::mean;
  asked.question.first_column = static_cast<int>(of_mean ? mean_projected_.size() : variance_columns_.size());
  std::move(asked.mean_projected.begin(), asked.mean_projected.end(), std::back_inserter(mean_projected_));
  std::move(asked.mean_within.begin(), asked.mean_within.end(), std::back_inserter(mean_within_));
  variance_of_bearing_.insert(variance_of_bearing_.end(), asked.variance_columns.size(),
                              asked.variance_of_bearing);
  std::move(asked.variance_columns.begin(), asked.variance_columns.end(),
            std::back_inserter(variance_columns_));
  keep(std::move(asked.question));
}

void Battery::add_scalar(const ScalarTest& test) {
  Question question;
  question.channel = test.channel;
  question.covariate = test.covariate;
  question.shape = test.shape;
  question.of = Question::Of::scalar;
  question.z = test.z;
  question.size = test.size;
  standardise(question);
  keep(std::move(question));
}

void Battery::standardise(Question& question) const {
  const double z = rates.standardised(ScalarTest::name_of(question.channel, question.shape), *question.z);
  question.statistic = z * z;
  question.gain = 0.5 * z * z;
  question.log_p = log_chi_sq_survival(z * z, 1);
}

void Battery::keep(Question question) {
  question.family =
      question.effect ? question.effect->info().id : question.channel + " " + question.covariate;
  questions.push_back(std::move(question));
}

const Question& Battery::strongest() const {
  return *std::min_element(questions.begin(), questions.end(), [&](const Question& a, const Question& b) {
    return rates.in_family(a.family, a.log_p) < rates.in_family(b.family, b.log_p);
  });
}

}  // namespace rangecal::diagnosis
