// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

namespace rangecal::diagnosis {

/// Third cumulants of the scores of log variances,
///   s_a = 1/2 sum_u x_ua (q_u - n_u),   q_u chi-square with n_u degrees of freedom,
///   kappa_abc = sum_u n_u x_ua x_ub x_uc,
/// a by b by c, c fastest; columns x normalised and orthogonal, so that the s_a have variance 1 and no correlation.
std::vector<double> third_cumulants(const std::vector<Eigen::VectorXd>& columns, const Eigen::VectorXd& dof);

/// The chi-square with as many degrees of freedom as there are scores that is as unlikely as these.
///
/// Their squared length T is that of normal scores. But a shape that rests on one or two units has the tail of their
/// chi-squares, e^-s and not e^(-s^2/2): a reading at three standard deviations made T = 30. Along the direction of the
/// scores the sum has the skewness gamma = sum kappa_abc s_a s_b s_c / |s|^3; where that is positive it is taken for a gamma
/// of that skewness, which it is where the units weigh the same, and turned into a normal score by Wilson and Hilferty 1931,
///   z = (6 / gamma) ((1 + gamma |s| / 2)^(1/3) - 1) + gamma / 6,
/// and the answer is min(T, z^2).
double skewed_chi_square(const Eigen::VectorXd& scores, const std::vector<double>& third_cumulants);

}  // namespace rangecal::diagnosis
