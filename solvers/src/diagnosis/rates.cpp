// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rates.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal::diagnosis {

double log_of_smallest(double log_p, double n) {
  if (log_p < -30.0) return std::min(0.0, log_p + std::log(n));
  const double p = std::min(std::exp(log_p), 1.0 - 1e-16);
  return std::log(std::max(-std::expm1(n * std::log1p(-p)), 1e-300));
}

double Rates::starts(const std::string& family) const {
  const auto found = within.find(family);
  return found == within.end() ? 1.0 : found->second;
}

double Rates::in_family(const std::string& family, double log_p) const {
  return log_of_smallest(log_p, starts(family));
}

double Rates::standardised(const std::string& test, double z) const {
  const auto found = scalars.find(test);
  return found == scalars.end() ? z : (z - found->second.mean) / found->second.std_dev;
}

double Rates::corrected(double log_p_f) const {
  const double far_out = std::exp(log_of_smallest(log_p_f, families));
  if (smallest.empty() || far_out < tail) return far_out;
  const auto above = std::upper_bound(smallest.begin(), smallest.end(), log_p_f);
  double rank = static_cast<double>(above - smallest.begin());
  if (above != smallest.begin() && above != smallest.end())
    rank += (log_p_f - *(above - 1)) / (*above - *(above - 1));
  if (rank == 0.0) return tail;
  const double draws = static_cast<double>(smallest.size());
  const double safe = std::min(std::sqrt(rank), tail * draws / std::sqrt(rank));
  return std::clamp((rank + safe) / draws, tail, 1.0);
}

double Rates::log_corrected(double log_p_f) const {
  constexpr double far_out = -30.0;  // far beyond the simulated law, whose point is 3 %
  const double log_p = log_of_smallest(log_p_f, families);
  return log_p < far_out ? log_p : std::log(corrected(log_p_f));
}

}  // namespace rangecal::diagnosis
