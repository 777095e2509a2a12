# SPDX-License-Identifier: BSD-3-Clause
"""The type stubs name what there is, all of it and nothing else."""
import ast
import inspect
import pathlib
import re

import rangecal
from conftest import scans_of

TREE = ast.parse((pathlib.Path(rangecal.__file__).parent / "__init__.pyi").read_text())


def names(body):
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.AnnAssign):
            yield node.target.id


def test_every_public_name_is_in_the_stubs():
    assert set(rangecal.__all__) | {"__version__"} == set(names(TREE.body))


def test_every_member_is_in_the_stubs(source, field, calibration, diagnosis, eccentric):
    scan = rangecal.CorrectedBag(*[""] * 3, *[0] * 10)
    comparison = rangecal.compare(field, methods=["closed-form", "marginal"], check=True)
    examples = [field, field.sensor, calibration, comparison, comparison.scores[0], comparison.models[0],
                rangecal.compare_curves(calibration, calibration), rangecal.correct(calibration, 1.0), scan, diagnosis,
                diagnosis.before, diagnosis.location[0], diagnosis.explanations[0], diagnosis.members[0],
                diagnosis.explanations[0].parameters[0], diagnosis.next_experiments[0], diagnosis.unseen[0],
                rangecal.study(source / "notebooks_data/studies/quick.yaml", repeats=2),
                rangecal.extract(scans_of([], [(0.0, 0.0)])), rangecal.residuals(eccentric, calibration),
                rangecal.effects()[0], rangecal.effects()[0].parameters[0],
                    rangecal.diagnose(source / "notebooks_data/concealed/world-11", laws=True).laws[0]]
    by_name = {type(e).__name__: e for e in examples}
    left_out = {"InputError", "CheckReport"}
    for node in TREE.body:
        if not isinstance(node, ast.ClassDef) or node.name in left_out:
            continue
        stated = {name for name in names(node.body) if not name.startswith("__")}
        there = {name for name in dir(by_name[node.name]) if not name.startswith("_")}
        assert {name for name in stated if not name.startswith("_")} == there, node.name


def test_functions_have_the_parameters_of_the_stubs_and_docstrings():
    for node in TREE.body:
        if isinstance(node, ast.FunctionDef):
            function = getattr(rangecal, node.name)
            stated = [a.arg for a in node.args.args + node.args.kwonlyargs]
            actual = [p.name for p in inspect.signature(function).parameters.values()
                      if p.kind is not inspect.Parameter.VAR_KEYWORD]
            assert stated == actual, node.name
            assert "Returns\n" in inspect.getdoc(function), node.name


def test_classes_say_what_their_attributes_are_and_methods_what_they_do():
    for node in TREE.body:
        if not isinstance(node, ast.ClassDef) or node.name == "InputError":
            continue
        cls = getattr(rangecal, node.name)
        words = set(re.findall(r"\w+", inspect.getdoc(cls).partition("Attributes\n")[2]))
        for member in node.body:
            if isinstance(member, ast.AnnAssign):
                assert member.target.id in words, f"{node.name}.{member.target.id}"
            elif isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                text = inspect.getdoc(getattr(cls, member.name))  # of the C++ side: a signature, then the sentence
                assert text.strip().splitlines()[-1].rstrip().endswith(".") or "Parameters\n" in text, \
                    f"{node.name}.{member.name}"
