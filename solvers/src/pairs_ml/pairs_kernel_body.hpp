// SPDX-License-Identifier: BSD-3-Clause
// The body of the streaming pass, included once per instruction set with KERNEL_NAMESPACE and the target set.
// Eight lanes everywhere, so that the order of summation does not depend on the processor.

namespace rangecal::pairs_ml::KERNEL_NAMESPACE {
namespace {

constexpr int lanes = 8;
typedef double Vector __attribute__((vector_size(64)));
typedef double Loaded __attribute__((vector_size(64), aligned(8), may_alias));

#define RANGECAL_INLINE inline __attribute__((always_inline))

RANGECAL_INLINE void reduce(const Vector& vector, double& sum) {
  sum += ((vector[0] + vector[4]) + (vector[2] + vector[6])) + ((vector[1] + vector[5]) + (vector[3] + vector[7]));
}

RANGECAL_INLINE void gather(const double* from, std::size_t stride, std::size_t taken, double rest, double* to) {
  for (std::size_t k = 0; k < lanes; ++k) to[k] = k < taken ? from[k * stride] : rest;
}

/// With q = w ((mean - f)^2 + mean_square), P = 1 / s^2, i = 1 / f, r = mean - f, R the count and s = sigma f^p:
///   l      = R (log sigma + p log f) + q P / 2
///   l_f    = R p i - w r P - p q P i
///   l_ff   = -R p i^2 + w P + 4 p w r P i + p (2p + 1) q P i^2
///   l_f,ls = 2 (w r P + p q P i)
///   E l_ff = R (P + 2 p^2 i^2),   E l_f,ls = 2 R p i
template <KernelLaw law, int n, bool single, bool information>
void kernel(const KernelInput& in, KernelSums& sums) {
  constexpr double p = law == KernelLaw::power1 ? 1.0 : law == KernelLaw::power2 ? 2.0
                     : law == KernelLaw::power3 ? 3.0 : 0.0;
  constexpr bool power = p > 0.0;
  const Vector zero = {};
  const Vector one = zero + 1.0;
  Vector gradient[n + 1], hessian[2 * n + 1], cross[n + 1], expected[2 * n + 1], expected_cross[n + 1];
  for (int k = 0; k <= n; ++k) gradient[k] = cross[k] = expected_cross[k] = zero;
  for (int k = 0; k <= 2 * n; ++k) hessian[k] = expected[k] = zero;
  Vector square = zero, count_sum = zero, product = one, min_f = zero + 1e300, log_f = zero;
  int products = 0;
  double staged[5][lanes];

  const std::size_t step = lanes * in.stride;
  for (std::size_t i = in.begin; i < in.end; i += step) {
    Vector d, mean, mean_square = zero, count = one, weight = one, inside = one;
    if (in.stride == 1 && i + lanes <= in.end) {
      d = *reinterpret_cast<const Loaded*>(in.d + i);
      mean = *reinterpret_cast<const Loaded*>(in.mean + i);
      if constexpr (!single) {
        mean_square = *reinterpret_cast<const Loaded*>(in.mean_square + i);
        count = *reinterpret_cast<const Loaded*>(in.count + i);
        weight = *reinterpret_cast<const Loaded*>(in.weight + i);
      }
    } else {
      const std::size_t left = (in.end - i + in.stride - 1) / in.stride;
      const std::size_t taken = left < lanes ? left : lanes;
      gather(in.d + i, in.stride, taken, in.d[i], staged[0]);
      gather(in.mean + i, in.stride, taken, in.mean[i], staged[1]);
      d = *reinterpret_cast<const Loaded*>(staged[0]);
      mean = *reinterpret_cast<const Loaded*>(staged[1]);
      for (std::size_t k = 0; k < lanes; ++k) inside[k] = k < taken ? 1.0 : 0.0;
      if constexpr (!single) {
        gather(in.mean_square + i, in.stride, taken, 0.0, staged[2]);
        gather(in.count + i, in.stride, taken, 0.0, staged[3]);
        gather(in.weight + i, in.stride, taken, 0.0, staged[4]);
        mean_square = *reinterpret_cast<const Loaded*>(staged[2]);
        count = *reinterpret_cast<const Loaded*>(staged[3]);
        weight = *reinterpret_cast<const Loaded*>(staged[4]);
      } else {
        count = weight = inside;
      }
    }

    const Vector t = (d - in.center) * in.inverse_half_width;
    Vector f = zero + in.c[n];
    for (int k = n - 1; k >= 0; --k) f = f * t + in.c[k];
    const Vector r = mean - f;
    const Vector w_r = weight * r;
    Vector q = w_r * r;
    if constexpr (!single) q += weight * mean_square;

    Vector precision = zero + in.inverse_sigma_sq;
    Vector l_f, l_ff, l_fs;
    [[maybe_unused]] Vector e_ff, e_fs;
    if constexpr (power) {
      const Vector inverse = 1.0 / f;
      const Vector inverse_sq = inverse * inverse;
      precision *= law == KernelLaw::power1 ? inverse_sq
                 : law == KernelLaw::power2 ? inverse_sq * inverse_sq : inverse_sq * inverse_sq * inverse_sq;
      const Vector white = w_r * precision;
      const Vector qp = q * precision;
      const Vector qpi = p * qp * inverse;
      const Vector both = white + qpi;
      const Vector rpi = p * count * inverse;
      l_f = rpi - both;
      l_fs = 2.0 * both;
      l_ff = weight * precision + inverse * ((4.0 * p) * white + (2.0 * p + 1.0) * qpi - rpi);
      square += qp;
      const Vector scaled = f * in.inverse_f_scale;
      if constexpr (single) {
        product *= in.stride == 1 && i + lanes <= in.end ? scaled : inside * scaled + (1.0 - inside);
        if (++products == 32) {
          for (int k = 0; k < lanes; ++k) log_f[k] += __builtin_log(product[k]);
          product = one;
          products = 0;
        }
      } else {
        for (int k = 0; k < lanes; ++k) log_f[k] += count[k] * __builtin_log(scaled[k]);
      }
      min_f = f < min_f ? f : min_f;
      if constexpr (information) {
        e_ff = count * (precision + (2.0 * p * p) * inverse_sq);
        e_fs = 2.0 * rpi;
      }
    } else {
      if constexpr (law == KernelLaw::d_squared) precision /= (d * d) * (d * d);
      const Vector white = w_r * precision;
      l_f = -white;
      l_fs = 2.0 * white;
      l_ff = weight * precision;
      square += q * precision;
      if constexpr (information) { e_ff = count * precision; e_fs = zero; }
    }
    count_sum += count;

    for (int k = 0; k <= 2 * n; ++k) {
      hessian[k] += l_ff;
      if (k < 2 * n) l_ff *= t;
    }
    for (int k = 0; k <= n; ++k) {
      gradient[k] += l_f;
      cross[k] += l_fs;
      if (k < n) { l_f *= t; l_fs *= t; }
    }
    if constexpr (information) {
      for (int k = 0; k <= 2 * n; ++k) { expected[k] += e_ff; e_ff *= t; }
      for (int k = 0; k <= n; ++k) { expected_cross[k] += e_fs; e_fs *= t; }
    }
  }

  if constexpr (power && single) {
    for (int k = 0; k < lanes; ++k) log_f[k] += __builtin_log(product[k]);
  }
  for (int k = 0; k <= n; ++k) {
    reduce(gradient[k], sums.gradient[k]);
    reduce(cross[k], sums.cross[k]);
    reduce(expected_cross[k], sums.information_cross[k]);
  }
  for (int k = 0; k <= 2 * n; ++k) {
    reduce(hessian[k], sums.hessian[k]);
    reduce(expected[k], sums.information[k]);
  }
  reduce(square, sums.square);
  reduce(count_sum, sums.count);
  reduce(log_f, sums.log_f);
  for (int k = 0; k < lanes; ++k) sums.min_f = min_f[k] < sums.min_f ? min_f[k] : sums.min_f;
}

template <KernelLaw law, int n>
KernelFunction pick(bool single, bool information) {
  if (single) return information ? &kernel<law, n, true, true> : &kernel<law, n, true, false>;
  return information ? &kernel<law, n, false, true> : &kernel<law, n, false, false>;
}

template <KernelLaw law>
KernelFunction pick(int order, bool single, bool information) {
  switch (order) {
    case 0: return pick<law, 0>(single, information);
    case 1: return pick<law, 1>(single, information);
    case 2: return pick<law, 2>(single, information);
    case 3: return pick<law, 3>(single, information);
    default: return pick<law, 4>(single, information);
  }
}

}  // namespace

KernelFunction select(KernelLaw law, int order, bool single, bool information) {
  switch (law) {
    case KernelLaw::power0: return pick<KernelLaw::power0>(order, single, information);
    case KernelLaw::power1: return pick<KernelLaw::power1>(order, single, information);
    case KernelLaw::power2: return pick<KernelLaw::power2>(order, single, information);
    case KernelLaw::power3: return pick<KernelLaw::power3>(order, single, information);
    default: return pick<KernelLaw::d_squared>(order, single, information);
  }
}

}  // namespace rangecal::pairs_ml::KERNEL_NAMESPACE
