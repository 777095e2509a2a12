// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/solvers/fleet/population.hpp"

namespace rangecal {

/// A unit beside the n units kept that it is not one of.
struct UnitJudgement {
  double distance_sq = 0.0;  ///< from the others' mean, in their scatter: Hotelling's T^2
  Eigen::VectorXd t;         ///< of each coordinate of theta: Student's, n - 1 degrees of freedom
  double p_value = 1.0;      ///< of this unit alone; of a faultless one below x in a share of at most x
};

/// A unit is judged by the others: it would hide in the scatter that it makes itself (Wilks 1963, Sankhya A
/// 25, 407). With mu and V_mu of the n others, T_v = Sigma + Lambda_v^-1 and p = size(theta),
///
///   e_v = theta^_v - mu,   E_v = cov e_v = T_v - V_mu of the others, T_u + V_mu of the unit u,
///   r_v = L_v^-1 e_v,  L_v L_v^T = E_v,         W = (1 - 1/n) sum_v r_v r_v^T,    G = r_u^T W^-1 r_u,
///   z_vi = e_vi / sqrt(E_v,ii),                 W_i = (1 - 1/n) sum_v z_vi^2,     G_i = z_ui^2 / W_i,
///   T^2 = (n - 1) G,  G (n - p) / p ~ F(p, n - p),      t_i^2 = (n - 1) G_i,  t_i ~ t(n - 1).
///
/// Sigma is that of all units kept, and only weighs the readings of one unit against those of another: where
/// all have as many it cancels, and the laws are exact however wide the odd unit made it. The p-value is of
/// the smaller of two, that of G and that of the largest |t_i| of p, by Sidak (1967, J. Am. Stat. Assoc. 62,
/// 626): in a small fleet a unit off in one coordinate is found by its t, in a large one a unit off in their
/// combination by G.
class FleetJudge {
 public:
  /// The units that `population` was fitted to. Holds 100 of them at most: from more, all units kept serve,
  /// and a unit's own r r^T is taken from their W: G = B / (1 - B), B that of the W with it. Two passes. Throws
  /// InputError where the stream has another number of units than `population.outlying`, as for a population read
  /// from a file, which does not say which units it left out.
  FleetJudge(const UnitStream& units, const Population& population);

  /// The index-th unit of the stream, left out or not. Throws InputError where the stream had no such unit.
  UnitJudgement operator()(const UnitSummary& unit, std::size_t index) const;

 private:
  bool is_outlying(std::size_t index) const;
  [[noreturn]] void refuse_stream(const std::string& units) const;
  struct Scatter {
    double units = 0.0;
    Eigen::VectorXd mean;
    Eigen::MatrixXd mean_covariance, white;  ///< mu, V_mu, W
    Eigen::VectorXd each;                    ///< W_i
  };
  Scatter scatter_of(const UnitStream& units) const;
  UnitJudgement judge(const UnitSummary& unit, const Scatter& scatter, bool among) const;

  Eigen::MatrixXd Sigma_;
  std::vector<bool> outlying_;
  std::vector<std::pair<std::size_t, UnitSummary>> few_;
  Scatter all_;
};

}  // namespace rangecal
