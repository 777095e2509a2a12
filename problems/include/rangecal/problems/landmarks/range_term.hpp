// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "rangecal/core/noise.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/problems/landmarks/taylor.hpp"

namespace rangecal {

/// One cell's share of the range likelihood, with its derivatives.
///
/// Measured: R readings y of one distance d [m], as mean y_bar [m] and mean square deviation S^2 [m^2].
/// Equation: y = f(d) + b (d - d_0) + s(d) e, e ~ N(0, 1), f(d) = sum alpha_i d^i, log s = lambda(f, d; tau).
///           b and d_0 are constants of the cell (Cells::effect_slope): an effect's own slope there, 0 for the seed model.
/// Cost:     q(d, alpha, tau) = R lambda + W ((y_bar - f - b (d - d_0))^2 + S^2) / (2 s^2)
///           [nats, without log(2 pi)/2 per reading]
///           W = R, or the sum of robust weights. The log-determinant is the term R lambda.
/// Source:   Alhashimi 2016 eq. 17, 18, for cells.
///
/// tau is log sigma for the power laws (lambda = tau + p log|f|, or tau + 2 log d) and beta for the polynomial law.
/// Derivatives in d are Taylor series of order N about the cell's d: N = 2 for a Newton step, 3 for the derivative
/// of a Hessian (the marginal likelihood).
template <int N>
class RangeTerm {
 public:
  static constexpr int max_coefficients = 9;

  /// One of `cells` at distance d. alpha: `order + 1` coefficients. noise.parameters: sigma or beta. False if d, f or
  /// s leaves the model's domain.
  bool evaluate(double d, const Cells& cells, std::size_t cell, const Eigen::VectorXd& alpha,
                const Noise& noise) {
    const double count = cells.count[cell], weight = cells.range_weight[cell];
    const double effect_slope = cells.effect_slope.empty() ? 0.0 : cells.effect_slope[cell];
    coefficients_ = static_cast<int>(alpha.size());
    noise_parameters_ = static_cast<int>(noise.parameters.size());
    if (!(d > 0.0)) return false;
    powers(d, std::max(coefficients_, !has_sigma(noise.law) ? noise_parameters_ : 0));
    Taylor<N> f;
    for (int i = 0; i < coefficients_; ++i) f = f + alpha[i] * power[i];
    power_of_f_ = noise.power_of_f();

    Taylor<N> lambda, precision;  // log s, 1 / s^2
    inverse_f_ = Taylor<N>{};
    if (!has_sigma(noise.law)) {
      Taylor<N> s;
      for (int i = 0; i < noise_parameters_; ++i) s = s + noise.parameters[i] * power[i];
      if (!(s.value() > 0.0)) return false;
      inverse_s_ = reciprocal(s);
      lambda = log(s, inverse_s_);
      precision = inverse_s_ * inverse_s_;
    } else {
      const double sigma = noise.parameters[0];
      if (!(sigma > 0.0)) return false;
      precision = Taylor<N>::constant(1.0 / (sigma * sigma));
      lambda = Taylor<N>::constant(std::log(sigma));
      if (power_of_f_ > 0) {
        if (!(f.value() > 0.0)) return false;
        inverse_f_ = reciprocal(f);
        lambda = lambda + double(power_of_f_) * log(f, inverse_f_);
        const Taylor<N> inverse_sq = inverse_f_ * inverse_f_;
        for (int i = 0; i < power_of_f_; ++i) precision = precision * inverse_sq;
      }
      if (const int q = form_of(noise.law).power_of_d; q > 0) {
        Taylor<N> distance;
        distance.c[0] = d;
        distance.c[1] = 1.0;
        const Taylor<N> inverse = reciprocal(distance);
        lambda = lambda + double(q) * log(distance, inverse);
        const Taylor<N> inverse_sq = inverse * inverse;
        for (int i = 0; i < q; ++i) precision = precision * inverse_sq;
      }
    }
    polynomial_law_ = !has_sigma(noise.law);

    Taylor<N> e = Taylor<N>::constant(cells.range_mean[cell] - cells.effect_change(cell, d)) - f;
    e.c[1] -= effect_slope;
    Taylor<N> square = e * e;
    square.c[0] += cells.range_mean_square[cell];
    const Taylor<N> chi_sq = weight * (square * precision);
    cost = count * lambda + 0.5 * chi_sq;
    by_lambda = Taylor<N>::constant(count) - chi_sq;
    by_f_total = (-weight) * (e * precision);
    if (power_of_f_ > 0) by_f_total = by_f_total + double(power_of_f_) * (by_lambda * inverse_f_);

    // Second derivatives in (f, lambda), at the cell's d.
    const double p = power_of_f_, inverse = inverse_f_.value();
    const double by_f_lambda = 2.0 * weight * e.value() * precision.value();
    const double by_lambda_lambda = 2.0 * chi_sq.value();
    alpha_alpha = weight * precision.value() + 2.0 * p * by_f_lambda * inverse +
                  p * (p * by_lambda_lambda - by_lambda.value()) * inverse * inverse;
    alpha_tau = by_f_lambda + p * by_lambda_lambda * inverse;
    tau_tau = by_lambda_lambda - (polynomial_law_ ? by_lambda.value() : 0.0);

    // Expected information of the same.
    const double slope = f.first() + effect_slope, lambda_slope = lambda.first();
    fisher_d_d = weight * precision.value() * slope * slope + 2.0 * count * lambda_slope * lambda_slope;
    fisher_d_alpha = weight * precision.value() * slope + 2.0 * count * lambda_slope * p * inverse;
    fisher_d_tau = 2.0 * count * lambda_slope;
    fisher_alpha_alpha = weight * precision.value() + 2.0 * count * p * p * inverse * inverse;
    fisher_alpha_tau = 2.0 * count * p * inverse;
    fisher_tau_tau = 2.0 * count;
    return true;
  }

  int coefficients() const { return coefficients_; }
  int noise_parameters() const { return noise_parameters_; }

  /// dq/dalpha_i as a series in d.
  Taylor<N> by_alpha(int i) const { return power[i] * by_f_total; }
  /// dq/dtau_j as a series in d.
  Taylor<N> by_tau(int j) const { return polynomial_law_ ? by_lambda * (power[j] * inverse_s_) : by_lambda; }
  /// dlambda/dtau_j at the cell's d.
  double tau_slope(int j) const { return polynomial_law_ ? power[j].value() * inverse_s_.value() : 1.0; }

  Taylor<N> cost;                                 ///< q as a series in d
  std::array<Taylor<N>, max_coefficients> power;  ///< d^i as a series in d
  /// d2q/dalpha_i dalpha_j = alpha_alpha d^(i+j); dalpha_i dtau_j: alpha_tau d^i tau_slope(j); dtau_i dtau_j likewise.
  double alpha_alpha = 0.0, alpha_tau = 0.0, tau_tau = 0.0;
  double fisher_d_d = 0.0, fisher_d_alpha = 0.0, fisher_d_tau = 0.0;
  double fisher_alpha_alpha = 0.0, fisher_alpha_tau = 0.0, fisher_tau_tau = 0.0;

 private:
  void powers(double d, int count) {
    power[0] = Taylor<N>::constant(1.0);
    for (int i = 1; i < count; ++i) {  // (d + h)^i = (d + h) (d + h)^(i-1)
      power[i].c[0] = d * power[i - 1].c[0];
      for (int k = 1; k <= N; ++k) power[i].c[k] = d * power[i - 1].c[k] + power[i - 1].c[k - 1];
    }
  }

  int coefficients_ = 0, noise_parameters_ = 0, power_of_f_ = 0;
  bool polynomial_law_ = false;
  Taylor<N> by_lambda, by_f_total, inverse_f_, inverse_s_;
};

}  // namespace rangecal
