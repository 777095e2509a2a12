// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>

namespace rangecal {

/// A truncated Taylor series in one variable: sum_k c[k] h^k, k = 0..N. The k-th derivative is k! c[k].
template <int N>
struct Taylor {
  std::array<double, N + 1> c{};

  static Taylor constant(double value) {
    Taylor t;
    t.c[0] = value;
    return t;
  }
  double value() const { return c[0]; }
  double first() const { return c[1]; }
  double second() const { return 2.0 * c[2]; }
  double third() const {
    static_assert(N >= 3);
    return 6.0 * c[3];
  }
};

template <int N>
Taylor<N> operator+(Taylor<N> a, const Taylor<N>& b) {
  for (int k = 0; k <= N; ++k) a.c[k] += b.c[k];
  return a;
}

template <int N>
Taylor<N> operator-(Taylor<N> a, const Taylor<N>& b) {
  for (int k = 0; k <= N; ++k) a.c[k] -= b.c[k];
  return a;
}

template <int N>
Taylor<N> operator*(double factor, Taylor<N> a) {
  for (double& coefficient : a.c) coefficient *= factor;
  return a;
}

template <int N>
Taylor<N> operator*(const Taylor<N>& a, const Taylor<N>& b) {
  Taylor<N> product;
  for (int i = 0; i <= N; ++i)
    for (int j = 0; i + j <= N; ++j) product.c[i + j] += a.c[i] * b.c[j];
  return product;
}

/// 1 / a
template <int N>
Taylor<N> reciprocal(const Taylor<N>& a) {
  Taylor<N> r;
  r.c[0] = 1.0 / a.c[0];
  for (int k = 1; k <= N; ++k) {
    double sum = 0.0;
    for (int j = 1; j <= k; ++j) sum += a.c[j] * r.c[k - j];
    r.c[k] = -r.c[0] * sum;
  }
  return r;
}

/// log a, given 1 / a
template <int N>
Taylor<N> log(const Taylor<N>& a, const Taylor<N>& inverse) {
  Taylor<N> l;
  l.c[0] = std::log(a.c[0]);
  for (int k = 1; k <= N; ++k) {  // (log a)' = a' / a
    double sum = 0.0;
    for (int j = 0; j < k; ++j) sum += (j + 1) * a.c[j + 1] * inverse.c[k - 1 - j];
    l.c[k] = sum / k;
  }
  return l;
}

}  // namespace rangecal
