// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace rangecal::pairs_ml {

/// The laws the streaming kernel knows: s = sigma |f|^p for p = 0 .. 3, and s = sigma d^2.
enum class KernelLaw { power0, power1, power2, power3, d_squared };

inline constexpr int kernel_max_order = 4;

/// One pass over cells [begin, end). f = sum_k c_k t^k with t = (d - center) inverse_half_width, dimensionless in
/// [-1, 1]; sigma enters as 1 / sigma^2.
struct KernelInput {
  const double *d = nullptr, *mean = nullptr;
  const double *mean_square = nullptr, *count = nullptr, *weight = nullptr;  // not read where single
  std::size_t begin = 0, end = 0;
  double center = 0.0, inverse_half_width = 1.0;
  double c[kernel_max_order + 1] = {};
  double inverse_sigma_sq = 1.0;
  double inverse_f_scale = 1.0;  // 1 / a typical f, so that products of f stay within the exponents
};

/// Sums of the pass, with l the likelihood of a cell and sums over powers t^k:
struct KernelSums {
  double gradient[kernel_max_order + 1] = {};           // sum l_f t^k, k = 0 .. n
  double hessian[2 * kernel_max_order + 1] = {};        // sum l_ff t^k, k = 0 .. 2n
  double cross[kernel_max_order + 1] = {};              // sum l_f,logsigma t^k
  double information[2 * kernel_max_order + 1] = {};    // the expectation of hessian
  double information_cross[kernel_max_order + 1] = {};  // the expectation of cross
  double square = 0.0;                                  // sum w ((mean - f)^2 + mean_square) / (s^2)
  double log_f = 0.0;                                   // sum count log(f inverse_f_scale), laws of power > 0
  double count = 0.0;
  double min_f = 1e300;

  void add(const KernelSums& other, int order);
};

/// Runs the pass with the widest instructions of this processor. order in 0 .. kernel_max_order. `single`: every
/// cell has count and weight 1 and no mean square. `information`: the expected sums too.
void run_kernel(const KernelInput& input, KernelLaw law, int order, bool single, bool information,
                KernelSums& sums);

using KernelFunction = void (*)(const KernelInput&, KernelSums&);
namespace baseline {
KernelFunction select(KernelLaw law, int order, bool single, bool information);
}
namespace avx2 {
KernelFunction select(KernelLaw law, int order, bool single, bool information);
}
namespace avx512 {
KernelFunction select(KernelLaw law, int order, bool single, bool information);
}

}  // namespace rangecal::pairs_ml
