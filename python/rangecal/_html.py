# SPDX-License-Identifier: BSD-3-Clause
"""What a notebook shows of a result: the summary of its report, or its most important table."""
import html

import numpy as np

from . import _native


def _number(value):
    if isinstance(value, str):
        return html.escape(value)
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value:.4g}"


def _table(header, rows):
    head = "".join(f"<th>{html.escape(str(name))}</th>" for name in header)
    body = "".join("<tr>" + "".join(f"<td>{_number(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _page(title, sentence, *parts):
    text = f"<p><b>{html.escape(title)}</b>{': ' if sentence else ''}{html.escape(sentence)}</p>"
    return "<div>" + text + "".join(parts) + "</div>"


def recording(self):
    dropped = ", ".join(f"{count} {reason}" for reason, count in self.counts["dropped"].items())
    return _page("Recording", self.describe() + (f"; dropped: {dropped}" if dropped else ""))


def calibration(self):
    if self._origin is not None:
        return _native.calibration_summary(*self._origin)
    frame = self.to_frame()
    rows = [(name, row.estimate, row["std"], row.unit) for name, row in frame.iterrows()]
    title = f"Calibration ({self.method}, noise {self.noise_law}): {self.outcome}"
    return _page(title, self.reason, _table(["", "estimate", "std", "unit"], rows))


def comparison(self):
    return _native.comparison_summary(self._job, self._recordings)


def diagnosis(self):
    return _native.diagnosis_summary(self)


def corrected(self):
    names, shown = ("reading_m", "distance_m", "std_m", "flag"), min(len(self), 10)
    rows = [[getattr(self, name)[i] for name in names] for i in range(shown)]
    more = f"the first {shown} of {len(self)} readings" if shown < len(self) else f"{len(self)} readings"
    return _page("Corrected", more, _table(names, rows))


def residuals(self):
    rows = [["range", f"{1e3 * np.sqrt(np.mean(self.range_residual_m**2)):.2f} mm",
             np.mean((self.range_residual_m / self.range_std_m) ** 2)]]
    if np.all(self.bearing_std_rad > 0):   # of pairs there is no bearing
        rows.append(["bearing", f"{np.degrees(np.sqrt(np.mean(self.bearing_residual_rad**2))):.3f} deg",
                     np.mean((self.bearing_residual_rad / self.bearing_std_rad) ** 2)])
    return _page("Residuals", f"{len(self)} readings", _table(["", "RMS", "mean square over variance"], rows))
