# SPDX-License-Identifier: BSD-3-Clause
"""SciPy's side of the comparison: scipy_peer.py pairs|joint SIZE SETS FOLDER METHOD CAP.

METHOD: scipy_least_squares; scipy_bfgs and scipy_trust (pairs), scipy_lbfgs (joint) by scipy.optimize.minimize. All derivatives
analytic and vectorised. Writes METHOD-<set>.bin and prints "set seconds megabytes"."""
import sys
import time

import numpy as np
from scipy import sparse
from scipy.optimize import least_squares, minimize


def status_megabytes(field):
    with open("/proc/self/status") as status:
        return next(float(line.split()[1]) / 1024 for line in status if line.startswith(field))


class Pairs:
    """y = f(d) + sigma f^2 e, x = (alpha, log sigma)."""

    def __init__(self, path, size):
        data = np.fromfile(path)
        self.d, self.y = data[:size], data[size:]
        self.powers = np.stack([np.ones(size), self.d, self.d**2])
        self.start = np.array([0.0, 1.0, 0.0, np.log(0.1)])
        self.log_floor = np.log(1e-3 * self.d**2)

    def value(self, x):
        f = x[:3] @ self.powers
        if not f.min() > 0.0:
            return np.inf, np.zeros(4)
        precision = np.exp(-2 * x[3]) / f**4
        r = self.y - f
        q = r * r * precision
        g = -r * precision + 2 * (1 - q) / f
        return 2 * np.log(f).sum() + len(f) * x[3] + 0.5 * q.sum(), np.append(self.powers @ g, (1 - q).sum())

    def hessian(self, x):
        f = x[:3] @ self.powers
        precision = np.exp(-2 * x[3]) / f**4
        r = self.y - f
        q = r * r * precision
        second = precision + 8 * r * precision / f + 10 * q / f**2 - 2 / f**2
        mixed = 2 * (r * precision + 2 * q / f)
        out = np.empty((4, 4))
        out[:3, :3] = (self.powers * second) @ self.powers.T
        out[:3, 3] = out[3, :3] = self.powers @ mixed
        out[3, 3] = 2 * q.sum()
        return out

    def least_squares(self):
        def residuals(x):
            f = x[:3] @ self.powers
            with np.errstate(all="ignore"):
                log_s = x[3] + 2 * np.log(f)
                r = np.concatenate([(self.y - f) * np.exp(-log_s), np.sqrt(2 * (log_s - self.log_floor))])
            return np.nan_to_num(r, nan=1e6, posinf=1e6)

        def jacobian(x):
            f = x[:3] @ self.powers
            with np.errstate(all="ignore"):
                log_s = x[3] + 2 * np.log(f)
                white, inverse = np.exp(-log_s), 1 / np.sqrt(2 * (log_s - self.log_floor))
            out = np.empty((2 * len(f), 4))
            out[: len(f), :3] = (self.powers * (-white - 2 * (self.y - f) * white / f)).T
            out[: len(f), 3] = -(self.y - f) * white
            out[len(f):, :3] = (self.powers * (2 / f * inverse)).T
            out[len(f):, 3] = inverse
            return np.nan_to_num(out)

        return least_squares(residuals, self.start, jacobian, xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=400).x

    def solve(self, method):
        if method == "scipy_least_squares":
            return self.least_squares()
        options = {"gtol": 1e-6 * len(self.d)}
        if method == "scipy_bfgs":
            return minimize(self.value, self.start, jac=True, method="BFGS", options=options).x
        return minimize(self.value, self.start, jac=True, hess=self.hessian, method="trust-exact", options=options).x


class Joint:
    """Range, bearing and stop priors; x = (alpha, log sigma_e, log sigma_theta, landmarks, stops), x and y in turn."""

    def __init__(self, path, size):
        data = np.fromfile(path)
        stops, self.landmarks, cells = (int(v) for v in data[:3])
        columns = data[3: 3 + 5 * cells].reshape(5, cells)
        self.stop, self.landmark = columns[0].astype(int), columns[1].astype(int)
        self.y, self.bearing, self.radius = columns[2:]
        rest = data[3 + 5 * cells:]
        self.commanded = rest[: 2 * stops].reshape(2, stops).T.ravel()
        self.sigma_s = rest[2 * stops]
        self.start = rest[2 * stops + 1:]
        self.at_landmark = 5 + 2 * self.landmark
        self.at_stop = 5 + 2 * self.landmarks + 2 * self.stop
        self.first_stop = 5 + 2 * self.landmarks
        f = self.predict(self.start)[3]
        self.floor_range = self.start[3] + np.log(f) + np.log(0.1)
        self.floor_bearing = self.start[4] + np.log(0.1)

    def predict(self, x):
        vx, vy = x[self.at_landmark] - x[self.at_stop], x[self.at_landmark + 1] - x[self.at_stop + 1]
        axis = np.hypot(vx, vy)
        d = axis - self.radius
        return vx / axis, vy / axis, axis, x[0] + d * (x[1] + d * x[2]), d

    def value(self, x):
        ux, uy, axis, f, d = self.predict(x)
        if not f.min() > 0.0:
            return np.inf, np.zeros_like(x)
        turn = np.angle(np.exp(1j * (self.bearing - np.arctan2(uy, ux))))
        precision = np.exp(-2 * x[3]) / f**2
        r = self.y - f
        q = r * r * precision
        qb = turn**2 * np.exp(-2 * x[4])
        error = (x[self.first_stop:] - self.commanded) / self.sigma_s
        nll = np.log(f).sum() + len(f) * (x[3] + x[4]) + 0.5 * (q.sum() + qb.sum() + error @ error)
        in_f = -r * precision + (1 - q) / f
        in_d = in_f * (x[1] + 2 * d * x[2])
        in_b = -turn * np.exp(-2 * x[4]) / axis
        gradient = np.empty_like(x)
        gradient[:3] = in_f.sum(), in_f @ d, in_f @ d**2
        gradient[3], gradient[4] = (1 - q).sum(), (1 - qb).sum()
        gx, gy = in_d * ux - in_b * uy, in_d * uy + in_b * ux
        gradient[5: self.first_stop: 2] = np.bincount(self.landmark, gx, self.landmarks)
        gradient[6: self.first_stop: 2] = np.bincount(self.landmark, gy, self.landmarks)
        gradient[self.first_stop:: 2] = error[::2] / self.sigma_s - np.bincount(self.stop, gx, len(error) // 2)
        gradient[self.first_stop + 1:: 2] = error[1::2] / self.sigma_s - np.bincount(self.stop, gy, len(error) // 2)
        return nll, gradient

    def least_squares(self):
        cells, prior = len(self.y), len(self.commanded)
        rows = np.arange(cells)

        def residuals(x):
            ux, uy, _, f, _ = self.predict(x)
            turn = np.angle(np.exp(1j * (self.bearing - np.arctan2(uy, ux))))
            with np.errstate(all="ignore"):
                log_s = x[3] + np.log(f)
                r = np.concatenate([(self.y - f) * np.exp(-log_s), np.sqrt(2 * (log_s - self.floor_range)),
                                    turn * np.exp(-x[4]), np.full(cells, np.sqrt(2 * (x[4] - self.floor_bearing))),
                                    (x[self.first_stop:] - self.commanded) / self.sigma_s])
            return np.nan_to_num(r, nan=1e6, posinf=1e6)

        def jacobian(x):
            ux, uy, axis, f, d = self.predict(x)
            turn = np.angle(np.exp(1j * (self.bearing - np.arctan2(uy, ux))))
            with np.errstate(all="ignore"):
                log_s = x[3] + np.log(f)
                white, wb = np.exp(-log_s), np.exp(-x[4])
                inverse = 1 / np.sqrt(2 * (log_s - self.floor_range))
                inverse_b = 1 / np.sqrt(2 * (x[4] - self.floor_bearing))
            r, slope = (self.y - f) * white, x[1] + 2 * d * x[2]
            in_f, log_f = -white - r / f, inverse / f
            i, j, v = [], [], []

            def add(row, column, value):
                i.append(row)
                j.append(np.broadcast_to(column, row.shape))
                v.append(np.broadcast_to(value, row.shape))

            for first, by_f in ((0, in_f), (cells, log_f)):
                for k in range(3):
                    add(rows + first, k, by_f * d**k)
                for sign, at in ((1, self.at_landmark), (-1, self.at_stop)):
                    add(rows + first, at, sign * by_f * slope * ux)
                    add(rows + first, at + 1, sign * by_f * slope * uy)
            add(rows, 3, -r)
            add(rows + cells, 3, inverse)
            for sign, at in ((1, self.at_landmark), (-1, self.at_stop)):
                add(rows + 2 * cells, at, sign * uy / axis * wb)
                add(rows + 2 * cells, at + 1, -sign * ux / axis * wb)
            add(rows + 2 * cells, 4, -turn * wb)
            add(rows + 3 * cells, 4, inverse_b)
            add(np.arange(prior) + 4 * cells, self.first_stop + np.arange(prior), 1 / self.sigma_s)
            out = sparse.coo_matrix((np.nan_to_num(np.concatenate(v)), (np.concatenate(i), np.concatenate(j))),
                                    shape=(4 * cells + prior, len(x)))
            return out.toarray() if len(x) < 200 else out.tocsr()

        return least_squares(residuals, self.start, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-10, gtol=1e-12,
                             max_nfev=400).x

    def solve(self, method):
        if method == "scipy_least_squares":
            return self.least_squares()
        return minimize(self.value, self.start, jac=True, method="L-BFGS-B",
                        options={"maxiter": 20000, "maxfun": 20000, "maxcor": 20, "ftol": 1e-14, "gtol": 1e-6}).x


def main():
    kind, size, sets, folder, method, cap = sys.argv[1:]
    spent = 0.0
    for number in range(int(sets)):
        if spent > float(cap):
            break
        problem = (Pairs if kind == "pairs" else Joint)(f"{folder}/data-{number}.bin", int(size))
        with open("/proc/self/clear_refs", "w") as refs:
            refs.write("5")
        before, best, begin = status_megabytes("VmRSS:"), np.inf, time.perf_counter()
        while True:
            start = time.perf_counter()
            answer = problem.solve(method)
            now = time.perf_counter()
            best = min(best, now - start)
            if now - begin > 0.05:
                break
        spent += now - begin
        answer.tofile(f"{folder}/{method}-{number}.bin")
        print(number, f"{best:.9f}", f"{status_megabytes('VmHWM:') - before:.2f}", flush=True)


main()
