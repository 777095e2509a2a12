// SPDX-License-Identifier: BSD-3-Clause
// The body of the streaming pass, included once per instruction set with KERNEL_NAMESPACE, KERNEL_WIDTH (doubles in a
// register) and the target set. There are always eight lanes, so that the order of summation does not depend on the processor.
// Narrower registers process them in groups, one group after the other, so that one group's sums stay in registers.

namespace rangecal::pairs_ml::KERNEL_NAMESPACE {
namespace {

constexpr int lanes = 8, width = KERNEL_WIDTH, groups = lanes / width;
using Vector [[gnu::vector_size(8 * width)]] = double;
using Bits [[gnu::vector_size(8 * width)]] = long long;
using Loaded [[gnu::vector_size(8 * width), gnu::aligned(8), gnu::may_alias]] = double;

#define RANGECAL_INLINE inline __attribute__((always_inline))

/// Adds the sum of the eight lanes; of_group(g) is group g's vector.
template <class OfGroup>
RANGECAL_INLINE void reduce(const OfGroup& of_group, double& sum) {
  double lane[lanes];
  for (int k = 0; k < lanes; ++k) lane[k] = of_group(k / width)[k % width];
  sum += ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

/// Powers t^1 .. t^m; power[0] is not set.
template <int m>
RANGECAL_INLINE void powers_of(const Vector& t, Vector* power) {
  if constexpr (m > 0) power[1] = t;
  for (int k = 2; k <= m; ++k) power[k] = power[k - 1] * t;
}

/// A product of positive factors, kept as mantissas in [1, 2) and binary exponents, so that one logarithm at the end is enough.
struct LongProduct {
  Vector mantissa = Vector{} + 1.0;
  Bits exponent = {};
  int splits = 0;

  RANGECAL_INLINE void split() {
    const Bits bits = reinterpret_cast<Bits>(mantissa);
    exponent += bits >> 52;
    ++splits;
    mantissa = reinterpret_cast<Vector>((bits & 0x000fffffffffffffLL) | 0x3ff0000000000000LL);
  }
  /// Multiplies `product` by the mantissas and adds the exponents to `twos`.
  void gather(double& product, double& twos) {
    split();
    twos -= 1023.0 * width * splits;
    for (int k = 0; k < width; ++k) {
      product *= mantissa[k];
      twos += static_cast<double>(exponent[k]);
    }
  }
};

/// Running sums of one pass. A cell adds with e = r / f, g = P f^2, z = q P and b = w e g + p z (terms below):
///   inverse   R i t^k      both   i b t^k      hessian   l_ff t^k      expected   E l_ff t^k
template <KernelLaw law, int n, bool information>
struct Lanes {
  Vector inverse[n + 1] = {}, both[n + 1] = {}, hessian[2 * n + 1] = {}, expected[2 * n + 1] = {};
  Vector square = {}, log_f = {}, min_f = Vector{} + 1e300;
  LongProduct product;
};

/// With q = w ((mean - f)^2 + mean_square), P = 1 / s^2, i = 1 / f, r = mean - f, R the count and s = sigma f^p:
///   l      = R (log sigma + p log f) + q P / 2
///   l_f    = R p i - w r P - p q P i                              = i (R p - b)
///   l_ff   = -R p i^2 + w P + 4 p w r P i + p (2p + 1) q P i^2   = i^2 (w g - R p + 4 p w e g + p (2p + 1) z)
///   l_f,ls = 2 (w r P + p q P i)                                 = 2 i b
///   E l_ff = R (P + 2 p^2 i^2) = R i^2 (g + 2 p^2),   E l_f,ls = 2 R p i
/// `plain`: a full vector of cells of count and weight 1 and no mean square.
template <KernelLaw law, int n, bool information, bool plain>
RANGECAL_INLINE void add_cells(const KernelInput& in, const double* d_at, const double* mean_at,
                               const double* mean_square_at, const double* count_at, const double* weight_at,
                               Lanes<law, n, information>& lane) {
  constexpr double p = law == KernelLaw::power1   ? 1.0
                       : law == KernelLaw::power2 ? 2.0
                       : law == KernelLaw::power3 ? 3.0
                                                  : 0.0;
  const Vector d = *reinterpret_cast<const Loaded*>(d_at), mean = *reinterpret_cast<const Loaded*>(mean_at);
  Vector mean_square = {}, count = {}, weight = {};
  if constexpr (!plain) {
    mean_square = *reinterpret_cast<const Loaded*>(mean_square_at);
    count = *reinterpret_cast<const Loaded*>(count_at);
    weight = *reinterpret_cast<const Loaded*>(weight_at);
  }
  const Vector t = (d - in.center) * in.inverse_half_width;
  Vector f = Vector{} + in.c[n];
  for (int k = n - 1; k >= 0; --k) f = f * t + in.c[k];
  const Vector r = mean - f;
  Vector power[2 * n + 1];
  powers_of<2 * n>(t, power);

  Vector both, l_ff;
  [[maybe_unused]] Vector e_ff;
  if constexpr (p > 0.0) {
    const Vector inverse = 1.0 / f;
    const Vector inverse_sq = inverse * inverse;
    Vector g = Vector{} + in.inverse_sigma_sq;
    if constexpr (law == KernelLaw::power2) g *= inverse_sq;
    if constexpr (law == KernelLaw::power3) g *= inverse_sq * inverse_sq;
    const Vector e = r * inverse;
    Vector eg = e * g;
    if constexpr (!plain) eg *= weight;
    Vector z = e * eg;
    if constexpr (!plain) z += weight * mean_square * (inverse_sq * g);
    const Vector b = eg + p * z;
    both = inverse * b;
    if constexpr (plain)
      l_ff = inverse_sq * ((g - p) + 4.0 * p * eg + p * (2.0 * p + 1.0) * z);
    else
      l_ff = inverse_sq * (weight * g - p * count + 4.0 * p * eg + p * (2.0 * p + 1.0) * z);
    lane.square += z;
    const Vector scaled = f * in.inverse_f_scale;
    if constexpr (plain) {
      lane.product.mantissa *= scaled;
    } else {
      for (int k = 0; k < width; ++k) lane.log_f[k] += count[k] * __builtin_log(scaled[k]);
    }
    lane.min_f = f < lane.min_f ? f : lane.min_f;
    const Vector counted = plain ? inverse : count * inverse;
    lane.inverse[0] += counted;
    for (int k = 1; k <= n; ++k) lane.inverse[k] += counted * power[k];
    if constexpr (information) e_ff = (plain ? inverse_sq : count * inverse_sq) * (g + 2.0 * p * p);
  } else {
    Vector precision = Vector{} + in.inverse_sigma_sq;
    if constexpr (law == KernelLaw::d_squared) precision /= (d * d) * (d * d);
    both = r * precision;
    l_ff = precision;
    if constexpr (!plain) {
      both *= weight;
      l_ff *= weight;
      lane.square += weight * mean_square * precision;
    }
    lane.square += r * both;
    if constexpr (information) e_ff = plain ? precision : count * precision;
  }
  lane.both[0] += both;
  for (int k = 1; k <= n; ++k) lane.both[k] += both * power[k];
  lane.hessian[0] += l_ff;
  for (int k = 1; k <= 2 * n; ++k) lane.hessian[k] += l_ff * power[k];
  if constexpr (information) {
    lane.expected[0] += e_ff;
    for (int k = 1; k <= 2 * n; ++k) lane.expected[k] += e_ff * power[k];
  }
}

template <KernelLaw law, int n, bool single, bool information>
void kernel(const KernelInput& in, KernelSums& sums) {
  constexpr double p = law == KernelLaw::power1   ? 1.0
                       : law == KernelLaw::power2 ? 2.0
                       : law == KernelLaw::power3 ? 3.0
                                                  : 0.0;
  Lanes<law, n, information> lane[groups];
  std::size_t i = in.begin;
  // A product of 32 factors near 1 cannot overflow; a block stays in the first-level cache for all groups.
  constexpr std::size_t block = 32;
  while (i + lanes <= in.end) {
    const std::size_t left = (in.end - i) / lanes, stop = i + lanes * (left < block ? left : block);
    for (int group = 0; group < groups; ++group) {
      Lanes<law, n, information> sum = lane[group];
      for (std::size_t at = i + group * width; at < stop; at += lanes) {
        if constexpr (single)
          add_cells<law, n, information, true>(in, in.d + at, in.mean + at, nullptr, nullptr, nullptr, sum);
        else
          add_cells<law, n, information, false>(in, in.d + at, in.mean + at, in.mean_square + at,
                                                in.count + at, in.weight + at, sum);
      }
      if constexpr (single && p > 0.0) sum.product.split();
      lane[group] = sum;
    }
    i = stop;
  }
  if (i < in.end) {
    // The last, incomplete vector: the free lanes are filled with cells of count and weight 0.
    double rest[5][lanes];
    for (std::size_t k = 0; k < lanes; ++k) {
      const bool taken = i + k < in.end;
      rest[0][k] = in.d[taken ? i + k : i];
      rest[1][k] = in.mean[taken ? i + k : i];
      rest[2][k] = !single && taken ? in.mean_square[i + k] : 0.0;
      rest[3][k] = !taken ? 0.0 : single ? 1.0 : in.count[i + k];
      rest[4][k] = !taken ? 0.0 : single ? 1.0 : in.weight[i + k];
    }
    for (int group = 0; group < groups; ++group) {
      const int at = group * width;
      add_cells<law, n, information, false>(in, rest[0] + at, rest[1] + at, rest[2] + at, rest[3] + at,
                                            rest[4] + at, lane[group]);
    }
  }
  if constexpr (single)
    sums.count += static_cast<double>(in.end - in.begin);
  else
    for (std::size_t k = in.begin; k < in.end; ++k) sums.count += in.count[k];

  for (int k = 0; k <= n; ++k) {
    double inverse = 0.0, both = 0.0;
    reduce([&](int group) { return lane[group].inverse[k]; }, inverse);
    reduce([&](int group) { return lane[group].both[k]; }, both);
    sums.gradient[k] += p * inverse - both;
    sums.cross[k] += 2.0 * both;
    if constexpr (information) sums.information_cross[k] += 2.0 * p * inverse;
  }
  for (int k = 0; k <= 2 * n; ++k) {
    reduce([&](int group) { return lane[group].hessian[k]; }, sums.hessian[k]);
    if constexpr (information)
      reduce([&](int group) { return lane[group].expected[k]; }, sums.information[k]);
  }
  reduce([&](int group) { return lane[group].square; }, sums.square);
  reduce([&](int group) { return lane[group].log_f; }, sums.log_f);
  if constexpr (single && p > 0.0) {
    double product = 1.0, twos = 0.0;
    for (auto& group : lane) group.product.gather(product, twos);
    sums.log_f += __builtin_log(product) + 0.693147180559945309417 * twos;
  }
  for (const auto& group : lane)
    for (int k = 0; k < width; ++k) sums.min_f = group.min_f[k] < sums.min_f ? group.min_f[k] : sums.min_f;
}

template <KernelLaw law, int n>
KernelFunction pick(bool single, bool information) {
  if (single) return information ? &kernel<law, n, true, true> : &kernel<law, n, true, false>;
  return information ? &kernel<law, n, false, true> : &kernel<law, n, false, false>;
}

template <KernelLaw law>
KernelFunction pick(int order, bool single, bool information) {
  switch (order) {
    case 0:
      return pick<law, 0>(single, information);
    case 1:
      return pick<law, 1>(single, information);
    case 2:
      return pick<law, 2>(single, information);
    case 3:
      return pick<law, 3>(single, information);
    default:
      return pick<law, 4>(single, information);
  }
}

}  // namespace

KernelFunction select(KernelLaw law, int order, bool single, bool information) {
  switch (law) {
    case KernelLaw::power0:
      return pick<KernelLaw::power0>(order, single, information);
    case KernelLaw::power1:
      return pick<KernelLaw::power1>(order, single, information);
    case KernelLaw::power2:
      return pick<KernelLaw::power2>(order, single, information);
    case KernelLaw::power3:
      return pick<KernelLaw::power3>(order, single, information);
    default:
      return pick<KernelLaw::d_squared>(order, single, information);
  }
}

}  // namespace rangecal::pairs_ml::KERNEL_NAMESPACE
