# SPDX-License-Identifier: BSD-3-Clause
"""What the classes of the C++ side hold, for help(): shapes, units, meaning. Arrays are read-only views."""
from . import _native

_DOCS = {
    "Sensor": """What a recording says of its sensor.

    Attributes
    ----------
    name, principle : str
        ``triangulation``, ``phase``, ...; empty where not stated.
    range_min_m, range_max_m : float
        Readings outside are dropped and counted [m].
    unit : str
        Of readings that are no lengths (``"V"``); empty: metres.
    """,
    "Recording": """Readings of one sensor, with what is known about stops and landmarks.

    Attributes
    ----------
    path : str
        Its folder; empty for tables in memory.
    kind : {"landmarks", "pairs"}
    sensor : Sensor
    sigma_xy_m : float or "estimate"
        How far a stop may be from its commanded place, one standard deviation per axis [m].
    sigma_heading_rad : float
        The same of headings [rad]; 0: exact.
    stop_error : {"independent", "random_walk"}
    counts : dict
        ``read``, ``used``, ``dropped`` by reason, ``cells_left_out``.
    stop_labels, places, landmark_labels, batch_labels : list of str
    stops : ndarray (stops, 3)
        Commanded x [m], y [m], heading [rad].
    landmark_radius_m : ndarray (landmarks,)
        [m].
    true_stops : ndarray (stops, 3) or None
        Ground truth, NaN where not known; x [m], y [m], heading [rad].
    true_landmarks : ndarray (landmarks, 2) or None
        The same of landmarks [m].
    stop, landmark, repeat : ndarray of int (n,) or None
        Of each reading; indices into the labels.
    batch : ndarray of int (n,) or None
        Of pairs, index into `batch_labels`; -1: none.
    group_by : list of str
        Columns that say which readings belong together: what is held out is held out by whole groups.
    group : ndarray of int (n,) or None
        Index into `group_labels`.
    group_labels : list of list of str
        Of every group its text in each column of `group_by`.
    reference_sigma_m : float
        Standard deviation of a stated true distance [m]; 0: exact.
    time_s : ndarray (n,) or None
        [s].
    range_m : ndarray (n,)
        Raw readings [m].
    true_m : ndarray (n,) or None
        Of pairs, the known distance [m].
    bearing_rad : ndarray (n,) or None
        In the sensor frame [rad].
    row : ndarray of int (n,)
        Line in the file, the header being 1.
    covariates : dict of ndarray (n,)
        Every other numeric column.
    extraction : dict of str
        How it was cut out of raw scans; else empty.
    notes : list of str
        What the reader did that you should know: columns left out for a text among their numbers, pairs whose distances
        do not repeat. `calibrate`, `compare` and `diagnose` repeat them.
    """,
    "Calibration": """The curve f, the noise law, stops and landmarks, with uncertainties or the reason why there are none.

    The sensor reports ``y = f(d) + s(d) e`` at the true distance ``d``, ``f(d) = sum alpha[i] u**i``, with u = d or,
    of a reciprocal curve, u = 1 / (d + c), or a spline that rises everywhere.

    Attributes
    ----------
    method : {"closed-form", "approximate", "full", "marginal"}
    kind : {"landmarks", "pairs"}
    outcome : str
        ``converged``, ``unobservable``, ``unbounded``, ``too_few_data``, ...
    usable : bool
        There is a curve to correct with.
    reason : str
        Of the outcome, in words.
    order : int
        Of f.
    curve : dict
        ``family``: "polynomial" (u = d), "reciprocal" with c, ``offset_m``, and ``offset_std_m`` [m], or "spline" with
        ``knots_m`` and ``values_m`` of u [m], the values' ``covariance`` [m^2] beside that of alpha, and ``degrees`` of
        freedom of the curve.
    alpha : ndarray (order + 1,)
        alpha[i] in m^(1-i), of a reciprocal curve in m^(1+i).
    covariance : ndarray (order + 1, order + 1) or None
        Of alpha, units m^(2-i-j), given order and noise law.
    covariance_with_choice : ndarray (n, n) or None
        Where order, noise law or c were chosen: with that choice in it, n - 1 the highest order that may hold.
    covariance_by_stops : ndarray (order + 1, order + 1) or None
        Of alpha, from how the answer changes when each stop is left out: holds where the noise law is wrong or readings of
        a stop depend on each other; along a random walk from stretches of stops. None for pairs and of other methods than
        ``"marginal"``.
    covariance_by_landmarks : ndarray (order + 1, order + 1) or None
        The same from landmarks left out in turn: holds where readings of a landmark have an error in common. None where
        there are no more landmarks than stops, or fewer than 4.
    misfit : dict or None
        ``factor``: standard deviations by stops or landmarks (``clusters``: which) over those stated, ``where`` it is
        furthest above its ``threshold``; above that the model does not hold.
    left_out : dict or None
        Readings of stops (along a random walk: of stretches of it; pairs: of batches or stretches of distance) left out in
        turn: ``rms_raw_m`` and ``rms_corrected_m`` with ``..._std_m``, ``groups``, ``what`` they are, ``halves_p_value``
        (do the curves of both halves agree?), ``better_than_raw`` and, where that is False, the ``reason``: such a curve
        makes readings no better.
    bound_alpha_std : ndarray (order + 1,) or None
        The Cramer-Rao bound of alpha at the estimate, as standard deviations; set by `calibrate` and `compare`.
    covariance_reason : str
        Why there is none, or a caution.
    noise_law : {"constant", "f", "f2", "f3", "d2", "polynomial"}
        ``s = sigma f**p``, ``sigma d**2``, or ``sum beta[i] d**i``.
    noise_parameters, noise_std : ndarray
        sigma (m^(1-p)), or beta (m^(1-i)), and standard deviations.
    noise_shapes : dict of dict
        Tails of ``range`` and ``bearing`` where they are not Gaussian: ``family``, its parameters and
        their standard deviations ``..._std``, None at an end of a parameter's range.
    outlier_count : int
        Readings that the noise shapes take for outliers. None is thrown away.
    outliers : list of dict
        The gravest, up to ten: ``recording``, ``row`` of its file, ``channel``, ``sigmas`` (error in the spreads of the
        others), ``reason`` ("label of B", "late echo", "early echo", "grazing", "bearing").
    sigma_theta_rad, sigma_theta_std_rad : float or None
        Standard deviation of one bearing [rad], and that of the estimate.
    sigma_s_m, sigma_s_std_m, sigma_s_upper95_m : float or None
        How far stops were from their places, where it was estimated [m]; its 95 % limit where the estimate is 0.
    range_m : (float, float)
        Distances over which it was fitted [m].
    effects : dict of dict of float
        By id and parameter, for `correct` to undo.
    effects_range : dict of (float, float)
        Of each column that the effects use, from where to where they were fitted; of an angle the shortest arc, from > to
        where that holds 180 degrees. `correct` flags what lies outside as ``extrapolated_column``.
    effects_covariance : ndarray (n, n) or None
        Of alpha, then of `effects_covariance_parameters`, in their units; set by `diagnose`, where effects were estimated
        with the curve. `correct` counts it; without it the effects count as exact.
    effects_covariance_parameters : list of str
        ``"EFFECT.PARAMETER"``, in the order of `effects_covariance`; empty where that is None. Parameters of `effects` that
        are not here are exact.
    landmark_labels : list of str
    landmarks : ndarray (landmarks, 2)
        Axes, x and y [m].
    landmark_covariance : ndarray (landmarks, 2, 2)
        [m^2]; NaN where there is none.
    landmark_covariance_by_stops : ndarray (landmarks, 2, 2)
        As `covariance_by_stops` [m^2]; NaN where there is none.
    landmark_recording, stop_recording : ndarray of int
        Which recording of the job.
    stop_labels : list of str
    stops : ndarray (stops, 3)
        As estimated: x [m], y [m], heading [rad].
    counts : dict
        Readings read, used, dropped and why.
    joint_nll, nll, aic : float or None
        At the best stops, with the stops integrated out (pairs: plain) [nats]; ``aic = 2 (nll + parameters)``.
    weakest_direction : str
        What the readings say least about.
    iterations : int
    seconds : float
        Wall time of the solve [s].
    models : list of ModelScore
        Orders and noise laws tried.
    notes : list of str
        What was done to the input.
    check : CheckReport or None
    """,
    "ModelScore": """One order and noise law that was tried.

    Attributes
    ----------
    order : int
    curve : {"polynomial", "reciprocal", "spline"}
    noise_law : str
    nll, aic : float
        Marginal (pairs: plain) [nats]; infinite where it did not converge.
    """,
    "CheckReport": """What the second program (NLopt) said about the optimum of the full likelihood.

    Attributes
    ----------
    agrees : bool
        To 1e-6 nats.
    better_basin : bool
        Something lower was found.
    nll : float
        Its lowest [nats].
    report : str
        One sentence.
    """,
    "TruthScore": """A calibration against ground truth.

    Attributes
    ----------
    landmark_rmse_m : float or None
        Over landmarks with truth, without alignment [m].
    landmarks, readings : int
        Compared.
    landmark_strain : float or None
        Error in its standard deviations; 1 where the covariances are honest.
    mse_ratio : float or None
        Mean square error of raw over that of corrected readings.
    rmse_raw_m, rmse_corrected_m : float
        The two under the roots [m].
    estimated_stops : bool
        Some true distances were taken from stops that are not ground truth.
    """,
    "CurveChange": """How f changed from one calibration to another, over the range of the second.

    Attributes
    ----------
    largest_m, rms_m : float
        Of |f2 - f1| [m].
    chi_sq, p_value : float or None
        Test that both have the same f, over ``degrees_of_freedom`` coefficients; None where ``reason`` says why not.
    degrees_of_freedom : int
    noise_degrees_of_freedom : float or None
        Of the F law that allows for noise that was itself estimated; None: chi-square.
    first_taken_as_exact : bool
        The first has no covariance.
    given_the_model : bool
        A covariance does not count the choice of order and noise law.
    reason : str
        Why there is no p-value; empty where there is one.
    """,
    "Finding": """One place where model and recording differ; the arrays are its binned residuals.

    Attributes
    ----------
    channel, covariate, shape : str
        What differs, along what, how.
    effects : list of str
        Effects of the final model that it belongs to; ``generic`` where none has a name.
    where : (float or None, float or None)
        Interval of the covariate in which it acts.
    group : str
        Labels of landmarks, or a stop, where it is a group.
    everywhere : str
        Why there is no place; empty where there is one.
    size : float
        In `unit`: m, rad, or a change of log variance.
    unit : str
    p_value : float
        By the likelihood ratio, corrected for everything that was looked at; 1e-300 stands for that or less.
    log_p : float
        Its natural logarithm, which does not underflow.
    share : float or None
        Of the excess misfit that it takes away; None where that is within noise, or no mean changes.
    at : ndarray (bins,)
        In the covariate's unit.
    before, after : ndarray (bins,)
        Mean residual [m] or [rad], or log variance ratio.
    std : ndarray (bins,)
        Of the mean.
    readings : ndarray of int (bins,)
    """,
    "EffectEstimate": """A parameter of an effect.

    Attributes
    ----------
    name : str
        ``effect.parameter_unit``.
    estimate, std : float
        In that unit.
    ci95 : (float, float)
    note : str
        Why `std` is NaN: at its bound, or any phase; else empty.
    """,
    "Explanation": """A set of effects that explains the mismatch.

    Attributes
    ----------
    effects : list of str
    probability : float
        Among the explanations.
    parameters : list of EffectEstimate
    nll, heldout_nll, heldout_std : float, float or None, float or None
        Of the model with them [nats]; the last of the difference of `heldout_nll` to the baseline's.
    p_value : float
        Of the gain.
    indistinguishable_from : list of list of str
        Sets that this recording cannot tell from it.
    separated_by, physics : str
        What to record next; one sentence a person can act on.
    """,
    "Unseen": """An effect that could be there at its typical size without a trace.

    Attributes
    ----------
    effect : str
    typical : dict of float
        Its typical parameters.
    detectable : float or None
        Size that would show, in the unit of the first parameter; None: no size.
    harm_m : float
        RMS error in corrected range that it would cost [m].
    settled_by : str
    """,
    "Member": """What speaks for one name of a diagnosis.

    Attributes
    ----------
    effect : str
    probability : float
        Over the sets compared, of the class of effects that it cannot be told from.
    log_evidence_without : float or None
        Log evidence of the final model without it, less that with it [nats].
    heldout_nll_without : float or None
        Negative log predictive density of the blocks left out, under the final model without it [nats].
    """,
    "Law": """A formula for a mismatch that has no name (docs/laws.md).

    Attributes
    ----------
    id, channel, formula : str
        ``law_1``; what it changes; the formula (docs/effects-by-formula.md).
    variables : list of str
    parameters : list of EffectEstimate
    log_evidence, log_evidence_over_curve : float
        Over the model without it, and over the smooth curve without a name [nats].
    agrees_with_first : bool
        Wherever these recordings have readings, to a twentieth of the squares.
    text : str
        As a file for `load_effects` and ``rangecal predict``, with what was estimated.
    """,
    "NextExperiment": """A change of the experiment and what it would settle.

    Attributes
    ----------
    change : str
    settles : list of str
        Ids of effects.
    power : float
        Computed for this recording extended by the change.
    """,
    "FitSummary": """Goodness of fit.

    Attributes
    ----------
    nll, heldout_nll, heldout_std : float, float or None
        [nats]; of left-out blocks; standard deviation of the difference to the seed model.
    heldout_rms_range_m : float or None
        Of the means of repeats at known distances, each predicted from the blocks left in [m]; None of landmarks.
    rms_range_m, rms_bearing_rad : float
        Of the means of cells [m], [rad].
    chi_sq_per_dof : float
    """,
    "Diagnosis": """What the model leaves out of recordings, and the model completed with it.

    Attributes
    ----------
    verdict : {"no_mismatch", "explained", "partly_explained", "unexplained", "unobservable"}
    sentence : str
        The verdict in one sentence.
    baseline, corrected : Calibration
        The seed model; the completed one, with its effects.
    before, after : FitSummary
    alarm_p_value : float
        Smallest of all questions, corrected for their number.
    location : list of Finding
        Where it shows, strongest evidence first.
    explanations : list of Explanation
        Best first.
    final_effects : list of str
        Empty, or ids (``covariate_drift:supply_v`` along a column), or ``["generic"]`` where nothing in the catalogue explains it; ids and ``"generic"`` where it is explained
        in part.
    members : list of Member
        What speaks for each name; empty where nothing was looked for.
    evidence_omitted : float or None
        Probability of sets of causes that were seen but not fitted.
    nearly_as_likely : list of str
        Where the likeliest set holds a curve without a name: the likeliest set of names alone, if its odds are no worse than one to twenty.
    twins : list of list of str
        What no reading of these recordings can tell apart.
    unseen : list of Unseen
    next_experiments : list of NextExperiment
    notes : list of str
    laws : list of Law
        Where they were asked for and something has no name; the likeliest first.
    heldout_blocks : str
        What was left out at a time: "recordings", "groups of COLUMN", "batches", "distances", "stops", or "stretches" of
        consecutive readings; empty where nothing was.
    heldout_effective_blocks : float
        As many blocks of one size, ``sum(n)**2 / sum(n**2)`` over their readings.
    """,
    "Residuals": """What a calibration leaves of every reading; ordered by recording, stop, landmark and time.

    Attributes
    ----------
    recording, reading, stop, landmark, repeat, row : ndarray of int (n,)
        Indices; -1: no stop or landmark. `reading` is that in the recording's own columns, `row` the line in the file.
    reading_m, bearing_rad : ndarray (n,)
        As read [m], [rad].
    distance_m : ndarray (n,)
        True distance under the model [m].
    range_residual_m, range_std_m : ndarray (n,)
        Reading less its effects less f(d), and the standard deviation as modelled [m].
    bearing_residual_rad, bearing_std_rad : ndarray (n,)
        [rad]; 0 for pairs.
    corrected_m : ndarray (n,)
        Distance that the reading stands for, to first order [m].
    along : dict of ndarray (n,)
        The covariates asked for.
    """,
    "EffectParameter": """A parameter of an effect.

    Attributes
    ----------
    name : str
        Ending in its unit.
    typical, low, high : float
        Typical size; bounds set by physics.
    discrete : bool
        Chosen from a grid: a landmark, a stop, a change point.
    """,
    "Effect": """A physical effect of the catalogue.

    Attributes
    ----------
    id : str
    channel, covariate : str
        Where its mismatch shows.
    physics, formula, source : str
        One sentence; symbols and units; where the formula is from.
    visible_by, settled_by : str
        The design that shows it; what to record to tell it from its twins.
    exact_twins : list of str
        Effects that no recording of this sensor and robot can tell from it.
    parameters : list of EffectParameter
    """,
}


def attach():
    """Gives the classes their docstrings."""
    for name, text in _DOCS.items():
        getattr(_native, name).__doc__ = text
