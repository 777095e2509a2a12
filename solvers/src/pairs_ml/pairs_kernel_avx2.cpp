// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_kernel.hpp"

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC target("avx2,fma")
#define KERNEL_NAMESPACE avx2
#define KERNEL_WIDTH 4
#include "pairs_kernel_body.hpp"
#endif
