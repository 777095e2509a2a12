// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "rangecal/core/noise.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/recursive/distance_bins.hpp"

namespace rangecal {

/// What a likelihood of any noise shape, sum w log g((y - f(d)) / s(d)), needs to know about any number of pairs: g is no
/// polynomial in y, so that moments over the distance (DistanceMoments) do not do. Each bin of distances sorts its readings
/// into cells by their residual about a reference curve r of spread t,
///
///   v = (y - r) / t,   r = d + a + b u + c u^2,   t = spread (1 + growth u) [m],   u the place in the bin,
///
/// of width 1/2 up to |v| = 5 and of equal ratio 1.5 beyond, 1e6 at most. With z = y - d a cell keeps
///
///   sum w,  sum w^2,  sum w (u, z),  sum w (u^2, u z, z^2)
///
/// and stands for four points of a quarter of its weight each, at its mean +- sqrt(2) times the columns of the Cholesky
/// factor of its covariance: what is of third order in (u, z) and has no skew within a cell is summed exactly, the fourth
/// moment of a cell that is filled evenly is that of the points but for a tenth.
///
/// A bin's first 64 readings are kept as they came. The reference is then the curve fitted to all (`refer_to`), or before
/// there is one the line of Theil and Sen through them with t from the median deviation; it is replaced by a later curve
/// where it lies half a spread or more from that. It decides how fine the cells are, not what they say.
class ResidualCells {
 public:
  ResidualCells(double low_m, double high_m);

  /// Precondition: low_m <= d <= high_m.
  void add(double d, double y, double weight);
  void scale(double factor);  ///< of every weight
  void refer_to(const Eigen::VectorXd& alpha, const Noise& noise);

  /// The points, weights multiplied by `factor`; with sums of squares unless every weight is 1 (`weighted`).
  PairsProblem points(double factor, bool weighted) const;

  struct Cell {
    int place = 0;  ///< number of its interval of v
    /// sum w, w^2, w u, w z, w u^2, w u z, w z^2.
    std::array<double, 7> sums{};
  };
  struct Reading {
    double d, y, weight;
  };
  struct Reference {
    double a = 0.0, b = 0.0, c = 0.0, spread = 0.0, growth = 0.0;

    double offset_at(double u) const { return a + u * (b + u * c); }
    double spread_at(double u) const { return spread * (1.0 + growth * u); }
  };
  struct Bin {
    std::vector<Reading> first;  ///< as they came, while there is no reference
    Reference reference;         ///< spread = 0: there is none yet
    std::vector<Cell> cells;     ///< ascending in place
  };
  std::vector<Bin> bins;
  Eigen::VectorXd alpha;  ///< of the curve last referred to; empty: none was
  Noise noise;            ///< the same

 private:
  DistanceBins places_;
};

}  // namespace rangecal
