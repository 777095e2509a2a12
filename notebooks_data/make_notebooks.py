# SPDX-License-Identifier: BSD-3-Clause
"""Makes the notebooks of this folder from their sources in notebooks/, executed: make_notebooks.py [--check] [NAME...]

A source is Python with cells: `# %% [markdown]` begins text, `# %%` begins code. --check changes nothing: it executes the
sources again and fails where a notebook is missing, has other cells, prints something else, or is large. Numbers may
differ by 0.5 % or one unit of their last digit (machines round differently); pictures and times are not compared.
"""
import argparse
import os
import pathlib
import re
import sys

import nbformat
from nbclient import NotebookClient

os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")   # of the kernel's debugger, which nobody attaches
HERE = pathlib.Path(__file__).resolve().parent
LARGEST_BYTES = 300_000
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TIME = re.compile(r"[\d.]+ ?(?:ms|s|seconds|minutes)\b")


def notebook_of(source):
    """The notebook of a source, not yet executed."""
    cells = []
    for part in re.split(r"^# %%", source.read_text(), flags=re.M)[1:]:
        head, _, body = part.partition("\n")
        text = body.strip("\n")
        if "[markdown]" in head:
            text = re.sub(r"^# ?", "", text, flags=re.M)
            cell = nbformat.v4.new_markdown_cell(text)
        else:
            cell = nbformat.v4.new_code_cell(text)
        cell["id"] = f"cell-{len(cells)}"
        cells.append(cell)
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
                "language_info": {"name": "python"}}
    return nbformat.v4.new_notebook(cells=cells, metadata=metadata)


def executed(source):
    notebook = notebook_of(source)
    NotebookClient(notebook, timeout=300, kernel_name="python3",
                   resources={"metadata": {"path": str(HERE)}}).execute()
    for cell in notebook.cells:
        cell.metadata = {}
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def printed(cell):
    """The text that a cell prints, and the text form of its last value; of pictures nothing."""
    text = []
    for output in cell.get("outputs", []):
        if output.output_type == "stream":
            text.append(output.text)
        elif "image/png" not in output.get("data", {}):
            text.append(str(output.get("data", {}).get("text/plain", "")))
    return TIME.sub("TIME", "".join(text))


def same_text(ours, theirs):
    if NUMBER.sub("#", ours).split() != NUMBER.sub("#", theirs).split():
        return False
    for a, b in zip(NUMBER.findall(ours), NUMBER.findall(theirs)):
        digits = max((len(n.partition(".")[2].partition("e")[0]) for n in (a, b)), default=0)
        unit = 10.0**-digits if "e" not in a + b else 0.0
        if abs(float(a) - float(b)) > max(1.01 * unit, 0.005 * abs(float(b))):
            return False
    return True


def differences(stored, fresh):
    """What is wrong with a stored notebook, in words."""
    ours, theirs = stored.cells, fresh.cells
    if [(c.cell_type, c.source) for c in ours] != [(c.cell_type, c.source) for c in theirs]:
        return ["its cells are not those of its source"]
    return [f"cell {i} prints\n{printed(b)}\nwhere the notebook has\n{printed(a)}"
            for i, (a, b) in enumerate(zip(ours, theirs)) if not same_text(printed(a), printed(b))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    parser.add_argument("names", nargs="*", help="sources to take, by the beginnings of their names")
    options = parser.parse_args()
    wrong = 0
    for source in sorted((HERE / "notebooks").glob("*.py")):
        if options.names and not source.name.startswith(tuple(options.names)):
            continue
        target = HERE / (source.stem + ".ipynb")
        fresh = executed(source)
        if not options.check:
            nbformat.write(fresh, target)
        problems = differences(nbformat.read(target, as_version=4), fresh) if target.exists() else ["is missing"]
        if target.exists() and target.stat().st_size > LARGEST_BYTES:
            problems.append(f"has {target.stat().st_size} bytes, more than {LARGEST_BYTES}")
        for problem in problems:
            print(f"{target.name}: {problem}")
        wrong += len(problems)
        print(f"{target.name}: {'as stored' if options.check else 'written'}" if not problems else "make it anew")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
