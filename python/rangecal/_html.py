# SPDX-License-Identifier: BSD-3-Clause
"""What a notebook shows of a result: its sentence and its most important tables."""
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
    frame = self.to_frame()
    rows = [(name, row.estimate, row["std"], row.unit) for name, row in frame.iterrows()]
    title = f"Calibration ({self.method}, noise {self.noise_law}): {self.outcome}"
    return _page(title, self.reason, _table(["", "estimate", "std", "unit"], rows))


def comparison(self):
    frame = self.to_frame()
    rows = [(name, *row) for name, row in frame.iterrows() if not name.endswith(" std")]
    return _page("Comparison", "", _table(["", *frame.columns], rows))


def diagnosis(self):
    return _native.diagnosis_summary(self)
