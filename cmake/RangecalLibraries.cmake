# SPDX-License-Identifier: BSD-3-Clause
# What the installed libraries need to be linked: looked up with find_package by the build, and with find_dependency by
# rangecalConfig.cmake, beside which this file is installed. All of it are Debian 12 packages.
rangecal_find(Eigen3 3.4 NO_MODULE)
rangecal_find(Ceres 2.1)
rangecal_find(fmt 9)
rangecal_find(yaml-cpp 0.7)
rangecal_find(muparser 2.3)
rangecal_find(TBB)
rangecal_find(NLoptCxx)
rangecal_find(libcsv)
