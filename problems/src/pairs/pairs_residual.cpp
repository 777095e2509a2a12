// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/pairs/pairs_residual.hpp"

#include <cmath>

#include "rangecal/core/polynomial.hpp"

namespace rangecal {

double PairsResidual::spread(const Eigen::Ref<const Eigen::VectorXd>& alpha,
                             const Eigen::Ref<const Eigen::VectorXd>& noise) const {
  if (!has_sigma(law)) return evaluate_polynomial(noise, d);
  const Noise with_sigma{law, Eigen::VectorXd::Constant(1, std::exp(noise[0]))};
  return with_sigma.spread(d, evaluate_polynomial(alpha, d));
}

bool PairsResidual::evaluate(const Eigen::Ref<const Eigen::VectorXd>& alpha,
                             const Eigen::Ref<const Eigen::VectorXd>& noise, double* residuals,
                             double* in_alpha, double* in_noise) const {
  const double f = evaluate_polynomial(alpha, d);
  const double s = spread(alpha, noise);
  if (!(s > s_floor)) return false;
  const double root_count = std::sqrt(count);
  residuals[0] = root_count * (mean_m - f) / s;
  residuals[1] = root_count * std::sqrt(mean_square) / s;
  residuals[2] = root_count * std::sqrt(2.0 * std::log(s / s_floor));

  // In the spread: d r0 = -r0 ds/s, d r1 = -r1 ds/s, d r2 = R ds / (s r2).
  const double in_log_s[3] = {-residuals[0], -residuals[1], count / residuals[2]};
  if (in_alpha) {
    const double log_s_in_f = form_of(law).power_of_f / f;
    const Eigen::Index n = alpha.size();
    double power = 1.0;
    for (Eigen::Index j = 0; j < n; ++j, power *= d) {
      in_alpha[j] = (-root_count / s + in_log_s[0] * log_s_in_f) * power;
      in_alpha[n + j] = in_log_s[1] * log_s_in_f * power;
      in_alpha[2 * n + j] = in_log_s[2] * log_s_in_f * power;
    }
  }
  if (in_noise) {
    const Eigen::Index m = noise.size();
    double log_s_in_parameter = !has_sigma(law) ? 1.0 / s : 1.0;
    for (Eigen::Index j = 0; j < m; ++j, log_s_in_parameter *= d) {
      for (int row = 0; row < 3; ++row) in_noise[row * m + j] = in_log_s[row] * log_s_in_parameter;
    }
  }
  return true;
}

}  // namespace rangecal
