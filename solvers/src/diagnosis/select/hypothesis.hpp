// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "diagnosis/refit.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// A set of members beside the seed model, fitted: effects of the catalogue, and curves without a name.
struct Hypothesis {
  Fit fit;
  std::vector<std::shared_ptr<Effect>> curves;  ///< those of the fit's model that are in no catalogue
  double gain = 0.0;                            ///< NLL of the root less its own [nats]
  double parameter_volume = 0.0;                ///< by `log_parameter_volume` [nats]
  double prior_mass = 0.0;                      ///< by `log_prior_mass` [nats]
  double formula_allowance = 0.0;               ///< by `log_formula_allowance` [nats]
  /// ln of its probability over that of the root [nats]: the sum of the four above.
  double log_posterior = 0.0;
  double predicted_gain = 0.0;      ///< gain by the linearised problem or by a score [nats]; 0: neither
  std::vector<std::string> parent;  ///< members of the set from which it was reached
  bool of_linear = false;           ///< as one of the problem linearised there
  std::vector<TriedSet::Proposal> proposals;  ///< likely sets of the problem linearised here
  int fits = 1;                               ///< how often it was fitted, from several starts
  bool refined = false;                       ///< other optima of its members were looked for
  bool scanned = false;                       ///< what may be likelier was looked for from here
  Eigen::VectorXd residuals;  ///< of the cell means [standard deviations], once it was scanned; else empty
};

/// What `diagnose --trace` and a followed search say of a hypothesis.
TriedSet tried_set(const Hypothesis& h, double probability, std::size_t known);

/// True if the effect is a curve without a name.
bool is_generic(const Effect& effect);

/// True if an effect is a curve in a name's own channel and along its covariate.
bool is_curve_along(const Effect& effect, const EffectInfo& name);

/// True if one of the effects is a curve without a name.
bool has_generic(const Model& model);

/// The model less the effect at `index`.
Model without(Model model, std::size_t index);

/// The model less its curves without a name.
Model without_curves(Model model);

/// Of its curves without a name, sorted.
std::vector<std::string> curve_names(const Model& model);

std::string curve_name(const std::string& channel, const std::string& covariate);

/// A member by its id; a curve by its channel and covariate.
std::string member_name(const Effect& effect);

/// "dust + tilt"; "no cause" for none.
std::string set_in_words(const std::vector<std::string>& members);

/// The names of the members after the first `known`, sorted.
std::vector<std::string> member_names(const Model& model, std::size_t known);

}  // namespace rangecal::diagnosis
