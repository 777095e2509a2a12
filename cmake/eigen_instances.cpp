// SPDX-License-Identifier: BSD-3-Clause
#define RANGECAL_COMPILES_EIGEN
#include "eigen_instances.hpp"
