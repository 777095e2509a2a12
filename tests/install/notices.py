#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""notices.py FILE LOCK MODULES: FILE has every package that the lock file names, with the text of its licence."""
import json
import pathlib
import sys

notices, lock, modules = (pathlib.Path(path) for path in sys.argv[1:4])
text = notices.read_text(encoding="utf-8")
packages = {path: entry for path, entry in json.loads(lock.read_text())["packages"].items() if path}
assert len(packages) > 50, len(packages)
missing = []
for path, entry in packages.items():
    folder = modules.parent / path
    if not folder.exists():  # for another machine than this
        continue
    own = [file for file in folder.iterdir() if file.name.lower().startswith(("licen", "notice", "copyrightnotice", "copying"))]
    heading = f"==== {json.loads((folder / 'package.json').read_text())['name']} {entry['version']} (npm)"
    if heading not in text or not own or any(file.read_text(encoding="utf-8").strip() not in text for file in own):
        missing.append(path)
assert not missing, f"{notices} lacks the notices of {missing}"
for header in ("Eigen/Core", "nlohmann/json.hpp", "CLI/CLI.hpp"):
    assert f"==== {header} (" in text, header
headings = [line for line in text.splitlines() if line.startswith("==== ") and line.endswith(" ====")]
of_npm = sum("(npm)" in line for line in headings)
print(f"{notices.name}: {of_npm} npm packages, {len(headings) - of_npm} libraries whose headers are compiled in")
