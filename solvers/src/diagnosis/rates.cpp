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

double Rates::corrected(const std::string& family, double log_p) const {
  return std::exp(log_of_smallest(in_family(family, log_p), families));
}

}  // namespace rangecal::diagnosis
