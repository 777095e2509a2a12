// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_kernel.hpp"

namespace rangecal::pairs_ml {
namespace {

using Select = KernelFunction (*)(KernelLaw, int, bool, bool);

Select widest() {
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return &avx512::select;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return &avx2::select;
#endif
  return &baseline::select;
}

}  // namespace

void KernelSums::add(const KernelSums& other, int order) {
  for (int k = 0; k <= order; ++k) {
    gradient[k] += other.gradient[k];
    cross[k] += other.cross[k];
    information_cross[k] += other.information_cross[k];
  }
  for (int k = 0; k <= 2 * order; ++k) {
    hessian[k] += other.hessian[k];
    information[k] += other.information[k];
  }
  square += other.square;
  log_f += other.log_f;
  count += other.count;
  min_f = other.min_f < min_f ? other.min_f : min_f;
}

void run_kernel(const KernelInput& input, KernelLaw law, int order, bool single, bool information,
                KernelSums& sums) {
  static const Select select = widest();
  select(law, order, single, information)(input, sums);
}

}  // namespace rangecal::pairs_ml
