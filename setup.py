# SPDX-License-Identifier: BSD-3-Clause
"""The Python package, built by CMake: pip install --no-build-isolation ."""
import pathlib
import re

from skbuild import setup

here = pathlib.Path(__file__).parent
version = re.search(r"project\(rangecal VERSION ([\d.]+)", (here / "CMakeLists.txt").read_text()).group(1)

setup(
    name="rangecal",
    version=version,
    description="Calibrates cheap range sensors and finds the physics a model left out",
    license="BSD-3-Clause",
    packages=["rangecal"],
    package_dir={"": "python"},
    package_data={"rangecal": ["py.typed", "*.pyi"]},
    python_requires=">=3.9",
    install_requires=["numpy"],
    extras_require={"all": ["pandas", "matplotlib"]},
    cmake_args=["-DCMAKE_BUILD_TYPE=Release", "-DRANGECAL_BUILD_PYTHON=ON", "-DRANGECAL_UNITY=ON"]
    + [f"-DRANGECAL_{part}=OFF" for part in ("BUILD_APPS", "BUILD_TESTS", "BUILD_BENCHMARKS", "INSTALL")],
)
