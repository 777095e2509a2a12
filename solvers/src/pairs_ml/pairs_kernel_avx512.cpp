// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_kernel.hpp"

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC target("avx2,fma,avx512f,avx512dq,prefer-vector-width=512")
#define KERNEL_NAMESPACE avx512
#define KERNEL_WIDTH 8
#include "pairs_kernel_body.hpp"
#endif
