#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The quantiles of solvers/src/statistics/kurtosis_law.cpp, printed as they stand there; NumPy alone, hours for all counts.

    benchmarks/kurtosis_table.py                    # every count of the table
    benchmarks/kurtosis_table.py 100 --values 3e7   # one count, draws for a tenth of the values: minutes

b = n sum z^4 / (sum z^2)^2 of n independent normal z. Both tails are drawn from a mixture of densities g_j, one for each distance
into the tail, and weighed by the normal density over the mixture's (the balance heuristic):

  upper:  P(b > t) = n E[P(the n-th square is the largest and makes b > t | the other n - 1)] (Asmussen and Kroese 2006), the others
          from g_j ~ phi(z) exp(theta_j min(He4(z), cap_j)), He4 = z^4 - 6 z^2 + 3, theta_j = j / sqrt(24 n);
  lower:  P(b < t) = E[b < t], all n from g_j ~ phi(z) exp(-theta_j z^4 + a_j z^2), theta_j, a_j such that E z^2 = 1 and the
          kurtosis lies j standard deviations below its mean.

The score of t is the normal quantile of its probability: from the lower tail below -1/2, from the upper one above 1/2, between
them a mean of both with weights that change evenly. Beside each row: the relative standard errors at scores of -5, -3, 3 and 5.
"""
import argparse
import math
import statistics

import numpy as np

COUNTS = [20, 30, 45, 65, 100, 150, 220, 300, 500, 750, 1500, 3000, 10000, 30000, 100000]
SCORES = np.arange(-6.5, 6.51, 0.5)
UPPER_LEVELS = [-0.8]  # standard deviations of b from its mean, finer near it
while UPPER_LEVELS[-1] < 70:
    UPPER_LEVELS.append(UPPER_LEVELS[-1] + 0.05 + 0.02 * max(UPPER_LEVELS[-1], 0.0))
UPPER_LEVELS = np.array(UPPER_LEVELS)
LOWER_LEVELS = np.arange(-8.0, 0.8, 0.02)
FAR = 12.0  # no |z| beyond it
ROOTS = np.linspace(0.0, 37.0, 100001)
LOG_BEYOND = np.log([math.erfc(r / math.sqrt(2.0)) for r in ROOTS])


def moments(n):
    mean = 3 * n / (n + 2)
    return mean, np.sqrt(24 * n**2 * (n - 1) / ((n + 2) ** 2 * (n + 4) * (n + 6)))


class Density:
    """phi(z) exp(theta m(z)) / c, m a function of z^2; drawn by its inverse in two tables, the second for the last part."""

    def __init__(self, exponent):
        self.exponent = exponent  # of z^2: theta m
        z = np.linspace(0.0, FAR, 400001)
        log_density = exponent(z * z) - 0.5 * z * z
        self.top = log_density.max()
        density = np.exp(log_density - self.top)
        steps = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        self.log_c = np.log(2 * steps[-1] * z[1] / np.sqrt(2 * np.pi)) + self.top
        self.parts = 1 << 14
        share = steps / steps[-1]
        keep = np.concatenate([[True], np.diff(share) > 0])
        self.inverse = np.interp(np.arange(self.parts + 1) / self.parts, share[keep], z[keep])
        self.last = np.interp(1 - 1 / self.parts + np.arange(self.parts + 1) / self.parts**2, share[keep], z[keep])

    def squares(self, shape, random):
        at = random.random(shape) * self.parts
        part = at.astype(np.int64)
        rest = at - part
        z = self.inverse[part] + rest * (self.inverse[part + 1] - self.inverse[part])
        end = part == self.parts - 1
        finer = rest[end] * self.parts
        part = finer.astype(np.int64)
        z[end] = self.last[part] + (finer - part) * (self.last[part + 1] - self.last[part])
        return z * z


def hermite(q):
    return q * q - 6 * q + 3


def upper_densities(n):
    densities = [Density(lambda q: 0 * q)]
    for j in range(1, 7):
        theta = j / np.sqrt(24 * n)
        largest = min(np.sqrt(3 + 1 / (4 * theta)), 4.5)
        cap = max(hermite(largest**2), 10.0)
        densities.append(Density(lambda q, theta=theta, cap=cap: theta * np.minimum(hermite(q), cap)))
    return densities


def quartic(theta):
    """a with E z^2 = 1 under phi(z) exp(-theta z^4 + a z^2), and the kurtosis of z there."""
    q = np.linspace(0.0, 8.0, 4001) ** 2
    low, high = -2.0, 8 * theta + 2
    for _ in range(60):
        a = 0.5 * (low + high)
        exponent = -theta * q * q + (a - 0.5) * q
        density = np.exp(exponent - exponent.max())
        density[0] *= 0.5
        second = (density * q).sum() / density.sum()
        low, high = (low, a) if second > 1 else (a, high)
    return a, (density * q * q).sum() / density.sum() / second**2


def lower_densities(n):
    mean, deviation = moments(n)
    densities = [Density(lambda q: 0 * q)]
    for j in range(1, 8):
        kurtosis = 1 + (mean - 1) * np.exp(-j * deviation / (mean - 1))
        low, high = 0.0, 200.0
        for _ in range(50):
            theta = np.sqrt(low * high) if low > 0 and high > 2 * low else 0.5 * (low + high)
            low, high = (theta, high) if quartic(theta)[1] > kurtosis else (low, theta)
        a = quartic(theta)[0]
        densities.append(Density(lambda q, theta=theta, a=a: -theta * q * q + a * q))
    return densities


def beyond(u):
    """P(chi^2 with one degree of freedom > u) by interpolation of its logarithm in sqrt(u)."""
    return np.exp(np.interp(np.sqrt(np.maximum(u, 0.0)), ROOTS, LOG_BEYOND))


def largest_makes(n, level, second, fourth, largest):
    """n P(one more square u is the largest and n (S4 + u^2) / (S2 + u)^2 > t): (n - t) u^2 - 2 t S2 u + n S4 - t S2^2 > 0."""
    mean, deviation = moments(n)
    t = mean + deviation * level
    if t >= n:
        return np.zeros_like(second)
    a, half = n - t, t * second
    square = half * half - a * (n * fourth - t * second * second)
    root = np.sqrt(np.maximum(square, 0.0))
    high, low = (half + root) / a, (half - root) / a
    some = beyond(np.maximum(largest, high))
    some += np.where(low > largest, beyond(largest) - beyond(low), 0.0)
    return n * np.where(square < 0, beyond(largest), some)


def tail(n, upper, values, random):
    """Probabilities at the levels and their standard errors."""
    densities = upper_densities(n) if upper else lower_densities(n)
    levels = UPPER_LEVELS if upper else LOWER_LEVELS
    size = n - 1 if upper else n
    rounds = max(1, round(values / n / len(densities)))
    at_once = max(1, min(rounds, 2000000 // size))
    total, square, count = np.zeros(len(levels)), np.zeros(len(levels)), 0
    mean, deviation = moments(n)
    for _ in range(-(-rounds // at_once)):
        for drawn in densities:
            q = drawn.squares((at_once, size), random)
            second, fourth, largest = q.sum(1), (q * q).sum(1), q.max(1)
            logs = [g.exponent(q).sum(1) - size * g.log_c for g in densities]
            weight = len(densities) / np.exp(np.minimum(logs, 600.0)).sum(0)
            kurtosis = n * fourth / second**2
            for i, level in enumerate(levels):
                if upper:
                    one = weight * largest_makes(n, level, second, fourth, largest)
                else:
                    one = weight * (kurtosis < mean + deviation * level)
                total[i] += one.sum()
                square[i] += (one * one).sum()
            count += at_once
    p = total / count
    return p, np.sqrt(np.maximum(square / count - p * p, 0.0) / count)


def quantiles(n, values, seed):
    """(b - E b) / sqrt(var b) at SCORES, and relative errors of the probabilities at scores of -5, -3, 3, 5."""
    random = np.random.default_rng([seed, n])
    normal = statistics.NormalDist()
    found, errors = {}, {}
    for upper in (False, True):
        p, error = tail(n, upper, values, random)
        known = (p > 0) & (error < 0.35 * p)
        scores = np.array([normal.inv_cdf(min(one, 0.9999)) for one in p[known]])
        scores = -scores if upper else scores
        levels = (UPPER_LEVELS if upper else LOWER_LEVELS)[known]
        found[upper] = np.interp(SCORES, scores, levels)
        relative = np.interp(SCORES, scores, (error / np.maximum(p, 1e-300))[known])
        errors.update({score: relative[np.argmin(abs(SCORES - score))] for score in ((3, 5) if upper else (-5, -3))})
    share = np.clip(SCORES + 0.5, 0.0, 1.0)
    return (1 - share) * found[False] + share * found[True], [errors[score] for score in (-5, -3, 3, 5)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("counts", type=int, nargs="*", default=COUNTS, help="n, default: those of the table")
    parser.add_argument("--values", type=float, default=3e8, help="normal values drawn for each tail of a count")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for n in options.counts:
        values, errors = quantiles(n, max(options.values, 8000.0 * n), options.seed)
        print("    {%.1f, {%s}},  // errors %s" % (n, ", ".join("%.3f" % v for v in values),
              ", ".join("%.1f %%" % (100 * e) for e in errors)), flush=True)


if __name__ == "__main__":
    main()
