#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Certified maximum likelihood estimates of twenty problems with known distances. README.md says what they are.

    certify.py data     writes data.csv: the readings, simulated once and rounded to the decimals that stand there
    certify.py solve    writes certified.json: estimates, standard deviations and NLL to 30 digits, from data.csv (mpmath)

Readings y_i at true distances d_i, y ~ N(f(d), s(d)^2), f = sum_j alpha_j d^j, s = sigma f^p d^q with f > 0
(docs/equations.md, 2016 eq. 17-20). Constants included,

    NLL(alpha, lambda) = sum_i [ lambda + p log f_i + q log d_i + u_i^2 / 2 + log(2 pi) / 2 ],
    lambda = log sigma,   u_i = (y_i - f_i) / (sigma f_i^p d_i^q).

Every reading is a term of its own. Derivatives with v = du/df = -1 / (sigma f^p d^q) - p u / f:

    by f: p / f + u v          by f, f: -p / f^2 + v^2 + u (p / (sigma f^p d^q f) - p v / f + p u / f^2)
    by lambda: 1 - u^2         by lambda, lambda: 2 u^2         by f, lambda: -2 u v
"""
import csv
import json
import math
import pathlib
import random
import sys

HERE = pathlib.Path(__file__).parent
POWERS = {"constant": (0, 0), "f": (1, 0), "f2": (2, 0), "f3": (3, 0), "d2": (0, 2)}  # p, q


def even(low, high, count):
    return [low + (high - low) * i / (count - 1) for i in range(count)]


SENSOR = (0.0525, 0.8838, 0.0584)  # the curve of Alhashimi 2021
# name, law, alpha, sigma, distances, readings at each, decimals of d, of y, what is hard about it
PROBLEMS = [
    ("mean", "constant", (1.7,), 0.01, even(0.5, 4, 30), 1, 4, 4, "an average, in closed form"),
    ("offset", "constant", (-20.0, 1.0, 1e-5), 0.02, even(1000, 1005, 60), 1, 3, 4, "distances 1000 to 1005 m, order 2"),
    ("quiet", "constant", (0.05, 0.9, 0.06, -0.004), 2e-7, even(0.2, 5, 80), 1, 4, 10, "noise of 0.2 um at 5 m"),
    ("five", "constant", (0.1, 0.8, 0.1, -0.02, 0.002), 0.005, even(0.5, 4.5, 5), 8, 4, 4, "as many distances as coefficients"),
    ("flat", "f", (2.3,), 0.05, even(1, 3, 12), 5, 4, 4, "f does not depend on the distance"),
    ("line", "f", (0.05, 0.95), 0.02, even(0.2, 5, 200), 1, 4, 4, "a plain one"),
    ("bend", "f", (0.1, 0.9, 0.05, -0.01), 0.3, even(0.3, 5, 400), 1, 4, 4, "noise of 30 %"),
    ("wave", "f", (0.2, 0.7, 0.3, -0.1, 0.01), 0.01, even(0.2, 5, 25), 20, 4, 4, "order 4 with repeats"),
    ("falling", "f2", (6.0, -0.8), 0.01, even(0.3, 5, 100), 1, 4, 4, "readings fall with distance"),
    ("few", "f2", SENSOR, 0.02, even(0.4, 4.6, 7), 1, 4, 4, "three readings more than parameters"),
    ("near", "f2", (0.05, 0.9, 0.06, -0.004), 0.01, even(4.99, 5.01, 50), 1, 6, 6, "distances within 2 cm at 5 m, order 3: nearly collinear"),
    ("many", "f2", (0.05, 0.9, 0.06, -0.004, 0.0003), 0.02, even(0.2, 5, 1500), 1, 4, 4, "1500 readings"),
    ("level", "f3", (1.2,), 0.03, even(1, 2, 4), 10, 4, 4, "order 0 with repeats"),
    ("cubic_line", "f3", (0.05, 0.9), 0.01, even(0.2, 4, 150), 1, 4, 4, "spreads from 0.1 mm to 0.5 m"),
    ("cubic", "f3", SENSOR, 0.005, even(0.5, 5, 20), 15, 4, 4, "with repeats"),
    ("cubic_four", "f3", (0.1, 0.8, 0.1, -0.03, 0.004), 0.01, even(0.3, 3.5, 300), 1, 4, 4, "order 4"),
    ("constant_f", "d2", (3.0,), 0.01, even(0.5, 5, 40), 1, 4, 4, "order 0, weights over four decades"),
    ("millimetres", "d2", (30.0, 0.95), 1e-5, even(200, 5000, 60), 4, 1, 2, "in millimetres, with repeats"),
    ("square", "d2", SENSOR, 0.005, even(0.2, 5, 500), 1, 4, 4, "the approximation of 2016, eq. 21"),
    ("square_cubic", "d2", (0.05, 0.9, 0.06, -0.004), 0.02, even(2, 2.2, 12), 6, 4, 4, "distances within 20 cm at 2 m, order 3"),
]


def write_data():
    with open(HERE / "data.csv", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["problem", "true_m", "reading_m"])
        for number, (name, law, alpha, sigma, distances, repeats, d_digits, y_digits, _) in enumerate(PROBLEMS):
            draw = random.Random(20160 + number)
            p, q = POWERS[law]
            for d in distances:
                d = round(d, d_digits)
                f = sum(a * d ** j for j, a in enumerate(alpha))
                for _ in range(repeats):
                    y = f + sigma * f ** p * d ** q * draw.normalvariate(0.0, 1.0)
                    out.writerow([name, f"{d:.{d_digits}f}", f"{y:.{y_digits}f}"])


def terms(mp, x, d, y, p, q):
    """NLL, gradient and Hessian in (alpha, lambda), and the expected information; None where some f <= 0."""
    n = len(x) - 1
    nll, sigma = mp.mpf(0), mp.exp(x[n])
    gradient, hessian, information = mp.zeros(n + 1, 1), mp.zeros(n + 1), mp.zeros(n + 1)
    for di, yi in zip(d, y):
        basis = [di ** j for j in range(n)]
        f = mp.fsum(x[j] * basis[j] for j in range(n))
        if p and f <= 0:
            return None
        s = sigma * f ** p * di ** q
        u = (yi - f) / s
        v = -1 / s - p * u / f
        nll += mp.log(s) + u * u / 2 + mp.log(2 * mp.pi) / 2
        by_f = p / f + u * v
        by_ff = -p / f ** 2 + v * v + u * (p / (s * f) - p * v / f + p * u / f ** 2)
        slope = p / f  # of log s in f
        for j in range(n):
            gradient[j] += by_f * basis[j]
            hessian[j, n] += -2 * u * v * basis[j]
            information[j, n] += 2 * slope * basis[j]
            for k in range(j + 1):
                hessian[j, k] += by_ff * basis[j] * basis[k]
                information[j, k] += (1 / s ** 2 + 2 * slope ** 2) * basis[j] * basis[k]
        gradient[n] += 1 - u * u
        hessian[n, n] += 2 * u * u
        information[n, n] += 2
    for m in (hessian, information):
        for j in range(n):
            m[n, j] = m[j, n]
            for k in range(j):
                m[k, j] = m[j, k]
    return nll, gradient, hessian, information


def least_squares(mp, d, y, order, weight):
    H = mp.matrix(order + 1)
    b = mp.zeros(order + 1, 1)
    for di, yi, w in zip(d, y, weight):
        for j in range(order + 1):
            b[j] += w * di ** j * yi
            for k in range(order + 1):
                H[j, k] += w * di ** (j + k)
    return mp.lu_solve(H, b)


def positive_definite(mp, m):
    try:
        mp.cholesky(m)
        return True
    except ValueError:
        return False


def solve(mp, d, y, order, p, q, shift=0.0):
    """Damped Newton from weighted least squares (by y^p d^q for the spread), each coefficient moved by `shift` of its
    standard deviation and sigma by exp(shift)."""
    shape = [abs(yi) ** p * di ** q for di, yi in zip(d, y)]
    alpha = least_squares(mp, d, y, order, [1 / s ** 2 for s in shape])
    residual = [yi - mp.fsum(alpha[j] * di ** j for j in range(order + 1)) for di, yi in zip(d, y)]
    x = mp.matrix(list(alpha) + [mp.log(mp.fsum((r / s) ** 2 for r, s in zip(residual, shape)) / len(d)) / 2])
    if shift:
        covariance = terms(mp, x, d, y, p, q)[3] ** -1
        for j in range(order + 1):
            x[j] += mp.mpf(shift) * (-1) ** j * mp.sqrt(covariance[j, j]) / (order + 1)
        x[order + 1] += shift
    for _ in range(200):
        nll, gradient, hessian, information = terms(mp, x, d, y, p, q)
        step = -mp.lu_solve(hessian if positive_definite(mp, hessian) else information, gradient)
        decrement = -(step.T * gradient)[0]
        length = mp.mpf(1)
        while True:
            trial = x + length * step
            there = terms(mp, trial, d, y, p, q)
            if decrement < mp.mpf(10) ** -40 or (there and there[0] <= nll - length * decrement / 10 ** 4):
                break
            length /= 4
        x = trial
        if decrement < mp.mpf(10) ** (-1.6 * mp.dps):  # Newton doubles the digits: the step just taken left 10^-1.6 dps behind
            return x
    raise RuntimeError("no convergence")


def digits_kept(mp, x, d, y, p, q):
    """Digits that the estimates keep when each d and y moves by half a unit in its last binary place, with signs at
    random: -log10 of the standard deviation of the relative change, by differences of the gradient at the estimate."""
    n = len(x) - 1
    inverse = terms(mp, x, d, y, p, q)[2] ** -1
    change = [mp.mpf(0)] * (n + 1)
    for i in range(len(d)):
        for which in (0, 1):
            h = mp.mpf(math.ulp(float((d, y)[which][i]))) / 2
            di, yi = (d[i] + h, y[i]) if which == 0 else (d[i], y[i] + h)
            moved = inverse * (terms(mp, x, [di], [yi], p, q)[1] - terms(mp, x, [d[i]], [y[i]], p, q)[1])
            for j in range(n + 1):
                change[j] += moved[j] ** 2
    scale = [abs(x[j]) for j in range(n)] + [mp.mpf(1)]  # of log sigma: the relative change of sigma
    return [float(-mp.log10(mp.sqrt(c) / s)) for c, s in zip(change, scale)]


def certify():
    from mpmath import mp

    rows = {}
    with open(HERE / "data.csv") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["problem"], []).append((float(row["true_m"]), float(row["reading_m"])))
    problems = []
    for name, law, alpha, _, _, repeats, _, _, note in PROBLEMS:
        p, q = POWERS[law]
        order = len(alpha) - 1
        answers = []
        for digits, shift in ((70, 0), (90, 0.3), (70, -0.3)):  # another precision, other starts: the same 30 digits
            mp.dps = digits
            d = [mp.mpf(a) for a, _ in rows[name]]  # the exact value of the double nearest to the decimals
            y = [mp.mpf(b) for _, b in rows[name]]
            x = solve(mp, d, y, order, p, q, shift)
            nll, _, hessian, information = terms(mp, x, d, y, p, q)
            assert positive_definite(mp, hessian), name
            covariance = information ** -1
            sd = [mp.sqrt(covariance[j, j]) for j in range(order + 2)]
            sd[-1] *= mp.exp(x[order + 1])  # of sigma
            answers.append({
                "alpha": [mp.nstr(x[j], 30, strip_zeros=False) for j in range(order + 1)],
                "sigma": mp.nstr(mp.exp(x[order + 1]), 30, strip_zeros=False),
                "nll": mp.nstr(nll, 30, strip_zeros=False),
                "alpha_std": [mp.nstr(s, 30, strip_zeros=False) for s in sd[:-1]],
                "sigma_std": mp.nstr(sd[-1], 30, strip_zeros=False)})
            if shift == 0:
                keeps = digits_kept(mp, x, d, y, p, q)
        assert answers[0] == answers[1] == answers[2], (name, answers)
        problems.append({"name": name, "law": law, "order": order, "readings": len(d),
                         "distances": len(set(d)), "note": note, **answers[0],
                         "digits_kept_by_rounded_data": [round(k, 1) for k in keeps]})
        print(f"{name:12s} {law:8s} order {order}, {len(d):4d} readings, NLL {answers[0]['nll'][:18]}, "
              f"digits kept {min(keeps):.1f}", flush=True)
    (HERE / "certified.json").write_text(json.dumps({"digits": 30, "problems": problems}, indent=1) + "\n")


if __name__ == "__main__":
    if sys.argv[1:] == ["data"]:
        write_data()
    elif sys.argv[1:] == ["solve"]:
        certify()
    else:
        sys.exit(__doc__)
