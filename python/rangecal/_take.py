# SPDX-License-Identifier: BSD-3-Clause
"""Arguments in the shape that the C++ side takes. What does not fit raises one line with the argument's name and what is
wanted: TypeError where another class of object is, InputError for all else."""
import difflib
import math
import operator
import os
from collections.abc import Iterable, Mapping

import numpy as np

from . import _native
from ._native import Calibration, InputError, Recording


def shown(value):
    """What was given, short and in one line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def path(name, value, wanted="a path"):
    try:
        text = os.fsdecode(value)
        text.encode()
    except TypeError:
        raise TypeError(f"{name} is {shown(value)}, not {wanted}") from None
    except UnicodeEncodeError:
        raise InputError(f"{name} is {shown(value)}, which is not UTF-8") from None
    return text


def calibration(name, value):
    """A Calibration, or what the file of that path holds."""
    if isinstance(value, (str, os.PathLike)):
        return _native.load_calibration(path(name, value))
    if not isinstance(value, Calibration):
        raise TypeError(f"{name} is {shown(value)}, not a Calibration, nor the path of one")
    return value


def recordings(name, value):
    """One recording or several, each a Recording or a path, as a list."""
    kinds = Recording, str, os.PathLike
    items = list(value) if isinstance(value, Iterable) and not isinstance(value, kinds) else [value]
    if not items:
        raise InputError(f"{name}: no recording is given")
    for item in items:
        if not isinstance(item, kinds):
            raise TypeError(f"{name}: {shown(item)} is not a Recording, nor the path of one")
    return [item if isinstance(item, Recording) else _native.load_recording(path(name, item), []) for item in items]


def whole(name, value, low=0, high=2**31 - 1):
    try:
        result = operator.index(value)
    except TypeError:
        raise InputError(f"{name} is {shown(value)}, not a whole number") from None
    if not low <= result <= high:
        raise InputError(f"{name} is {result}, {f'not at least {low}' if result < low else f'beyond {high}'}")
    return result


def seed(value):
    return whole("seed", value, high=2**64 - 1)


def number(name, value):
    try:
        result = math.nan if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise InputError(f"{name} is {shown(value)}, not a finite number")
    return result


def numbers(name, value):
    """An array of any shape; NaN is let through."""
    try:
        array = np.asarray(unmasked(value))
        if value is not None and array.dtype.kind in "biufOUS":   # not complex, nor dates
            return array.astype(float, copy=False)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{name}: {shown(value)} is no array of numbers")


def unmasked(values):
    """None in place of what a masked array hides, which NumPy would uncover."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    return np.where(np.ma.getmaskarray(values), None, values.data.astype(object))


def flag(name, value):
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} is {shown(value)}, not True or False")
    return bool(value)


def texts(value):
    """A list of texts; one alone is a list of one. Which there are the callers say."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        value = [value]
    return [str(item) for item in value]


def choice(name, value, known):
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} is {shown(value)}, not {' or '.join(known)}")
    return value


def progress(value):
    if value is not None and not callable(value):
        raise TypeError(f"progress is {shown(value)}, not a function of (stage, fraction)")
    return value


def effects(value):
    """Effects by id, each its parameters by name."""
    value = {} if value is None else value
    if not isinstance(value, Mapping) or not all(isinstance(one, Mapping) for one in value.values()):
        raise InputError(f"effects is {shown(value)}, not a dictionary {{effect: {{parameter: number}}}}")
    return {str(effect): {str(name): number(f"effects: {effect}.{name}", given) for name, given in one.items()}
            for effect, one in value.items()}


def column(name, value, count):
    """One value for each of `count` readings; a single one stands for all."""
    try:
        values = np.asarray(unmasked(value))
    except ValueError:   # ragged
        values = np.empty((0, 0))
    if values.ndim == 0:
        return np.full(count, value)
    if values.ndim > 1:
        raise InputError(f"{name} is not one-dimensional")
    if len(values) != count:
        raise InputError(f"{name} has {len(values)} entries, where there are {count} readings")
    return values


def plain(value):
    """For JSON: what NumPy holds, any kind of dictionary and of number."""
    try:
        if isinstance(value, Mapping):
            return dict(value)
        return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{shown(value)} is no text, number, list or dictionary") from None


def known(what, name, names):
    """Raises for a name that is none of those known, with the one that is nearest."""
    if name in names:
        return
    near = difflib.get_close_matches(name, names, 1)
    hint = f" (did you mean '{near[0]}'?)" if near else ""
    raise InputError(f"{what} '{name}' is not known{hint}; known here: {', '.join(names)}")
