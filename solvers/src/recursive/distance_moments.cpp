// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/distance_moments.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rangecal {
namespace {

/// T_k(u) for k = 0 .. 7.
std::array<double, DistanceMoments::degree> chebyshev(double u) {
  std::array<double, DistanceMoments::degree> t;
  t[0] = 1.0;
  t[1] = u;
  for (int k = 2; k < DistanceMoments::degree; ++k) t[k] = 2.0 * u * t[k - 1] - t[k - 2];
  return t;
}

}  // namespace

DistanceMoments::DistanceMoments(double low_m, double high_m) : places_(low_m, high_m) {
  bins.resize(places_.size());
}

void DistanceMoments::add(double d, double y, double weight) {
  const std::size_t index = places_.index_of(d);
  const auto t = chebyshev(places_[index].place_of(d));
  Bin& bin = bins[index];
  const double z = y - d;
  for (int k = 0; k < degree; ++k) {
    const double w = weight * t[k];
    bin.sums[0][k] += w;
    bin.sums[1][k] += w * z;
    bin.sums[2][k] += w * z * z;
    bin.sums[3][k] += w * weight;
  }
  ++used;
}

void DistanceMoments::scale(double factor) {
  for (Bin& bin : bins)
    for (int j = 0; j < 4; ++j)
      for (double& sum : bin.sums[j]) sum *= j < 3 ? factor : factor * factor;
}

PairsProblem DistanceMoments::cells(double factor, bool squared) const {
  PairsProblem problem;
  problem.single = false;
  for (std::size_t b = 0; b < bins.size(); ++b) {
    const Bin& bin = bins[b];
    const double total = bin.sums[squared ? 3 : 0][0];
    if (total == 0.0) continue;
    const DistanceBins::Bin at = places_[b];
    for (int q = 0; q < degree; ++q) {
      const double u = std::cos((q + 0.5) * std::numbers::pi / degree);
      const auto t = chebyshev(u);
      std::array<double, 4> W{};
      for (int j = 0; j < 4; ++j)
        for (int k = 0; k < degree; ++k) W[j] += (k == 0 ? 1.0 : 2.0) / degree * bin.sums[j][k] * t[k];
      const double weight = squared ? W[3] : W[0];
      if (std::abs(weight) < 1e-12 * total) continue;
      const double d = at.centre_m + at.half_width_m * u;
      const double z = squared ? 0.0 : W[1] / W[0];
      problem.true_m.push_back(d);
      problem.count.push_back(weight * (squared ? factor * factor : factor));
      problem.weight.push_back(problem.count.back());
      problem.mean_m.push_back(d + z);
      problem.mean_square.push_back(squared ? 0.0 : W[2] / W[0] - z * z);
    }
  }
  return problem;
}

}  // namespace rangecal
