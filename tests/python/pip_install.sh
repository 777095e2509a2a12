#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pip wheel, without a network; the wheel into a virtual environment that has nothing of the system's but NumPy, away from the sources: it
# calibrates with the libraries that are in it.
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
"$python" -m venv --system-site-packages build/with
build/with/bin/pip wheel --no-build-isolation --no-deps -w ../wheel . > ../pip.log 2>&1 || { tail -50 ../pip.log; exit 1; }
tail -1 ../pip.log

# Into a virtual environment that sees NumPy and nothing else of the system's packages; the sources are out of reach.
cd "$work"
mv rangecal/build built && rm -rf rangecal && mkdir rangecal
"$python" -m venv rangecal/v
rangecal/v/bin/pip install --no-deps wheel/rangecal-*.whl >> pip.log 2>&1 || { tail -50 pip.log; exit 1; }
numpy=$("$python" -c 'import numpy, pathlib; print(pathlib.Path(numpy.__file__).parent)')
ln -s "$numpy" "$(rangecal/v/bin/python -c 'import site; print(site.getsitepackages()[0])')/numpy"
unset PYTHONPATH LD_LIBRARY_PATH
charts=$(find built -path '*/report/web/installed' | sed 's/.*/charts/')  # where npm had them
rangecal/v/bin/python - "$source/notebooks_data/field-layout" "$charts" <<'END'
import bz2
import ctypes
import hashlib
import lzma
import pathlib
import sqlite3
import sys
import zlib

import numpy.linalg


def libraries():
    with open("/proc/self/maps", encoding="utf-8") as maps:
        return {line.split(maxsplit=5)[5].strip() for line in maps if ".so" in line}


before = libraries()   # those of Python and NumPy
import rangecal

folder = pathlib.Path(rangecal.__file__).parent
assert "site-packages" in folder.parts, folder
for name in ("py.typed", "__init__.pyi"):
    assert (folder / name).exists(), name
calibration = rangecal.calibrate(sys.argv[1])
assert calibration.outcome == "converged", calibration
assert abs(rangecal.correct(calibration, 1.234).distance_m[0] - 1.236) < 0.03
compilers = ("/ld-linux", "/libc.so", "/libm.so", "/libdl.so", "/libpthread.so", "/librt.so", "/libgcc_s.so", "/libstdc++.so")
outside = [path for path in libraries() - before if str(folder) not in path and not any(name in path for name in compilers)]
assert not outside, outside
assert (folder / "lib").is_dir() and any((folder / "lib").glob("libfmt.so.*"))
listed = [line.split() for line in (folder / "licenses/LIBRARIES").read_text().split("\n\n")[1].splitlines()]
assert {line[0] for line in listed} == {path.name for path in (folder / "lib").iterdir()}
unlicensed = [line for line in listed if not (folder / f"licenses/{line[1]}.copyright").exists()]
assert not unlicensed, unlicensed
notices = (folder / "licenses/NOTICES").read_text(encoding="utf-8")
assert "==== Eigen/Core (" in notices and ("==== vega " in notices) == (sys.argv[2] == "charts"), notices[:500]
strays = [path for path in pathlib.Path(sys.prefix).rglob("*") if path.suffix in (".hpp", ".a")]
assert not strays, strays
print(rangecal.__version__, calibration)
END
