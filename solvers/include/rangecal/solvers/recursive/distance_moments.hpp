// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/recursive/distance_bins.hpp"

namespace rangecal {

/// What a likelihood y ~ N(f(d), s(d)^2) needs to know about any number of pairs, whatever f and s are, as long as they
/// are smooth. A bin of distances with centre c and half width h keeps
///
///   M_jk = sum_i w_i z_i^j T_k(u_i),   j = 0, 1, 2,  k = 0 .. 7,   z = y - d,  u = (d - c) / h,
///
/// T_k Chebyshev's polynomials. A smooth function g on the bin is its interpolant at the roots u_q of T_8 up to some
/// 1e-11, so that
///
///   sum_i w_i z_i^j g(d_i) = sum_q W_jq g(d_q),   W_jq = sum_k (2 - [k = 0]) / 8 M_jk T_k(u_q)
///
/// (Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, ch. 3, 4, 8: a bin of ratio 1.15 has its
/// nearest singularity, d = 0, on the ellipse rho = 28.6, and 28.6^-8 = 2e-12). The W_jq make weighted cells at 8
/// distances a bin, some with negative weight, which pairs_nll and pairs_derivatives take as they are.
class DistanceMoments {
 public:
  static constexpr int degree = 8;

  DistanceMoments(double low_m, double high_m);

  bool holds(double d) const { return places_.hold(d); }
  /// Precondition: holds(d). Cost: 40 multiplications.
  void add(double d, double y, double weight);
  void scale(double factor);  ///< of every weight

  /// The cells, weights multiplied by `factor`, without the constants of the NLL. With `squared`, cells that count by
  /// the squares of the weights instead: for the information alone.
  PairsProblem cells(double factor, bool squared = false) const;

  struct Bin {
    /// M_0k, M_1k, M_2k, and sum w^2 T_k.
    std::array<std::array<double, degree>, 4> sums{};
  };
  std::vector<Bin> bins;
  std::int64_t used = 0;

 private:
  DistanceBins places_;
};

}  // namespace rangecal
