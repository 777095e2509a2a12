# SPDX-License-Identifier: BSD-3-Clause
"""Calibrates cheap range sensors and finds the physics a model left out.

    import rangecal

    recording = rangecal.load("notebooks_data/field-layout")
    calibration = rangecal.calibrate(recording)
    distance = rangecal.correct(calibration, [1.234, 2.5])
    diagnosis = rangecal.diagnose(recording)

Everything is SI: metres, radians, seconds. Results have attributes, ``to_frame()`` and ``plot()``. Wrong input raises
`InputError`; an unlucky solve is an ``outcome`` with a ``reason``.
"""
from . import _api, _docs, _html, _native, _plots, _recording, _results
from ._api import (calibrate, compare, compare_curves, correct, diagnose, effects, load, load_effects, residuals,
                   simulate, study)
from ._ingest import correct_bag, extract, import_dataset, import_lego, import_mrclam
from ._native import (Calibration, CheckReport, CurveChange, Diagnosis, Effect, EffectEstimate, EffectParameter,
                      Explanation, Finding, FitSummary, InputError, Law, Member, ModelScore, NextExperiment, Recording, Residuals,
                      Sensor, TruthScore, Unseen, __version__)
from ._results import Comparison, Corrected, CorrectedBag, Extraction, Study


def _repr_of(name, text):
    return lambda self: f"<rangecal.{name}: {text(self)}>"


def _attach(cls, **methods):
    for name, method in methods.items():
        setattr(cls, name, method)


InputError.__module__ = __name__
_docs.attach()
for _cls in (Calibration, CurveChange, Diagnosis, Effect, Recording, Residuals):
    _cls.__module__ = __name__

_attach(Recording, _maker="", __init__=_recording.init, save=_recording.save, columns=_recording.columns,
        to_frame=_recording.to_frame, stops_to_frame=_recording.stops_to_frame, describe=_recording.describe, plot=_plots.recording,
        _repr_html_=_html.recording, __repr__=_repr_of("Recording", lambda r: r.describe() if _native.is_made(r) else "not made"))
_attach(Calibration, models=(), notes=(), check=None, _origin=None, f=_results.f, f_std=_results.f_std, noise=_results.noise,
        save=_results.save_calibration, report=_results.report_calibration, to_frame=_results.calibration_to_frame,
        models_to_frame=_results.models_to_frame, landmarks_to_frame=_results.landmarks_to_frame, stops_to_frame=_results.stops_to_frame,
        plot=_plots.calibration, plot_scene=_plots.scene, _repr_html_=_html.calibration,
        __repr__=_repr_of("Calibration", lambda c: f"{c.method}, order {c.order}, noise {c.noise_law}, {c.outcome}"))
_attach(Diagnosis, _recordings=(), save=_results.save_diagnosis, simulate_all=_results.simulate_all,
        report=_results.report_diagnosis, mcap=_results.mcap_diagnosis, to_frame=_results.diagnosis_to_frame, plot=_plots.diagnosis, _repr_html_=_html.diagnosis,
        __repr__=_repr_of("Diagnosis", lambda d: d.verdict if d.verdict == "unobservable" else
                          f"{d.verdict}, {' + '.join(d.final_effects) or 'nothing to add'}"))
_attach(Residuals, to_frame=_results.residuals_to_frame, plot=_plots.residuals, _repr_html_=_html.residuals,
        __repr__=_repr_of("Residuals", lambda r: f"{len(r)} readings"))
_attach(Effect, __repr__=_repr_of("Effect", lambda e: f"{e.id}, {e.channel} along {e.covariate}"))

__all__ = ["Calibration", "CheckReport", "Comparison", "Corrected", "CorrectedBag", "CurveChange", "Diagnosis", "Effect", "EffectEstimate",
           "EffectParameter", "Explanation", "Extraction", "Finding", "FitSummary", "InputError", "Law", "Member", "ModelScore", "NextExperiment",
           "Recording", "Residuals", "Sensor", "Study", "TruthScore", "Unseen", "calibrate", "compare", "compare_curves",
           "correct", "correct_bag", "diagnose", "effects", "extract", "import_dataset", "import_lego", "import_mrclam", "load", "load_effects", "residuals",
           "simulate", "study"]
