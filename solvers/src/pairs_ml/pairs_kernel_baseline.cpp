// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_kernel.hpp"

#define KERNEL_NAMESPACE baseline
#include "pairs_kernel_body.hpp"
