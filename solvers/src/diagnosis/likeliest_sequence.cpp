// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/likeliest_sequence.hpp"

#include <algorithm>
#include <cmath>
#include <nlopt.hpp>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/tails_along_sequence.hpp"

namespace rangecal::diagnosis {

bool is_of_sequence(const Rows& rows, const Model& model, const FreeParameter& p) {
  return p.acts == FreeParameter::Acts::numeric && !rows.sequence.empty() &&
         model[static_cast<std::size_t>(p.effect)].effect->info().kind == EffectKind::dependence;
}

double logit_between(std::pair<double, double> bounds, double value) {
  const double share = (value - bounds.first) / (bounds.second - bounds.first);
  return std::clamp(std::log(share / (1.0 - share)), -largest_logit, largest_logit);
}

double at_logit(std::pair<double, double> bounds, double logit) {
  return bounds.first + (bounds.second - bounds.first) / (1.0 + std::exp(-logit));
}

std::optional<std::pair<Model, JointState>> likeliest_sequence(const Rows& rows,
                                                               const std::vector<FreeParameter>& free,
                                                               const Model& model,
                                                               const WorkingProblem& working,
                                                               const JointState& state) {
  constexpr double first_step = 0.5, narrow = 1e-3;  // in logits of a parameter between its bounds
  constexpr int most_values = 200;
  std::vector<FreeParameter> own;
  for (const FreeParameter& p : free)
    if (is_of_sequence(rows, model, p)) own.push_back(p);
  if (own.empty()) return std::nullopt;
  std::pair<Model, JointState> found{model, state};
  const CellGeometry geometry = cell_geometry(rows, state);
  const bool tails = has_tails(model);
  const Eigen::VectorXd z = tails ? Eigen::VectorXd() : sequence_residuals(working, geometry);
  const double count = static_cast<double>(rows.size());
  Model& trial = found.first;
  const auto set = [&](const std::vector<double>& logits) {
    for (std::size_t a = 0; a < own.size(); ++a)
      value_of(trial, own[a]) = at_logit(bounds_of(rows, trial, own[a]), logits[a]);
  };
  const auto serial = [&] { return serial_errors_of(rows, trial); };
  const auto squares = [&](const SerialErrors& errors) { return errors.whitened(z).squaredNorm(); };
  const auto nll = [&](const std::vector<double>& logits) {
    set(logits);
    if (tails) return nll_along_sequence(rows, trial, working, geometry);
    const SerialErrors errors = serial();
    return 0.5 * (errors.log_determinant() + count * std::log(squares(errors)));
  };
  std::vector<double> logits;
  for (const FreeParameter& p : own) {
    const auto [low, high] = bounds_of(rows, trial, p);
    const double share = std::clamp((value_of(trial, p) - low) / (high - low), 1e-3, 1.0 - 1e-3);
    logits.push_back(std::log(share / (1.0 - share)));
  }
  nlopt::opt search(nlopt::LN_BOBYQA, static_cast<unsigned>(own.size()));
  search.set_lower_bounds(-largest_logit);
  search.set_upper_bounds(largest_logit);
  search.set_initial_step(first_step);
  search.set_xtol_abs(narrow);
  search.set_maxeval(most_values);
  search.set_min_objective(
      [](unsigned n, const double* x, double*, void* value) {
        return (*static_cast<const decltype(nll)*>(value))(std::vector<double>(x, x + n));
      },
      const_cast<void*>(static_cast<const void*>(&nll)));
  double least = 0.0;
  try {
    search.optimize(logits, least);
  } catch (const nlopt::roundoff_limited&) {  // `logits` is the best found
  }
  set(logits);
  if (!tails) found.second.noise.parameters[0] *= std::sqrt(squares(serial()) / count);
  return found;
}

}  // namespace rangecal::diagnosis
