#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The README's line: installs the package by pip into a fresh virtual environment, without a network, and calibrates.
# Usage: pip_install.sh SOURCE WORK PYTHON [CMAKE OPTION...]; WORK is emptied.
set -euo pipefail
source=$1 work=$2 python=$3
shift 3
rm -rf "$work"
mkdir -p "$work/rangecal"
cd "$source"
cp -r CMakeLists.txt LICENSE pyproject.toml setup.py cmake core problems solvers report ingest python "$work/rangecal"
cd "$work/rangecal"
# The folder that scikit-build builds in lies as deep below the sources as a preset's, for ccache's relative names.
built=$("$python" -c 'from skbuild.constants import CMAKE_BUILD_DIR; print(CMAKE_BUILD_DIR())')
mkdir -p build/pip "$(dirname "$built")"
ln -s "$PWD/build/pip" "$built"
export SKBUILD_CONFIGURE_OPTIONS="$*" PIP_NO_INDEX=1 PIP_DISABLE_PIP_VERSION_CHECK=1
"$python" -m venv --system-site-packages v
v/bin/pip install --no-build-isolation . > ../pip.log 2>&1 || { tail -50 ../pip.log; exit 1; }
tail -1 ../pip.log

cd "$work"   # away from the sources: what is imported is what was installed
unset PYTHONPATH
rangecal/v/bin/python - "$source/notebooks_data/field-layout" <<'END'
import pathlib
import sys

import rangecal

folder = pathlib.Path(rangecal.__file__).parent
assert "site-packages" in folder.parts, folder
for name in ("py.typed", "__init__.pyi"):
    assert (folder / name).exists(), name
calibration = rangecal.calibrate(sys.argv[1])
assert calibration.outcome == "converged", calibration
assert abs(rangecal.correct(calibration, 1.234).distance_m[0] - 1.236) < 0.03
strays = [path for path in pathlib.Path(sys.prefix).rglob("*") if path.suffix in (".hpp", ".a")]
assert not strays, strays
print(rangecal.__version__, calibration)
END
