# SPDX-License-Identifier: BSD-3-Clause
# What is public, with types. Arrays are float64 unless said otherwise; results hand out read-only views.
import os
from typing import Any, Callable, Iterator, Literal, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt
import pandas
from matplotlib.axes import Axes

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Path = Union[str, os.PathLike[str]]
Table = Union[Mapping[str, npt.ArrayLike], npt.NDArray[np.void], pandas.DataFrame]
Arc = Literal["nearest", "mean", "smallest"]
Progress = Callable[[str, float], Any]
Method = Literal["closed-form", "approximate", "full", "marginal"]
Effects = Mapping[str, Mapping[str, float]]

__version__: str

class InputError(ValueError): ...

class Sensor:
    name: str
    principle: str
    range_min_m: float
    range_max_m: float
    unit: str

class Recording:
    """Readings of one sensor, with what is known about stops and landmarks."""
    def __init__(self, observations: Optional[Table] = None, stops: Optional[Table] = None,
                 landmarks: Optional[Table] = None, *, pairs: Optional[Table] = None,
                 sensor: Optional[Mapping[str, Any]] = None,
                 sigma_xy_m: Union[float, Literal["estimate"]] = 0.01, sigma_heading_rad: float = 0.0,
                 stop_error: Literal["independent", "random_walk"] = "independent", radius_m: float = 0.0,
                 known_distances: Sequence[Mapping[str, Any]] = (), true_stops: Optional[Table] = None,
                 true_landmarks: Optional[Table] = None,
                 columns: Optional[Mapping[str, Mapping[str, str]]] = None,
                 group_by: Union[str, Sequence[str]] = (), reference: Optional[Mapping[str, float]] = None,
                 extraction: Optional[Mapping[str, Any]] = None) -> None: ...
    path: str
    kind: Literal["landmarks", "pairs"]
    sensor: Sensor
    sigma_xy_m: Union[float, Literal["estimate"]]
    sigma_heading_rad: float
    stop_error: Literal["independent", "random_walk"]
    counts: dict[str, Any]
    stop_labels: list[str]
    places: list[str]
    stops: Floats  # (stops, 3): x [m], y [m], heading [rad], as commanded
    landmark_labels: list[str]
    landmark_radius_m: Floats  # (landmarks,)
    true_stops: Optional[Floats]  # (stops, 3), NaN where not known
    true_landmarks: Optional[Floats]  # (landmarks, 2) [m]
    stop: Optional[Ints]  # (n,) indices into stop_labels
    landmark: Optional[Ints]  # (n,) indices into landmark_labels
    repeat: Optional[Ints]  # (n,)
    batch: Optional[Ints]  # (n,) indices into batch_labels, -1: none
    batch_labels: list[str]
    group_by: list[str]  # columns that say which readings belong together
    group: Optional[Ints]  # (n,) indices into group_labels
    group_labels: list[list[str]]  # of every group its text in each column of group_by
    reference_sigma_m: float  # of a stated true distance; 0: exact
    time_s: Optional[Floats]  # (n,)
    range_m: Floats  # (n,) raw readings
    true_m: Optional[Floats]  # (n,)
    bearing_rad: Optional[Floats]  # (n,) in the sensor frame
    row: Ints  # (n,) line in the file, header = 1
    covariates: dict[str, Floats]  # (n,) each
    extraction: dict[str, str]  # how it was cut out of raw scans: source, arc, radius, edge_cut; else empty
    notes: list[str]  # what the reader did that you should know
    def __len__(self) -> int: ...
    def save(self, folder: Path, *, overwrite: bool = False) -> None: ...
    def columns(self) -> dict[str, npt.NDArray[Any]]: ...
    def to_frame(self) -> pandas.DataFrame: ...
    def stops_to_frame(self) -> pandas.DataFrame: ...
    def describe(self) -> str: ...
    def plot(self, ax: Optional[Axes] = None) -> Axes: ...
    def _repr_html_(self) -> str: ...

class ModelScore:
    order: int
    curve: str
    noise_law: str
    nll: float
    aic: float

class CheckReport:
    agrees: bool
    better_basin: bool
    nll: float
    report: str

class Calibration:
    """The curve f, the noise law, stops and landmarks, with their uncertainties or the reason why there are none."""
    method: Method
    kind: Literal["landmarks", "pairs"]
    outcome: str
    usable: bool
    reason: str
    order: int
    curve: dict[str, Any]  # family; of a reciprocal offset_m, offset_std_m; of a spline knots_m, values_m, covariance, degrees
    alpha: Floats  # (order + 1,), alpha_i in m^(1-i)
    covariance: Optional[Floats]  # (order + 1, order + 1)
    covariance_with_choice: Optional[Floats]  # (n, n), n - 1 the highest order that may hold
    covariance_by_stops: Optional[Floats]  # (order + 1, order + 1)
    covariance_by_landmarks: Optional[Floats]  # (order + 1, order + 1)
    misfit: Optional[dict[str, Any]]
    left_out: Optional[dict[str, Any]]
    bound_alpha_std: Optional[Floats]  # (order + 1,)
    covariance_reason: str
    noise_law: str
    noise_parameters: Floats
    noise_std: Floats
    noise_shapes: dict[str, dict[str, Any]]
    outlier_count: int
    outliers: list[dict[str, Any]]
    sigma_theta_rad: Optional[float]
    sigma_theta_std_rad: Optional[float]
    sigma_s_m: Optional[float]
    sigma_s_std_m: Optional[float]
    sigma_s_upper95_m: Optional[float]
    range_m: Tuple[float, float]  # distances over which it was fitted
    effects: dict[str, dict[str, float]]
    effects_range: dict[str, tuple[float, float]]
    effects_covariance: Optional[Floats]  # (n, n), n = order + 1 + len(effects_covariance_parameters)
    effects_covariance_parameters: list[str]
    landmark_labels: list[str]
    landmarks: Floats  # (landmarks, 2) [m]
    landmark_covariance: Floats  # (landmarks, 2, 2) [m^2], NaN where there is none
    landmark_covariance_by_stops: Floats  # (landmarks, 2, 2) [m^2], NaN where there is none
    landmark_recording: Ints
    stop_labels: list[str]
    stops: Floats  # (stops, 3): x [m], y [m], heading [rad]
    stop_recording: Ints
    counts: dict[str, Any]
    joint_nll: Optional[float]  # [nats]
    nll: Optional[float]  # marginal, for pairs plain [nats]
    aic: Optional[float]
    weakest_direction: str
    iterations: int
    seconds: float
    models: Sequence[ModelScore]
    notes: Sequence[str]
    check: Optional[CheckReport]
    def f(self, distance_m: npt.ArrayLike) -> Any:
        """Mean reading f(d) [m] at true distances [m], any shape."""
    def f_std(self, distance_m: npt.ArrayLike) -> Any:
        """Standard deviation of f(d) [m], the choice of order in it where one was made; NaN without a covariance."""
    def noise(self, distance_m: npt.ArrayLike) -> Any:
        """Standard deviation s(d) of one reading [m]."""
    def to_dict(self) -> dict[str, Any]: ...
    def to_json(self) -> str: ...
    def save(self, path: Path) -> None: ...
    def to_frame(self) -> pandas.DataFrame: ...
    def models_to_frame(self) -> pandas.DataFrame: ...
    def landmarks_to_frame(self) -> pandas.DataFrame: ...
    def stops_to_frame(self) -> pandas.DataFrame: ...
    def plot(self, ax: Optional[Axes] = None) -> Axes: ...
    def plot_scene(self, ax: Optional[Axes] = None) -> Axes: ...
    def report(self, path: Path) -> None: ...
    def _repr_html_(self) -> str: ...

class TruthScore:
    landmark_rmse_m: Optional[float]
    landmarks: int
    landmark_strain: Optional[float]
    mse_ratio: Optional[float]
    rmse_raw_m: float
    rmse_corrected_m: float
    readings: int
    estimated_stops: bool

class Comparison:
    calibrations: list[Calibration]
    scores: list[TruthScore]
    models: list[ModelScore]
    notes: list[str]
    check: Optional[CheckReport]
    def __getitem__(self, method: Method) -> Calibration: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[Calibration]: ...
    def to_frame(self) -> pandas.DataFrame: ...
    def plot(self, ax: Optional[Axes] = None) -> Axes: ...
    def report(self, path: Path) -> None: ...
    def _repr_html_(self) -> str: ...

class CurveChange:
    largest_m: float
    rms_m: float
    chi_sq: Optional[float]
    p_value: Optional[float]
    degrees_of_freedom: int
    first_taken_as_exact: bool
    noise_degrees_of_freedom: Optional[float]
    given_the_model: bool
    reason: str

class Corrected:
    reading_m: Floats  # (n,)
    distance_m: Floats  # (n,)
    std_m: Floats  # (n,)
    flag: npt.NDArray[np.object_]  # (n,)
    def __len__(self) -> int: ...
    def to_frame(self) -> pandas.DataFrame: ...
    def plot(self, ax: Optional[Axes] = None) -> Axes: ...
    def _repr_html_(self) -> str: ...

class Finding:
    """One place where model and recording differ; the arrays are its binned residuals."""
    channel: str
    covariate: str
    shape: str
    effects: list[str]
    where: Tuple[Optional[float], Optional[float]]
    group: str
    everywhere: str
    size: float
    unit: str
    p_value: float
    log_p: float
    share: Optional[float]
    at: Floats  # (bins,) in the covariate's unit
    before: Floats  # (bins,) mean residual [m] or [rad], or log variance ratio
    after: Floats
    std: Floats  # of the mean
    readings: Ints

class EffectEstimate:
    name: str
    estimate: float
    std: float
    ci95: Tuple[float, float]
    note: str

class Explanation:
    effects: list[str]
    probability: float
    parameters: list[EffectEstimate]
    nll: float
    heldout_nll: Optional[float]
    heldout_std: Optional[float]
    p_value: float
    indistinguishable_from: list[list[str]]
    separated_by: str
    physics: str

class Unseen:
    effect: str
    typical: dict[str, float]
    detectable: Optional[float]
    harm_m: float
    settled_by: str

class Member:
    effect: str
    probability: float
    log_evidence_without: Optional[float]
    heldout_nll_without: Optional[float]

class Law:
    id: str
    channel: str
    formula: str
    variables: list[str]
    parameters: list[EffectEstimate]
    log_evidence: float
    log_evidence_over_curve: float
    agrees_with_first: bool
    text: str

class NextExperiment:
    change: str
    settles: list[str]
    power: float

class FitSummary:
    nll: float
    heldout_nll: Optional[float]
    heldout_std: Optional[float]
    heldout_rms_range_m: Optional[float]
    rms_range_m: float
    rms_bearing_rad: float
    chi_sq_per_dof: float

class Diagnosis:
    verdict: Literal["no_mismatch", "explained", "partly_explained", "unexplained", "unobservable"]
    sentence: str
    baseline: Calibration
    corrected: Calibration
    before: FitSummary
    after: FitSummary
    alarm_p_value: float
    location: list[Finding]
    explanations: list[Explanation]
    final_effects: list[str]
    members: list[Member]
    evidence_omitted: Optional[float]
    nearly_as_likely: list[str]
    twins: list[list[str]]
    unseen: list[Unseen]
    next_experiments: list[NextExperiment]
    notes: list[str]
    laws: list[Law]
    heldout_blocks: str
    heldout_effective_blocks: float
    def to_dict(self) -> dict[str, Any]: ...
    def to_json(self) -> str: ...
    def save(self, path: Path) -> None: ...
    def simulate_all(self, seed: int) -> list[Recording]: ...
    def to_frame(self, table: Literal["explanations", "location", "fit", "unseen",
                                      "next_experiments", "readings"] = "explanations") -> pandas.DataFrame: ...
    def plot(self, finding: int = 0, ax: Optional[Axes] = None) -> Axes: ...
    def report(self, path: Path) -> None: ...
    def mcap(self, path: Path) -> None: ...
    def _repr_html_(self) -> str: ...

class Residuals:
    recording: Ints
    reading: Ints
    stop: Ints
    landmark: Ints
    repeat: Ints
    row: Ints
    reading_m: Floats
    bearing_rad: Floats
    distance_m: Floats
    range_residual_m: Floats
    range_std_m: Floats
    bearing_residual_rad: Floats
    bearing_std_rad: Floats
    corrected_m: Floats
    along: dict[str, Floats]
    def __len__(self) -> int: ...
    def to_frame(self) -> pandas.DataFrame: ...
    def plot(self, along: str = "range", channel: Literal["range", "bearing"] = "range", bins: int = 20,
             ax: Optional[Axes] = None) -> Axes: ...
    def _repr_html_(self) -> str: ...

class CorrectedBag:
    topic: str
    type: str
    format: str
    messages: int
    left_out: int
    readings: int
    corrected: int
    kept: int
    without_distance: int
    ambiguous: int
    out_of_range: int
    extrapolated: int
    extrapolated_column: int

class Extraction:
    recording: Optional[Recording]
    counts: dict[str, dict[str, int]]
    noise: dict[str, Any]
    arc: str
    runs_clockwise: bool
    text: str
    def to_frame(self) -> pandas.DataFrame: ...
    def _repr_html_(self) -> str: ...

class Study:
    name: str
    results_csv: str
    timing_csv: str
    def __len__(self) -> int: ...
    def to_frame(self, timing: bool = False) -> pandas.DataFrame: ...
    def plot(self, x: str, y: str, ax: Optional[Axes] = None) -> Axes: ...
    def report(self, path: Path) -> None: ...
    def _repr_html_(self) -> str: ...

class EffectParameter:
    name: str
    typical: float
    low: float
    high: float
    discrete: bool

class Effect:
    id: str
    channel: str
    covariate: str
    physics: str
    formula: str
    source: str
    visible_by: str
    settled_by: str
    exact_twins: list[str]
    parameters: list[EffectParameter]

Recordings = Union[Recording, Path, Sequence[Union[Recording, Path]]]

def load(path: Path, *, group_by: Union[str, Sequence[str]] = (), **options: Any) -> Union[Recording, Calibration]: ...
def calibrate(recordings: Recordings, method: Method = "marginal", *, order: Union[int, Literal["auto"]] = "auto",
              curve: Literal["auto", "polynomial", "reciprocal", "spline"] = "auto", noise: str = "auto", noise_shape: str = "auto", solver: Literal["block", "ceres"] = "block",
              weights: str = "consistent", check: bool = False, start: Optional[Union[Calibration, Path]] = None,
              progress: Optional[Progress] = None) -> Calibration: ...
def compare(recordings: Recordings, *, methods: Union[Method, Sequence[Method]] = ...,
            order: Union[int, Literal["auto"]] = "auto", curve: Literal["auto", "polynomial", "reciprocal", "spline"] = "auto",
            noise: str = "auto", noise_shape: str = "auto", solver: Literal["block", "ceres"] = "block",
            weights: str = "consistent", check: bool = False,
            progress: Optional[Progress] = None) -> Comparison: ...
def compare_curves(before: Union[Calibration, Path], after: Union[Calibration, Path]) -> CurveChange: ...
def correct(calibration: Union[Calibration, Path], readings: Union[npt.ArrayLike, Table, Recording], *,
            roots: Literal["ls", "ml"] = "ls", **columns: Optional[npt.ArrayLike]) -> Corrected: ...
def simulate(scene: Union[Path, Mapping[str, Any], Diagnosis, Recording, Sequence[Recording]], seed: int = 1, *,
             calibration: Optional[Union[Calibration, Path]] = None,
             effects: Optional[Effects] = None) -> Union[Recording, list[Recording]]: ...
def diagnose(recordings: Recordings,
             simulation: Optional[Union[Calibration, Recording, Path, Sequence[Recording]]] = None, *,
             curve: Literal["auto", "polynomial", "reciprocal", "spline"] = "auto", alarm_rate: float = 0.02, force: Optional[Union[str, Sequence[str]]] = None,
             without: Union[str, Sequence[str]] = (), held_out: bool = True, unseen: bool = True, next_experiments: bool = True, laws: bool = False,
             progress: Optional[Progress] = None) -> Diagnosis: ...
def residuals(recordings: Recordings, calibration: Union[Calibration, Path],
              along: Union[str, Sequence[str]] = ()) -> Residuals: ...
def study(path: Path, *, repeats: Optional[int] = None, threads: int = 0,
          progress: Optional[Progress] = None) -> Study: ...
def effects() -> list[Effect]: ...
def load_effects(folder: Path) -> list[str]: ...
def correct_bag(calibration: Union[Calibration, Path], bag: Path, out: Path, *, topic: str = "", keep_raw: str = "",
                clockwise: bool = False, progress: Optional[Progress] = None) -> CorrectedBag: ...
def extract(scans: Union[Path, Table, Sequence[Path]], stops: Optional[Union[Path, Table]] = None, *,
            radius_m: Optional[Union[float, Sequence[float]]] = None, landmarks: Optional[Union[Path, Table]] = None,
            arc: Arc = "nearest", beams_min: int = 4, edge_cut: float = 0.9, support: float = 0.5,
            split: Literal["automatic", "label", "file", "scan", "standing"] = "automatic",
            scans_min: Optional[int] = None, sigma_xy_m: Optional[float] = None,
            sigma_heading_rad: Optional[float] = None, stop_error: Literal["independent", "random_walk"] = "independent",
            noise: Optional[Tuple[float, float]] = None, range_min_m: float = 0.0, range_max_m: float = ...,
            clockwise: bool = False, bearing_offset_rad: float = 0.0, name: str = "", principle: str = "",
            topic: str = "", odometry_topic: str = "", frames: str = "") -> Extraction: ...
def import_dataset(name: str, path: Path, **options: Any) -> Recording: ...
def import_lego(path: Path, *, poses: Literal["odometry", "reference"] = "odometry", track_m: float = 0.150,
                radius_m: Optional[float] = None, arc: Arc = "nearest") -> Recording: ...
def import_mrclam(path: Path, robot: int, *, kind: Literal["stops", "pairs"] = "stops",
                  poses: Literal["mocap", "odometry"] = "mocap", readings_min: int = 4, tubes_min: int = 2,
                  stops_max: int = 0) -> Recording: ...
