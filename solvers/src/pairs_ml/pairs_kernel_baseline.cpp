// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_kernel.hpp"

#define KERNEL_NAMESPACE baseline
#define KERNEL_WIDTH 2
#include "pairs_kernel_body.hpp"
